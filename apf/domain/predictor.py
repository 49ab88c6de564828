"""Predictors: a planner asks one for P(feasible). A predictor is a learned model, or one that knows the physics."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar, Self

import numpy as np

from apf.domain.domain import Domain


class Predictor(ABC):
    """Judges plans: gives P(feasible) for each plan of a batch."""

    for_domain: ClassVar[type[Domain] | None] = None
    """The domain whose plans the predictor can judge; None: any domain."""

    by_prefix: bool = False
    """Is P(feasible) of a plan the product of `last_feasibility` over its prefixes? Then a planner can drop a plan
    because of one prefix."""

    random: bool = False
    """Does the predictor draw from `rng`? Then the same plan may get another P each time, and a planner asks once."""

    members: int = 1
    """Number of members, e.g. networks, over which P(feasible) is a mean; with `by_prefix`, each factor of P is. With
    several members a planner can ask some of them, by `last_feasibility`, and drop a plan before it asks the others, if
    `mean_of_members` says so."""

    mean_of_members: bool = True
    """Is what the members say together their mean? If not, a planner asks all of them at once."""

    together: bool = False
    """Does the predictor judge many plans about as fast as a few? Then a planner asks about all plans at once."""

    @abstractmethod
    def feasibility(self, plans: Any, rng: np.random.Generator) -> np.ndarray:
        """[N] probability that each plan succeeds."""

    def last_feasibility(self, plans: Any, members: slice = slice(None)) -> np.ndarray:
        """[N] mean over these members of the probability that the last placement succeeds.

        With `by_prefix` this probability is conditional: all placements before the last one succeeded. Without
        `by_prefix` the probability is that of the whole plan. A planner calls this method if `by_prefix` is set, or if
        there are several members.
        """
        raise TypeError(f"{type(self).__name__} judges whole plans only")

    def with_odds(self, odds: float) -> Self:
        """This predictor with another factor for the odds of each placement.

        By default the predictor itself: the factor changes no probability of 0 or 1.
        """
        return self

    def with_pessimism(self, pessimism: float | None) -> Self:
        """This predictor, made to doubt where its members differ.

        By default the predictor itself: one that has no members is sure.

        Args:
            pessimism: Each probability is that whose logit is the mean of the members' logits less so many standard
                deviations over the members. None: the mean of the members' probabilities.
        """
        return self

    def prefix_feasibility(self, plans: Any, rng: np.random.Generator) -> np.ndarray:
        """[N, K] probability that each prefix of each plan succeeds. A single placement always does.

        Args:
            plans: N plans of K placements.
            rng: The source of all draws.
        """
        chances = np.ones((len(plans), plans.length))
        for length in range(2, plans.length + 1):
            prefix = plans.prefix(length)
            if self.by_prefix:
                chances[:, length - 1] = chances[:, length - 2] * self.last_feasibility(prefix)
            else:
                chances[:, length - 1] = self.feasibility(prefix, rng)
        return chances

    def prefix_deviation(self, plans: Any) -> np.ndarray:
        """[N, K] standard deviation, over members, of the chance that each gives each prefix; NaN: there are none."""
        return np.full((len(plans), plans.length), np.nan)
