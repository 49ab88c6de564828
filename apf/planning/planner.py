"""Planners: a planner chooses the plan of highest expected value that it finds (Section Evaluation phase)."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from apf.domain import Domain, Predictor, Task
from apf.settings import Many, Number, settings

Odds = Annotated[Number, Field(gt=0, le=1000)]
"""Factor for the odds of each placement."""
Pessimism = Annotated[Number, Field(ge=0, le=100)]
"""How many standard deviations."""


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
    odds: Odds | None
    """Factor for the odds of each placement while plans are chosen; None: the predictor's own."""
    pessimism: Pessimism | None
    """Standard deviations of the members' logits that each chance is lowered by; None: as they say on average."""

    def judge(self, predictor: Predictor) -> Predictor:
        """The predictor with the odds and the pessimism that this planner plans with.

        A planner finds the plans that an ensemble is too sure of. Those are plans about which members differ.
        """
        return (predictor if self.odds is None else predictor.with_odds(self.odds)).with_pessimism(self.pessimism)

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
            predictor: Judges plans, with the odds of this planner.
            domain: Of the plans.

        Yields:
            The choice for each task, problem by problem.
        """

    def reference(
        self, standing: Any, tasks: Mapping[str, Task], domain: Domain, rng: np.random.Generator
    ) -> dict[str, float]:
        """For each task, the value of the plan that this planner finds if it knows what is feasible without noise.

        By default NaN: a planner that looks at candidates alone finds the best candidate, which is a reference already.

        Args:
            standing: The candidates of a problem that are feasible.
            tasks: By their names.
            domain: Of the plans.
            rng: The source of all draws.
        """
        return dict.fromkeys(tasks, np.nan)
