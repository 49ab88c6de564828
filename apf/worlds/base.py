"""What the experiment asks of a world: carry out plans, say which prefixes stood (detailedPlanEx)."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from apf.data import UNOBSERVED
from apf.errors import Stopped
from apf.interrupts import TimeLimitError, time_limit


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of one plan: its labels [K], and what the world measured and how it was left, as JSON can hold it."""

    labels: np.ndarray
    report: dict[str, Any] | None = None


class World(ABC):
    """Where plans are executed."""

    @abstractmethod
    def execute(self, plans: Any, rng: np.random.Generator) -> np.ndarray:
        """Carry out N plans of K placements. Returns labels [N, K] int8: 1 stood, 0 fell, -1 not attempted."""

    def attempt(self, plan: Any, rng: np.random.Generator, before: Mapping[str, Any] | None = None) -> Outcome:
        """Carry out one plan (N = 1). `before`: the report of the one before it; a world that is left in some state
        starts from what it says, and from nothing else, so that a run that goes on later finds what it left."""
        return Outcome(np.asarray(self.execute(plan, rng)))

    @property
    def initial_world(self) -> "World":
        """Where an experiment in this world labels the plans that it starts from."""
        return self

    def check(self, blocks: Any, height: float) -> None:  # noqa: B027
        """Raises InputError if plans with these blocks, at most so high [m], cannot be carried out here."""

    def close(self) -> None:  # noqa: B027
        """Give back what the world holds, if it holds anything."""


def carry_out(world: World, plan: Any, rng: np.random.Generator, limit: float | None, what: str) -> np.ndarray:
    """The labels [K] of one plan (N = 1), which may take `limit` seconds.

    Raises Stopped, saying `what` was tried, if the world fails, takes longer, or answers no labels.
    """
    try:
        with time_limit(limit):
            labels = np.asarray(world.execute(plan, rng))
    except TimeLimitError:
        raise Stopped(f"world: {what} took longer than execution.time_limit={limit:g} s") from None
    except Exception as error:
        reason = next(iter(str(error).splitlines()), "")
        raise Stopped(f"world: {what} failed: {type(error).__name__}: {reason}") from error
    if labels.shape != (1, plan.length) or not are_labels(labels[0]):
        raise Stopped(f"world: {what} got {labels.tolist()}; labels [1, {plan.length}] are 1, ..., 0, -1, ...")
    return labels[0]


def are_labels(labels: np.ndarray) -> bool:
    """Are these the labels [K] of prefixes: some that stood, one that fell unless all did, the rest unobserved?"""
    return bool(np.isin(labels, (0, 1, UNOBSERVED)).all() and (labels_from(labels[None] == 1)[0] == labels).all())


def labels_from(stood: np.ndarray) -> np.ndarray:
    """Labels [N, K] of prefixes that stood [N, K] bool: everything after the first fall is unobserved."""
    labels = np.full(stood.shape, UNOBSERVED, np.int8)
    standing = np.ones(len(stood), bool)
    for prefix in range(stood.shape[1]):
        labels[standing, prefix] = stood[standing, prefix]
        standing &= stood[:, prefix]
    return labels
