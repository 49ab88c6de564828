"""The wheel carries its configs and runs from any directory, with no checkout near."""

import shutil
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
import yaml

from integration.command_line import CONF, REPOSITORY, TINY, Result, call, spawn

SWEEPS = REPOSITORY / "sweeps"
RUN = """
import runpy, apf, apf.config.values
print(apf.__file__, apf.config.values.config_dir(), sep="\\n")
runpy.run_module("apf.main", run_name="__main__")
"""


@pytest.fixture(scope="module")
def installed(once: Callable) -> Path:
    """The folder that the wheel was built in (wheels/) and installed into (site/)."""

    def make(folder: Path) -> Result:
        source = folder / "source"
        source.mkdir()
        for name in ("apf", "analysis", "conf", "hydra_plugins", "sweeps"):
            shutil.copytree(REPOSITORY / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
        for name in ("pyproject.toml", "README.md"):
            shutil.copy(REPOSITORY / name, source / name)
        pip = ["-m", "pip", "--disable-pip-version-check", "--no-input"]
        wheels = folder / "wheels"
        spawn([*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", wheels, source], cwd=folder).must_work()
        shutil.rmtree(source)
        (wheel,) = wheels.glob("*.whl")
        return spawn([*pip, "install", "--no-deps", "--no-index", "--target", folder / "site", wheel], cwd=folder)

    folder, result = once("wheel", make)
    result.must_work()
    return folder


@pytest.mark.slow
def test_the_wheel_holds_the_package_and_every_config(installed: Path) -> None:
    (wheel,) = (installed / "wheels").glob("apf-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if not name.startswith("apf-")}
    configs = {f"apf/conf/{path.relative_to(CONF)}" for path in CONF.rglob("*.yaml")}
    configs |= {f"sweeps/{path.relative_to(SWEEPS)}" for path in SWEEPS.rglob("*.yaml")}
    packages = [REPOSITORY / name for name in ("apf", "analysis", "hydra_plugins", "sweeps")]
    code = {str(path.relative_to(REPOSITORY)) for package in packages for path in package.rglob("*.py")}
    shipped = {
        str(path.relative_to(REPOSITORY)) for path in (REPOSITORY / "apf" / "shipped").rglob("*") if path.is_file()
    }
    assert names == configs | code | shipped | {"apf/py.typed"}


@pytest.mark.slow
def test_it_runs_from_any_directory(installed: Path, tmp_path: Path) -> None:
    command = ["-c", RUN, *TINY, "hydra.run.dir=run"]
    result = spawn(command, cwd=tmp_path, PYTHONPATH=str(installed / "site")).must_work()
    package, configs = result.out.splitlines()[:2]
    assert Path(package) == installed / "site" / "apf" / "__init__.py", "the checkout must not be what runs"
    assert Path(configs) == installed / "site" / "apf" / "conf"
    assert len(pd.read_parquet(tmp_path / "run" / "plans.parquet"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run"]


@pytest.mark.slow
def test_its_configs_are_those_of_the_checkout(installed: Path, tmp_path: Path) -> None:
    command = ["-m", "apf.main", "--cfg", "job", "+experiment=smoke"]
    there = spawn(command, cwd=tmp_path, PYTHONPATH=str(installed / "site")).must_work()
    assert yaml.safe_load(there.out)["plans"] == 40
    assert there.out == call(*command[2:]).must_work().out


@pytest.mark.slow
def test_its_sweeps_are_those_of_the_checkout(installed: Path, tmp_path: Path) -> None:
    command = ["-m", "apf.main", "--cfg", "all", "+experiment=strategies"]
    there = spawn(command, cwd=tmp_path, PYTHONPATH=str(installed / "site")).must_work()
    composed = yaml.safe_load(there.out)
    assert composed["hydra"]["sweeper"]["params"]["sampler"] == "sequential,incremental,complete,greedy"
    assert composed["planner"]["candidates"] == 20_000


@pytest.mark.slow
def test_its_analysis_is_a_package(installed: Path, tmp_path: Path) -> None:
    there = spawn(["-m", "analysis.plot_regret", "nowhere"], cwd=tmp_path, PYTHONPATH=str(installed / "site"))
    there.must_refuse("nowhere: no such directory")


@pytest.mark.slow
def test_its_command_is_called_apf(installed: Path, tmp_path: Path) -> None:
    script = installed / "site" / "bin" / "apf"
    assert script.exists()
    result = spawn([script, "--help"], cwd=tmp_path, PYTHONPATH=str(installed / "site")).must_work()
    assert "python -m apf.main" in result.out
    assert sys.prefix in script.read_text().splitlines()[0]
