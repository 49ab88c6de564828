"""What a planner asks for the chance of success: a learned model, or one that knows the physics."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np

from apf.domain.domain import Domain


class Predictor(ABC):
    """Anything that answers P(feasible) of a batch of plans."""

    for_domain: ClassVar[type[Domain] | None] = None
    """Whose plans it judges; None: any domain's."""

    by_prefix: bool = False
    """Is P the product of `last_feasibility` over prefixes? Then a planner can drop a plan because of one prefix."""

    random: bool = False
    """Does the predictor draw from `rng`? Then two questions may have two answers, and a planner asks once."""

    members: int = 1
    """P, or each of its factors, is the mean over so many members. A planner can then drop a plan after it has asked
    some of the members, by `last_feasibility`."""

    together: bool = False
    """Do many plans take about as long as a few? Then a planner asks about all plans at once."""

    @abstractmethod
    def feasibility(self, plans: Any, rng: np.random.Generator) -> np.ndarray:
        """[N] probability that each plan succeeds."""

    def last_feasibility(self, plans: Any, members: slice = slice(None)) -> np.ndarray:
        """[N] mean over these members of the probability that the last placement succeeds.

        With `by_prefix` this is the probability given that all placements before the last one succeeded, else that of
        the whole plan. A planner asks for it if `by_prefix`, or if there are several members.
        """
        raise TypeError(f"{type(self).__name__} judges whole plans only")
