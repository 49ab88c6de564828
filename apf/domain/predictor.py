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
    """Is P the product of `last_feasibility` over prefixes? Then a planner can drop a plan for a prefix of it."""

    random: bool = False
    """Does it draw from `rng`? Then asking twice may give two answers, and a planner asks once."""

    members: int = 1
    """Is P, or each factor of it, the mean of what so many members say? Then a planner can drop a plan once some of
    them were asked, by `last_feasibility`."""

    together: bool = False
    """Does it answer about many plans in about the time of a few? Then a planner asks about all of them at once."""

    @abstractmethod
    def feasibility(self, plans: Any, rng: np.random.Generator) -> np.ndarray:
        """[N] probability that each plan succeeds."""

    def last_feasibility(self, plans: Any, members: slice = slice(None)) -> np.ndarray:
        """[N] mean over these members of the probability that the last placement succeeds, given that those before
        it did; or that the whole plan does, unless `by_prefix`. Asked if `by_prefix`, or if there are more members.
        """
        raise TypeError(f"{type(self).__name__} judges whole plans only")
