"""A table of all metrics in the run directory."""

from pathlib import Path
from typing import Any

import pandas as pd

from apf.rundir.files import replacing
from apf.settings import settings
from apf.tracking.base import Metrics, RunInfo
from apf.tracking.mirror import Mirror

METRICS = "metrics.csv"
"""The table: a row for each step, with the columns `step` and `plans`, then one for each metric."""


@settings
class CsvTracker(Mirror):
    """Writes `metrics.csv`, anew after each phase of a step: the file is whole at any time."""

    title = "The table of metrics"

    def open_run(self, run: RunInfo) -> tuple[Path, dict[int, dict[str, Any]]]:
        """The file, and its rows by their steps."""
        return run.directory / METRICS, {}

    def write(self, opened: tuple[Path, dict[int, dict[str, Any]]], metrics: Metrics) -> None:
        """Add to the row of the step."""
        path, rows = opened
        rows.setdefault(metrics.step, {}).update({"step": metrics.step, "plans": metrics.plans, **metrics.values})
        with replacing(path) as half:
            pd.DataFrame([*rows.values()]).to_csv(half, index=False)

    def close(self, opened: Any, failed: bool) -> None:
        """The file is complete."""
