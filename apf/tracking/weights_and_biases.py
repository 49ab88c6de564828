"""Weights & Biases (W&B). If W&B fails, the run loses this mirror and goes on."""

import os
import shutil
import sys
from collections.abc import Mapping
from dataclasses import field
from pathlib import Path
from typing import Any, Literal

from apf.settings import Seconds, settings
from apf.tracking.base import Metrics, Phase, RunInfo, Tracker

Mode = Literal["offline", "online"]
MODES: dict[str, Mode | None] = {
    **dict.fromkeys(("online", "run"), "online"),
    **dict.fromkeys(("offline", "dryrun"), "offline"),
    "disabled": None,
}
"""The values of W&B's variable WANDB_MODE, older names included, and the mode that each means; None: no mirror."""
FAILURES = (Exception, SystemExit)
"""Errors that a library may raise, SystemExit included. Ctrl-C and signals are not among them."""


def mode_here(chosen: Mode, environment: Mapping[str, str]) -> Mode | None:
    """W&B's mode: the one of the environment variables, if they are set, else the chosen one.

    Returns None where WANDB_MODE or WANDB_DISABLED switches W&B off. Raises ValueError if WANDB_MODE is no mode.
    """
    if environment.get("WANDB_DISABLED", "").lower() not in ("", "0", "false", "no", "off"):
        return None
    named = environment.get("WANDB_MODE", "").lower() or chosen
    if named not in MODES:
        raise ValueError(f"WANDB_MODE is {named!r}; it should be online, offline or disabled")
    return MODES[named]


@settings
class WandbTracker(Tracker):
    """One W&B run per job. `offline` needs no account and no network: `wandb sync` sends the run later.

    A resumed run logs its whole history again, and each phase of a step has its own number. W&B skips the numbers that
    it has, so one W&B run holds the whole history. Offline, the files of earlier starts are then redundant, and are
    removed.

    W&B's environment variables win over the config, except for those that identify the run.
    """

    project: str | None
    mode: Mode
    timeout: Seconds
    """Seconds that a run waits for W&B's servers: when it starts, and for the last metrics when it ends."""
    entity: str | None = None
    _open: list[Any] = field(default_factory=list, init=False, repr=False)
    """The run, while there is one."""

    def start(self, run: RunInfo) -> None:
        """Open the run; its files lie in the run directory, or in WANDB_DIR."""
        try:
            mode = mode_here(self.mode, os.environ)
            if self.mode == "online" != mode:
                print(f"tracker.mode is online, but W&B is {mode or 'disabled'} in this environment", file=sys.stderr)
            if mode is not None:
                self._open.append(self._opened(run, mode))
        except FAILURES as error:
            self._go_on_without(error)
        for metrics in run.history if self._open else ():
            self.log(metrics)

    def _opened(self, run: RunInfo, mode: Mode) -> Any:
        """W&B's run. Raises whatever W&B raises, on its import too."""
        directory = Path(os.environ.get("WANDB_DIR") or run.directory)
        if mode == "offline":
            for folder in (directory / "wandb").glob(f"offline-run-*-{run.id}"):
                shutil.rmtree(folder, ignore_errors=True)
        directory.mkdir(parents=True, exist_ok=True)  # W&B would take a temporary one
        os.environ.setdefault("WANDB_ERROR_REPORTING", "false")  # no reports of W&B's own errors
        os.environ.setdefault("WANDB_SILENT", "true")  # nothing printed, and no question of who is there
        import wandb

        seconds = self.timeout
        own = {"console": "off", "init_timeout": seconds, "login_timeout": seconds, "finish_timeout": seconds}
        own = {name: value for name, value in own.items() if f"WANDB_{name.upper()}" not in os.environ}
        opened = wandb.init(
            project=self.project,
            entity=self.entity,
            mode=mode,
            name=run.name,
            id=run.id,
            resume="allow" if mode == "online" else None,
            group=run.group,
            dir=directory,
            config=run.config,
            reinit="create_new",  # whatever became of the run of another job of this process
            settings=wandb.Settings(**own, finish_timeout_raises=True),
        )
        opened.define_metric("plans")
        opened.define_metric("*", step_metric="plans")
        return opened

    def log(self, metrics: Metrics) -> None:
        """Curves over the number of labelled plans."""
        numbers = {name: float(value) for name, value in metrics.values.items()}
        row = {"plans": metrics.plans, "step": metrics.step, **numbers}
        for run in tuple(self._open):
            try:
                run.log(row, step=metrics.step * len(Phase) + metrics.phase)
            except FAILURES as error:
                self._go_on_without(error)

    def finish(self, failed: bool) -> None:
        """Close the run, so that the next job of this process opens its own."""
        for run in tuple(self._open):
            try:
                run.finish(exit_code=int(failed))
            except FAILURES as error:
                self._go_on_without(error)
        self._open.clear()

    def _go_on_without(self, error: BaseException) -> None:
        self._open.clear()
        reason = next(iter(str(error).splitlines()), "") or type(error).__name__
        print(f"W&B does not work, going on without it: {reason}", file=sys.stderr, flush=True)
