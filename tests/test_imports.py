"""What a start imports, and what it leaves for later."""

import importlib.metadata
import re
import subprocess
import sys
from pathlib import Path

import pytest

import apf

PACKAGE = Path(apf.__file__).parent

LOADED = "'torch_geometric' in sys.modules, 'torch._dynamo' in sys.modules"
LSTM = "apf.models.LSTMNetwork(members=2, n_features=10, n_position=3, hidden=8, layers=1)"


@pytest.mark.parametrize("more", ["", f"import torch; apf.models.kernels.passes_of({LSTM})"])
def test_a_start_does_not_import_torch_geometric_and_torchs_compiler(more: str) -> None:
    """They are imported when a graph network is made, or anything trained."""
    modules = "apf.commands.run, apf.commands.label, apf.commands.relabel, apf.models.graph"
    code = f"import sys, {modules}; {more}\nprint({LOADED})"
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert process.stdout.split() == ["False", "False"]


def test_the_package_alone_imports_nothing() -> None:
    code = "import sys; before = {*sys.modules}; import apf; dir(apf); print(*{*sys.modules} - before)"
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {name.partition(".")[0] for name in process.stdout.split()} <= {"apf", *sys.stdlib_module_names}


def test_nobody_imports_the_files_that_start_commands() -> None:
    """After an import of `apf.plan`, the file would hide the function of that name."""
    names = "|".join(name for name in apf.__all__ if (PACKAGE / f"{name}.py").exists())
    assert names == "label|plan|predict"
    imports = re.compile(
        rf"^\s*(import apf\.({names})\b|from apf\.({names}) import|from apf import .*\b({names})\b)", re.M
    )
    here = Path(__file__).parents[1]
    files = [path for room in ("apf", "tests", "analysis", "benchmarks") for path in (here / room).rglob("*.py")]
    assert [path for path in files if imports.search(path.read_text())] == []


def test_what_the_package_offers() -> None:
    assert apf.__version__ == importlib.metadata.version("apf")
    assert {*apf.__all__} <= {*dir(apf)}
    for name in apf.__all__:
        assert getattr(apf, name).__doc__
    with pytest.raises(AttributeError, match=r"apf.*towerz"):
        _ = apf.towerz
    assert (PACKAGE / "py.typed").is_file()
