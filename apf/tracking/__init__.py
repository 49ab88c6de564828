"""Mirrors of a run: the terminal and Weights & Biases. The run directory is the truth; mirrors only show it."""

from apf.tracking.base import Metrics, NoTracker, Phase, RunInfo, Tracker, Trackers
from apf.tracking.board import Board
from apf.tracking.console import ConsoleTracker, log_end
from apf.tracking.progress import ProgressFile
from apf.tracking.weights_and_biases import WandbTracker

__all__ = [
    "Board",
    "ConsoleTracker",
    "Metrics",
    "NoTracker",
    "Phase",
    "ProgressFile",
    "RunInfo",
    "Tracker",
    "Trackers",
    "WandbTracker",
    "log_end",
]
