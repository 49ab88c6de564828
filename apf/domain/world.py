"""Worlds: a world carries out plans and says which prefixes succeeded (the paper's detailedPlanEx)."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from apf.domain.domain import Domain
from apf.domain.plans import UNOBSERVED
from apf.errors import InputError, Stopped
from apf.interrupts import TimeLimitError, time_limit


@dataclass(frozen=True, eq=False)
class Outcome:
    """The result of one plan: its labels [K], and the world's report.

    report: what the world measured, and its state after the plan, as JSON can hold it. None: the world reports nothing.
    """

    labels: np.ndarray
    report: dict[str, Any] | None = None


class World(ABC):
    """Where plans are executed."""

    for_domain: ClassVar[type[Domain] | None] = None
    """The domain whose plans the world can execute; None: any domain."""

    @abstractmethod
    def execute(self, plans: Any, rng: np.random.Generator) -> np.ndarray:
        """Carry out N plans of K placements.

        Returns:
            [N, K] int8 labels of the prefixes: 1 succeeded, 0 failed, -1 not attempted.
        """

    def attempt(self, plan: Any, rng: np.random.Generator, before: Mapping[str, Any] | None = None) -> Outcome:
        """Carry out one plan.

        Args:
            plan: A batch of one plan.
            rng: The source of all draws.
            before: The report of the plan before this one. A world that keeps a state from plan to plan starts from
                this report alone, so that a run that goes on later starts from the same state.
        """
        labels = np.asarray(self.execute(plan, rng))
        return Outcome(labels[0] if len(labels) == 1 else labels)

    def summary(self, reports: Sequence[Mapping[str, Any]]) -> dict[str, float]:
        """Metrics by name, for the curves of a run, computed from this world's reports of some plans."""
        return {}

    def table(self, reports: Mapping[int, Mapping[str, Any]]) -> pd.DataFrame | None:
        """This world's reports, by the numbers of the plans, as a table; None: the world reports nothing."""
        return None

    @property
    def initial_world(self) -> "World":
        """Where an experiment in this world labels the plans that it starts from."""
        return self

    def check(self, domain: Any, length: int, evaluation: bool = False) -> None:  # noqa: B027
        """Raises InputError if not all plans of up to `length` placements can be tried here.

        Args:
            domain: Of the plans.
            length: The largest number of placements.
            evaluation: Are the plans made of the objects of the evaluation, or of those of the experiment?
        """

    def log_to(self, path: Path | None) -> None:  # noqa: B027
        """Say where a log of the plans that follow may be written; by default a world writes none.

        Args:
            path: Of the log's file, without an ending; an earlier one that is there is replaced. None: nowhere.
        """

    def close(self) -> None:  # noqa: B027
        """Release the world's resources, e.g. a simulator."""


def carry_out(
    world: World,
    plan: Any,
    rng: np.random.Generator,
    limit: float | None,
    what: str,
    before: Mapping[str, Any] | None = None,
    log: Path | None = None,
) -> Outcome:
    """Carry out one plan in a world, and check the labels that come back.

    Args:
        world: Where.
        plan: A batch of one plan.
        rng: The source of all draws.
        limit: Seconds that the plan may take; None: as long as it likes.
        what: How messages call the plan.
        before: The report of the plan before this one, as in `World.attempt`.
        log: Where the world may log what happens, as in `World.log_to`.

    Raises:
        Stopped: The world failed, took longer than `limit`, or returned no valid labels; the message names `what`.
    """
    world.log_to(log)
    try:
        with time_limit(limit):
            outcome = world.attempt(plan, rng, before)
    except TimeLimitError:
        raise Stopped(f"world: {what} took longer than execution.time_limit={limit:g} s") from None
    except (InputError, Stopped) as error:
        raise Stopped(f"world: {what}: {error}") from error
    except Exception as error:
        reason = next(iter(str(error).splitlines()), "")
        raise Stopped(f"world: {what} failed: {type(error).__name__}: {reason}") from error
    labels = np.asarray(outcome.labels)
    if labels.shape != (plan.length,) or not are_labels(labels):
        raise Stopped(f"world: {what} got {labels.tolist()}; labels [{plan.length}] are 1, ..., 0, -1, ...")
    return outcome


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
