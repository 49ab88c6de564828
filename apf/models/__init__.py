"""Networks, ensembles of them, and their training."""

from apf.models.ensemble import Ensemble, EnsembleSettings, pick_device
from apf.models.graph import FCGN, TGN
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
