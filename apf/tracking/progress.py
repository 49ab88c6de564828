"""How far a run is and how long it still takes, learned from what was timed so far; and how a sweep hears of it."""

import contextlib
import json
import os
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

RECENT = 20
"""Number of recent units of a kind whose mean time is the estimate for the next units of this kind."""


@dataclass(frozen=True)
class Progress:
    """What a run does now, and how far it is.

    what: the kind of work, and which unit of how many. step, of: this acquisition, and how many there are. gone:
    seconds since the start of this process. left: seconds that it still takes, at least. whole: does `left` count all
    work, or is there some of a kind that was not timed yet? at: the time of day of all this [s].
    """

    what: str
    step: int
    of: int
    gone: float
    left: float
    whole: bool
    at: float

    @property
    def where(self) -> str:
        """The step and the work, in words."""
        return f"step {self.step}/{self.of}, {self.what}" if self.of else self.what

    def aged(self, now: float) -> "Progress":
        """The same, at a later time of day [s]."""
        passed = max(0.0, now - self.at)
        return Progress(
            self.what, self.step, self.of, self.gone + passed, max(0.0, self.left - passed), self.whole, now
        )


class Estimate:
    """Estimates the time that is left. Work comes in units of several kinds, each with its own recent mean time."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._begun = clock()
        self._to_come: Counter[str] = Counter()
        self._took: dict[str, deque[float]] = {}
        self._now: tuple[str, float] | None = None

    def plan(self, work: Mapping[str, int]) -> None:
        """Set the number of units of each kind that are to come."""
        self._to_come = Counter(work)

    def begin(self, kind: str) -> None:
        """One unit begins, and the one before it is over."""
        self.end()
        self._to_come[kind] = max(1, self._to_come[kind])
        self._now = (kind, self._clock())

    def end(self) -> None:
        """The unit that was begun is over."""
        if self._now is not None:
            kind, begun = self._now
            self._took.setdefault(kind, deque(maxlen=RECENT)).append(self._clock() - begun)
            self._to_come[kind] -= 1
            self._now = None

    @property
    def gone(self) -> float:
        """Seconds since the beginning."""
        return self._clock() - self._begun

    def left(self) -> tuple[float, bool]:
        """Seconds that are left for the kinds of work that have been timed; and whether these are all kinds."""
        means = {kind: sum(took) / len(took) for kind, took in self._took.items()}
        left = {kind: count * means.get(kind, 0.0) for kind, count in self._to_come.items()}
        if self._now is not None:
            kind, begun = self._now
            left[kind] -= min(means.get(kind, 0.0), self._clock() - begun)
        return sum(left.values()), all(kind in means for kind, count in self._to_come.items() if count)


class ProgressFile:
    """A small file by which a run tells the process that started it how far it is; both are on one machine."""

    VARIABLE = "APF_PROGRESS"
    """Environment variable: where the file is wanted. Without it a run writes none."""
    EVERY = 0.5
    """Seconds between two states of the same kind of work."""

    def __init__(self) -> None:
        self._path = os.environ.get(self.VARIABLE)
        self._kind = ""
        self._next = 0.0

    def write(self, kind: str, progress: Callable[[], Progress]) -> None:
        """Write the state, if a file is wanted, when another kind of work begins or the last state is old.

        A failure to write is ignored.
        """
        if self._path and (kind != self._kind or time.monotonic() >= self._next):
            self._kind = kind
            self._next = time.monotonic() + self.EVERY
            half = Path(f"{self._path}.part")
            with contextlib.suppress(OSError):
                half.write_text(json.dumps(asdict(progress())))
                half.replace(self._path)

    @staticmethod
    def read(path: Path) -> Progress | None:
        """The last state, as old as it is now; None if there is none yet."""
        try:
            return Progress(**json.loads(path.read_text())).aged(time.time())
        except (OSError, ValueError, TypeError):
            return None


def clock(seconds: float) -> str:
    """1:02:03, or 2:03 below an hour."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def still(left: float, whole: bool) -> str:
    """The time that is left [s], in words; empty if it is unknown."""
    if whole:
        return f"about {clock(left)} left"
    return f"more than {clock(left)} left" if left >= 1 else ""


def times(gone: float, left: float, whole: bool) -> str:
    """The time so far and the time that is left, in words.

    Args:
        gone: Seconds so far.
        left: Seconds that are still to come, as far as is known.
        whole: Does `left` count all work that is to come?
    """
    return ", ".join(filter(None, [f"{clock(gone)} so far", still(left, whole)]))
