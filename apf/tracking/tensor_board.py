"""TensorBoard: `tensorboard --logdir runs` shows the curves of all runs there."""

import os
from typing import Any

import yaml

from apf.settings import settings
from apf.tracking.base import Metrics, RunFiles, RunInfo
from apf.tracking.mirror import Mirror

FOLDER = "tensorboard"
"""Of the event files, in the run directory."""


@settings
class TensorBoardTracker(Mirror):
    """Writes event files into the run directory: curves over labelled plans, the config, pictures.

    A start writes the whole history into a new event file, and removes those of earlier starts: no step is there twice.
    """

    title = "TensorBoard"
    extra = "tensorboard"

    def open_run(self, run: RunInfo) -> Any:
        """PyTorch's writer of event files."""
        os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # no remarks of TensorFlow's, if it is there
        from torch.utils.tensorboard import SummaryWriter

        folder = run.directory / FOLDER
        for path in folder.glob("events.out.tfevents.*"):
            path.unlink()
        writer = SummaryWriter(folder)
        text = yaml.safe_dump({**run.about, **run.config}, sort_keys=False, allow_unicode=True)
        writer.add_text("config", "".join(f"    {line}\n" for line in text.splitlines()))  # four blanks: as it is
        return writer

    def write(self, opened: Any, metrics: Metrics) -> None:
        """Points of the curves."""
        for name, value in metrics.values.items():
            opened.add_scalar(name, value, metrics.plans)
        opened.flush()

    def write_files(self, opened: Any, files: RunFiles) -> None:
        """Pictures."""
        from matplotlib.image import imread

        for name, path in files.pictures().items():
            opened.add_image(name, imread(path)[..., :3], files.plans, dataformats="HWC")

    def close(self, opened: Any, failed: bool) -> None:
        """Flush and close the file."""
        opened.close()
