"""Trackers: a tracker mirrors a run, on the terminal or at Weights & Biases."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Any

from apf.settings import settings


class Phase(IntEnum):
    """The phases of a step, in their order."""

    EXECUTED = 0
    LEARNED = 1
    EVALUATED = 2


@dataclass(frozen=True)
class Metrics:
    """Metrics of one phase of a step, by name; plans: the number of labelled plans by then."""

    step: int
    phase: Phase
    plans: int
    values: Mapping[str, float]


@dataclass(frozen=True)
class RunInfo:
    """A run, as a tracker is told of it when the run starts or is resumed.

    id: stays the same when the run is resumed; a corrected label changes it. group: the sweep that the run belongs to,
    or None. history: all earlier metrics of the run. choices: the chosen option of each config group, as words. about:
    commit, host, CPU and GPU that the run began with.
    """

    name: str
    id: str
    directory: Path
    config: dict[str, Any]
    group: str | None
    history: Sequence[Metrics]
    choices: Mapping[str, str] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class RunFiles:
    """What a finished run leaves behind, as a tracker is told of it.

    plans: the number of labelled plans. tables, weights: the run's own files, the weights of the last step alone.
    pictures: draws them, and returns the files, by a title of each.
    """

    plans: int
    tables: Sequence[Path]
    weights: Sequence[Path]
    pictures: Callable[[], Mapping[str, Path]]


class Tracker(ABC):
    """Shows the progress of one run."""

    @abstractmethod
    def start(self, run: RunInfo) -> None:
        """The run starts, or is resumed."""

    def plan(self, steps: int, work: Mapping[str, int]) -> None:  # noqa: B027
        """Announce the work until the last of the `steps`: the number of units of each kind."""

    def begin(self, step: int, kind: str, number: int = 1, of: int = 1) -> None:  # noqa: B027
        """A unit of work begins; the unit before it is over.

        Args:
            step: The current step of the run.
            kind: The kind of work.
            number: The unit's number in this step, from 1.
            of: The number of units of this kind in this step.
        """

    @abstractmethod
    def log(self, metrics: Metrics) -> None:
        """A phase of a step is done."""

    def keep(self, files: RunFiles) -> None:  # noqa: B027
        """The run has finished, and its files are complete."""

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

    def keep(self, files: RunFiles) -> None:
        """Tell each."""
        for tracker in self.trackers:
            tracker.keep(files)

    def finish(self, failed: bool) -> None:
        """Finish each."""
        for tracker in self.trackers:
            tracker.finish(failed)
