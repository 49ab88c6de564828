"""The runs of a sweep on a terminal: where each is, and how long all of them still take."""

import contextlib
import heapq
import itertools
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.text import Text

from apf.tracking.progress import Progress, ProgressFile, clock, still, times


class Board:
    """Shows the runs of a sweep that go on, and the time that is left. Several threads may use it."""

    def __init__(self, console: Console, total: int, done: int, at_once: int) -> None:
        """No run goes on yet.

        Args:
            console: The terminal.
            total: Number of runs of the sweep.
            done: Number of runs that have ended already.
            at_once: Number of runs that go on together.
        """
        self.console, self.total, self.done, self.at_once = console, total, done, at_once
        self._begun = time.monotonic()
        self._took: list[float] = []
        self._running: dict[str, tuple[float, Path | None]] = {}
        self._folder: Path | None = None
        self._numbers = itertools.count()

    @contextlib.contextmanager
    def shown(self) -> Iterator[None]:
        """Context: on a terminal, the board is shown until the context ends."""
        if not self.console.is_terminal:
            yield
            return
        with tempfile.TemporaryDirectory(prefix="apf-", ignore_cleanup_errors=True) as folder:
            self._folder = Path(folder)
            with Live(get_renderable=self._lines, console=self.console, transient=True, refresh_per_second=2):
                yield

    def started(self, name: str) -> Path | None:
        """A run has begun. Returns the file into which the run should write its progress; None: no board is shown."""
        path = self._folder / str(next(self._numbers)) if self._folder else None
        self._running[name] = (time.monotonic(), path)
        return path

    def ended(self, name: str) -> float:
        """A run is over. Returns the seconds that it took."""
        begun, path = self._running.pop(name)
        if path:
            path.unlink(missing_ok=True)
        self._took.append(time.monotonic() - begun)
        self.done += 1
        return self._took[-1]

    def left(self) -> tuple[float, bool]:
        """Seconds until all runs are done, at least; and whether this estimate covers all runs."""
        return left_of_all(list(self._told().values()), self._took, self.total - self.done, self.at_once)

    def _told(self) -> dict[str, tuple[float, Progress | None]]:
        """Of each run that goes on, the seconds since it began, and what it tells."""
        now = time.monotonic()
        running = dict(self._running)
        return {
            name: (now - begun, ProgressFile.read(path) if path else None) for name, (begun, path) in running.items()
        }

    def _lines(self) -> RenderableType:
        told = self._told()
        fits = max(1, self.console.height - 3)
        rows = [self._row(name, gone, progress) for name, (gone, progress) in list(told.items())[:fits]]
        if len(told) > fits:
            rows.append(Text(f"and {len(told) - fits} more"))
        left, whole = left_of_all(list(told.values()), self._took, self.total - self.done, self.at_once)
        gone = time.monotonic() - self._begun
        rows.append(Text(f"{self.done} of {self.total} runs done, {times(gone, left, whole)}", style="bold"))
        return Group(*rows)

    def _row(self, name: str, gone: float, progress: Progress | None) -> Text:
        """One line: the name gives way where the terminal is narrow."""
        if progress is None:
            where = f"{clock(gone)} so far"
        else:
            where = ", ".join(filter(None, [progress.where, still(progress.left, progress.whole)]))
        row = Text(name)
        row.truncate(max(8, self.console.width - len(where) - 3), overflow="ellipsis")
        return row.append(f"  {where}")


def left_of_all(
    running: list[tuple[float, Progress | None]], took: list[float], undone: int, at_once: int
) -> tuple[float, bool]:
    """Seconds until all runs are done, at least; and whether this estimate covers all runs.

    A run that goes on may know the time that it still takes. Every other run is expected to take the mean time of the
    runs that have ended; if none has, the mean of the times that the runs that go on expect.

    Args:
        running: Of each run that goes on, the seconds since it began, and what it tells.
        took: Seconds of the runs that have ended.
        undone: How many runs go on or have not begun.
        at_once: How many go on together.
    """
    expected = [gone + told.left for gone, told in running if told and told.whole]
    known = took or expected
    typical = sum(known) / len(known) if known else 0.0
    ends = [told.left if told and told.whole else max(0.0, typical - gone) for gone, told in running]
    whole = bool(known) or undone == 0
    if not known:
        ends = [told.left if told else 0.0 for _, told in running]
    ends += [0.0] * max(0, min(at_once, undone) - len(ends))
    heapq.heapify(ends)
    last = max(ends, default=0.0)
    for _ in range(undone - len(running)):
        end = heapq.heappop(ends) + typical
        heapq.heappush(ends, end)
        last = max(last, end)
    return last, whole
