"""Mirrors of a run: the terminal, W&B, TensorBoard, MLflow, a table. The run directory is the truth."""

from apf.tracking.base import Metrics, NoTracker, Phase, RunFiles, RunInfo, Tracker, Trackers
from apf.tracking.board import Board
from apf.tracking.console import ConsoleTracker, log_end
from apf.tracking.csv_table import CsvTracker
from apf.tracking.mirror import Mirror
from apf.tracking.ml_flow import MlflowTracker
from apf.tracking.progress import ProgressFile
from apf.tracking.tensor_board import TensorBoardTracker
from apf.tracking.weights_and_biases import WandbTracker

__all__ = [
    "Board",
    "ConsoleTracker",
    "CsvTracker",
    "Metrics",
    "Mirror",
    "MlflowTracker",
    "NoTracker",
    "Phase",
    "ProgressFile",
    "RunFiles",
    "RunInfo",
    "TensorBoardTracker",
    "Tracker",
    "Trackers",
    "WandbTracker",
    "log_end",
]
