"""The terminal, and the same lines in run.log."""

import logging
import sys
import time
from collections.abc import Mapping

from rich.console import RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.spinner import Spinner
from rich.table import Table
from rich.text import Text

from apf.errors import InputError, Stopped
from apf.terminal import console
from apf.tracking.base import Metrics, RunInfo, Tracker
from apf.tracking.progress import Estimate, Progress, ProgressFile, times

log = logging.getLogger("apf")

EVERY = 60.0
"""Seconds between two lines that say how long it still takes, where there is no terminal."""
BAR = 16
"""Characters of the bar."""


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
        self._estimate = Estimate()
        self._told = ProgressFile()
        self._now = ("starting", 0)
        self._steps = 0
        self._next = time.monotonic() + EVERY
        self._spinner = Spinner("dots")
        self._live: Live | None = None
        self._file: logging.Handler | None = None

    def start(self, run: RunInfo) -> None:
        """Say what begins, and where."""
        self._file = LogFile(run.directory / "run.log")
        self._file.setFormatter(logging.Formatter("%(asctime)s %(message)s"))
        log.addHandler(self._file)
        log.setLevel(logging.INFO)
        self.say(f"{run.name} in {run.directory}")
        if run.history:
            last = run.history[-1]
            self.say(f"going on after step {last.step}, {last.plans} plans")
        if self.console.is_terminal:
            self._live = Live(get_renderable=self._line, console=self.console, transient=True, refresh_per_second=5)
            self._live.start()

    def plan(self, steps: int, work: Mapping[str, int]) -> None:
        """From this follows how long it takes."""
        self._steps = steps
        self._estimate.plan(work)

    def begin(self, step: int, kind: str, number: int = 1, of: int = 1) -> None:
        """As `Tracker.begin`: show it."""
        self._estimate.begin(kind)
        self._now = (f"{kind} {number}/{of}" if of > 1 else kind, step)
        self._told.write(kind, self._progress)
        if not self.console.is_terminal and time.monotonic() >= self._next:
            self._next = time.monotonic() + EVERY
            now = self._progress()
            self.say(f"{now.where}: {times(now.gone, now.left, now.whole)}")

    def _progress(self) -> Progress:
        what, step = self._now
        left, whole = self._estimate.left()
        return Progress(what, step, self._steps, self._estimate.gone, left, whole, time.time())

    def _line(self) -> RenderableType:
        """What is done, how much of all there is, how long it took and still takes."""
        now = self._progress()
        known = now.left > 0 or now.whole
        bar = ProgressBar(now.gone + now.left, now.gone, width=BAR, pulse=not known)
        row = Table.grid(padding=(0, 1))
        for _ in range(4):
            row.add_column(no_wrap=True)
        row.add_row(self._spinner, Text(now.where), bar, Text(times(now.gone, now.left, now.whole)))
        return row

    def log(self, metrics: Metrics) -> None:
        """One line for each topic: the part of a number's name before the slash."""
        topics: dict[str, list[str]] = {}
        for name, value in metrics.values.items():
            topic, _, number = name.partition("/")
            topics.setdefault(topic, []).append(f"{number} {value:.3g}")
        for topic, numbers in topics.items():
            self.say(f"step {metrics.step}, {metrics.plans} plans, {topic}: {', '.join(numbers)}")

    def finish(self, failed: bool) -> None:
        """Take the bar away."""
        if self._live:
            self._live.stop()
            self._live = None
        if self._file:
            log.removeHandler(self._file)
            self._file.close()
            self._file = None

    def say(self, line: str) -> None:
        """One line on the terminal and in run.log."""
        log.info(line)
        if self._live:
            self._live.console.print(line)
        else:
            print(line, file=sys.stderr, flush=True)
