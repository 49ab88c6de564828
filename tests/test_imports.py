"""What a start imports, and what it leaves for later."""

import subprocess
import sys

import pytest

LOADED = "'torch_geometric' in sys.modules, 'torch._dynamo' in sys.modules"
LSTM = "apf.models.LSTMNetwork(members=2, n_features=10, n_position=3, hidden=8, layers=1)"


@pytest.mark.parametrize("more", ["", f"import torch; apf.models.kernels.passes_of({LSTM})"])
def test_a_start_does_not_import_torch_geometric_and_torchs_compiler(more: str) -> None:
    """They are imported when a graph network is made, or anything trained."""
    code = f"import sys, apf.main, apf.commands.label, apf.relabel; {more}\nprint({LOADED})"
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert process.stdout.split() == ["False", "False"]
