"""Networks, ensembles of them, and their training."""

from typing import Any

from apf.models.ensemble import Ensemble, EnsembleSettings, pick_device
from apf.models.layers import EnsembleLinear, EnsembleNetwork
from apf.models.lstm import LSTMNetwork
from apf.models.training import History, Training

__all__ = [
    "FCGN",
    "TGN",
    "Ensemble",
    "EnsembleLinear",
    "EnsembleNetwork",
    "EnsembleSettings",
    "History",
    "LSTMNetwork",
    "Training",
    "pick_device",
]


def __getattr__(name: str) -> Any:
    """TGN and FCGN are imported when they are first used: torch-geometric takes a second or two to import."""
    if name in ("TGN", "FCGN"):
        from apf.models import graph

        return getattr(graph, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
