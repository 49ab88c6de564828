"""Weights & Biases. Whatever it cannot do costs the mirror, never the run."""

import os
import shutil
import sys
from dataclasses import field
from typing import Any, Literal

from apf.errors import InputError
from apf.settings import settings
from apf.tracking.base import Figures, Phase, RunInfo, Tracker

TIMEOUT = 30
"""Seconds to wait for W&B's servers when a run opens."""


@settings
class WandbTracker(Tracker):
    """One W&B run per job. `offline` needs no account and no network: `wandb sync` sends it later.

    A run that goes on is told its whole history again, each phase of a step under a number of its own: W&B takes what
    it has not, so that one run holds it all. Offline, files of earlier starts then hold nothing more, and are removed.
    """

    project: str
    mode: Literal["offline", "online"]
    entity: str | None = None
    _open: list[Any] = field(default_factory=list, init=False, repr=False)
    """The run, while there is one."""

    def start(self, run: RunInfo) -> None:
        """Open the run; its files lie in the run directory. Raises InputError if W&B wants a login first."""
        if self.mode == "offline":  # else W&B sends reports of its own errors
            os.environ.setdefault("WANDB_ERROR_REPORTING", "false")
            for folder in (run.directory / "wandb").glob(f"offline-run-*-{run.id}"):
                shutil.rmtree(folder, ignore_errors=True)
        import wandb

        try:
            opened = wandb.init(
                project=self.project,
                entity=self.entity,
                mode=self.mode,
                name=run.name,
                id=run.id,
                resume="allow" if self.mode == "online" else None,
                group=run.group,
                dir=run.directory,
                config=run.config,
                settings=wandb.Settings(silent=True, console="off", init_timeout=TIMEOUT),
            )
            opened.define_metric("towers")
            opened.define_metric("*", step_metric="towers")
        except (wandb.errors.UsageError, wandb.errors.AuthenticationError) as error:
            raise InputError(f"tracker.mode={self.mode}: {str(error).splitlines()[0]}") from None
        except Exception as error:
            self._go_on_without(error)
            return
        self._open.append(opened)
        for figures in run.history:
            self.log(figures)

    def log(self, figures: Figures) -> None:
        """Curves over the number of labelled towers."""
        numbers = {name: float(value) for name, value in figures.metrics.items()}
        row = {"towers": figures.towers, "step": figures.step, **numbers}
        for run in self._open:
            try:
                run.log(row, step=figures.step * len(Phase) + figures.phase)
            except Exception as error:
                self._go_on_without(error)

    def finish(self, failed: bool) -> None:
        """Close the run, so that the next job of this process opens its own."""
        for run in self._open:
            try:
                run.finish(exit_code=int(failed))
            except Exception as error:
                self._go_on_without(error)
        self._open.clear()

    def _go_on_without(self, error: Exception) -> None:
        self._open.clear()
        reason = next(iter(str(error).splitlines()), type(error).__name__)
        print(f"W&B does not work, going on without it: {reason}", file=sys.stderr, flush=True)
