"""The terminal, and the same lines in run.log."""

import logging
import sys

from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from apf.errors import InputError, Stopped
from apf.terminal import console
from apf.tracking.base import Figures, RunInfo, Tracker

log = logging.getLogger("apf")


class LogFile(logging.FileHandler):
    """A full disk costs lines of the log, not the run."""

    def handleError(self, record: logging.LogRecord) -> None:
        """Say nothing: the terminal has the line."""


def log_end(error: BaseException) -> None:
    """Note in run.log what ended a run: one line, or the traceback of a crash."""
    crash = isinstance(error, Exception) and not isinstance(error, (InputError, Stopped))
    log.error("%s", error or type(error).__name__, exc_info=error if crash else None)


class ConsoleTracker(Tracker):
    """A progress bar on a terminal, plain lines elsewhere; and the same lines in run.log."""

    def __init__(self) -> None:
        self.console = console(stderr=True)
        self._progress: Progress | None = None
        self._file: logging.Handler | None = None

    def start(self, run: RunInfo) -> None:
        """Say what begins, and where."""
        self._file = LogFile(run.directory / "run.log")
        self._file.setFormatter(logging.Formatter("%(asctime)s %(message)s"))
        log.addHandler(self._file)
        log.setLevel(logging.INFO)
        self._say(f"{run.name} in {run.directory}")
        if run.history:
            last = run.history[-1]
            self._say(f"going on after step {last.step}, {last.towers} towers")
        if self.console.is_terminal:
            columns = (
                SpinnerColumn(),
                TextColumn("step {task.completed}/{task.total}"),
                BarColumn(),
                TimeElapsedColumn(),
                TextColumn("left"),
                TimeRemainingColumn(elapsed_when_finished=False),
                TextColumn("{task.description}", markup=False),
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

    def log(self, figures: Figures) -> None:
        """One line for each topic: the part of a number's name before the slash."""
        topics: dict[str, list[str]] = {}
        for name, value in figures.metrics.items():
            topic, _, number = name.partition("/")
            topics.setdefault(topic, []).append(f"{number} {value:.3g}")
        for topic, numbers in topics.items():
            self._say(f"step {figures.step}, {figures.towers} towers, {topic}: {', '.join(numbers)}")

    def finish(self, failed: bool) -> None:
        """Take the bar away."""
        if self._progress:
            self._progress.stop()
            self._progress = None
        if self._file:
            log.removeHandler(self._file)
            self._file.close()
            self._file = None

    def _say(self, line: str) -> None:
        log.info(line)
        if self._progress:
            self._progress.console.print(line)
        else:
            print(line, file=sys.stderr, flush=True)
