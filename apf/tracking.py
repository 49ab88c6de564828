"""Mirrors of a run: the terminal and Weights & Biases. The run directory is the truth; these only show it."""

import logging
import os
import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from apf.errors import InputError
from apf.settings import settings

log = logging.getLogger("apf")


@dataclass(frozen=True)
class RunInfo:
    """What a mirror should know of a run when it starts. group: the sweep that it belongs to, or None."""

    name: str
    directory: Path
    config: dict[str, Any]
    group: str | None


class Tracker(ABC):
    """Shows the progress of one run. Used as a context: it ends when the run does, however that is."""

    @abstractmethod
    def start(self, run: RunInfo) -> None:
        """The run begins (or goes on)."""

    def phase(self, step: int, steps: int, what: str) -> None:  # noqa: B027
        """Now doing `what`, in step `step` of `steps`."""

    def detail(self, what: str) -> None:  # noqa: B027
        """Within the phase, now doing `what`."""

    @abstractmethod
    def log(self, step: int, towers: int, metrics: Mapping[str, float]) -> None:
        """Figures of a step, by name, and how many towers were labelled by then."""

    @abstractmethod
    def finish(self, failed: bool) -> None:
        """The run ended."""


@settings
class NoTracker(Tracker):
    """Mirrors nothing."""

    def start(self, run: RunInfo) -> None: ...

    def log(self, step: int, towers: int, metrics: Mapping[str, float]) -> None: ...

    def finish(self, failed: bool) -> None: ...


class WandbTracker(Tracker):
    """One W&B run per job. `offline` needs no account and no network: `wandb sync` sends it later."""

    def __init__(self, project: str, mode: Literal["offline", "online"], entity: str | None = None) -> None:
        if mode not in ("offline", "online"):
            raise ValueError(f"mode is {mode}; it must be offline or online")
        self.project, self.mode, self.entity = project, mode, entity
        self._run: Any = None

    def start(self, run: RunInfo) -> None:
        """Open the run; its files lie in the run directory."""
        if self.mode == "offline":  # else W&B sends reports of its own errors
            os.environ.setdefault("WANDB_ERROR_REPORTING", "false")
        import wandb

        try:
            self._run = self._init(wandb, run)
        except wandb.errors.Error as error:
            raise InputError(f"tracker.mode={self.mode}: {str(error).splitlines()[0]}") from None
        self._run.define_metric("towers")
        self._run.define_metric("*", step_metric="towers")

    def _init(self, wandb: Any, run: RunInfo) -> Any:
        return wandb.init(
            project=self.project,
            entity=self.entity,
            mode=self.mode,
            name=run.name,
            group=run.group,
            dir=run.directory,
            config=run.config,
            settings=wandb.Settings(silent=True, console="off"),
        )

    def log(self, step: int, towers: int, metrics: Mapping[str, float]) -> None:
        """Curves over the number of labelled towers."""
        self._run.log({"towers": towers, "step": step, **{name: float(value) for name, value in metrics.items()}})

    def finish(self, failed: bool) -> None:
        """Close the run, so that the next job of this process opens its own."""
        if self._run is not None:
            self._run.finish(exit_code=int(failed))
            self._run = None


class ConsoleTracker(Tracker):
    """A progress bar on a terminal, plain lines elsewhere; and the same lines in run.log."""

    def __init__(self) -> None:
        self.console = Console(stderr=True)
        self._progress: Progress | None = None
        self._file: logging.Handler | None = None

    def start(self, run: RunInfo) -> None:
        """Say what begins, and where."""
        self._file = logging.FileHandler(run.directory / "run.log")
        self._file.setFormatter(logging.Formatter("%(asctime)s %(message)s"))
        log.addHandler(self._file)
        log.setLevel(logging.INFO)
        self._say(f"{run.name} in {run.directory}")
        if self.console.is_terminal:
            columns = (
                SpinnerColumn(),
                TextColumn("step {task.completed}/{task.total}"),
                BarColumn(),
                TimeElapsedColumn(),
                TextColumn("left"),
                TimeRemainingColumn(elapsed_when_finished=False),
                TextColumn("{task.description}"),
            )
            self._progress = Progress(*columns, console=self.console, transient=True)
            self._task = self._progress.add_task("starting", total=None)
            self._progress.start()

    def phase(self, step: int, steps: int, what: str) -> None:
        """Move the bar."""
        if self._progress:
            self._progress.update(self._task, completed=step, total=max(steps, 1), description=what)

    def detail(self, what: str) -> None:
        """Say it beside the bar."""
        if self._progress:
            self._progress.update(self._task, description=what)

    def log(self, step: int, towers: int, metrics: Mapping[str, float]) -> None:
        """One line for each topic: the part of a figure's name before the slash."""
        topics: dict[str, list[str]] = {}
        for name, value in metrics.items():
            topic, _, figure = name.partition("/")
            topics.setdefault(topic, []).append(f"{figure} {value:.3g}")
        for topic, figures in topics.items():
            self._say(f"step {step}, {towers} towers, {topic}: {', '.join(figures)}")

    def finish(self, failed: bool) -> None:
        """Take the bar away."""
        if self._progress:
            self._progress.stop()
        if self._file:
            log.removeHandler(self._file)
            self._file.close()

    def _say(self, line: str) -> None:
        log.info(line)
        if self._progress:
            self._progress.console.print(line, highlight=False)
        else:
            print(line, file=sys.stderr, flush=True)


class Trackers(Tracker):
    """Several mirrors as one."""

    def __init__(self, trackers: Sequence[Tracker]) -> None:
        self.trackers = trackers

    def start(self, run: RunInfo) -> None:
        """Start each."""
        for tracker in self.trackers:
            tracker.start(run)

    def phase(self, step: int, steps: int, what: str) -> None:
        """Tell each."""
        for tracker in self.trackers:
            tracker.phase(step, steps, what)

    def detail(self, what: str) -> None:
        """Tell each."""
        for tracker in self.trackers:
            tracker.detail(what)

    def log(self, step: int, towers: int, metrics: Mapping[str, float]) -> None:
        """Tell each."""
        for tracker in self.trackers:
            tracker.log(step, towers, metrics)

    def finish(self, failed: bool) -> None:
        """Finish each."""
        for tracker in self.trackers:
            tracker.finish(failed)
