"""What a mirror of a run is told."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any

from apf.settings import settings


class Phase(IntEnum):
    """What was done of a step, in the order in which it is done."""

    EXECUTED = 0
    LEARNED = 1
    EVALUATED = 2


@dataclass(frozen=True)
class Metrics:
    """What is to be shown of one phase of a step: numbers by name, and how many plans were labelled by then."""

    step: int
    phase: Phase
    plans: int
    values: Mapping[str, float]


@dataclass(frozen=True)
class RunInfo:
    """What a mirror should know of a run when it starts, or goes on.

    id: the same however often the run goes on, until a label is corrected. group: the sweep that it belongs to, or
    None. history: all that was shown of it before.
    """

    name: str
    id: str
    directory: Path
    config: dict[str, Any]
    group: str | None
    history: Sequence[Metrics]


class Tracker(ABC):
    """Shows the progress of one run. Used as a context: it ends when the run does, however that is."""

    @abstractmethod
    def start(self, run: RunInfo) -> None:
        """The run begins, or goes on."""

    def plan(self, steps: int, work: Mapping[str, int]) -> None:  # noqa: B027
        """What is to come until the last of the `steps`: how many units of each kind of work."""

    def begin(self, step: int, kind: str, number: int = 1, of: int = 1) -> None:  # noqa: B027
        """In this step, now unit `number` of `of` of a kind of work; the one before it is over.

        Args:
            step: Of the run.
            kind: The kind of work.
            number: Of the unit, from 1.
            of: How many units this step has.
        """

    @abstractmethod
    def log(self, metrics: Metrics) -> None:
        """A phase of a step is done."""

    @abstractmethod
    def finish(self, failed: bool) -> None:
        """The run ended."""


@settings
class NoTracker(Tracker):
    """Mirrors nothing."""

    def start(self, run: RunInfo) -> None:
        """As `Tracker.start`."""

    def log(self, metrics: Metrics) -> None:
        """As `Tracker.log`."""

    def finish(self, failed: bool) -> None:
        """As `Tracker.finish`."""


class Trackers(Tracker):
    """Several mirrors as one."""

    def __init__(self, trackers: Sequence[Tracker]) -> None:
        self.trackers = trackers

    def start(self, run: RunInfo) -> None:
        """Start each."""
        for tracker in self.trackers:
            tracker.start(run)

    def plan(self, steps: int, work: Mapping[str, int]) -> None:
        """Tell each."""
        for tracker in self.trackers:
            tracker.plan(steps, work)

    def begin(self, step: int, kind: str, number: int = 1, of: int = 1) -> None:
        """As `Tracker.begin`: tell each."""
        for tracker in self.trackers:
            tracker.begin(step, kind, number, of)

    def log(self, metrics: Metrics) -> None:
        """Tell each."""
        for tracker in self.trackers:
            tracker.log(metrics)

    def finish(self, failed: bool) -> None:
        """Finish each."""
        for tracker in self.trackers:
            tracker.finish(failed)
