"""Planners: a planner chooses the plan of highest expected value that it finds (Section Evaluation phase)."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from apf.domain import Domain, Predictor, Task
from apf.settings import Many, settings


@dataclass(frozen=True, eq=False)
class Problem:
    """A planning problem: random plans of the objects that are at hand, and the source of all draws of the planner."""

    candidates: Any
    rng: np.random.Generator


@dataclass(frozen=True, eq=False)
class Choice:
    """A chosen plan (a batch of one), its value V if it succeeds, and its chance P to succeed, as it was predicted.

    index: Its row among the candidates of the problem; None: it is none of them.
    """

    plan: Any
    value: float
    chance: float
    index: int | None = None

    @property
    def expected(self) -> float:
        """P x V."""
        return self.chance * self.value


@settings
class Planner(ABC):
    """Chooses plans for problems."""

    candidates: Many
    """Random plans of each problem."""

    @abstractmethod
    def choose(
        self, problems: Iterable[Problem], tasks: Mapping[str, Task], predictor: Predictor, domain: Domain
    ) -> Iterator[dict[str, Choice]]:
        """For each problem and each task, the plan of highest expected value that the planner finds.

        A planner may work on several problems side by side. It takes a problem from the iterable when it begins with
        it, so that the candidates of all problems need not be in memory at once.

        Args:
            problems: In the order of the answers.
            tasks: By their names.
            predictor: Judges plans.
            domain: Of the plans.

        Yields:
            The choice for each task, problem by problem.
        """
