"""What a planner asks for the chance of success: a learned model, or one that knows the physics."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np


class Predictor(ABC):
    """Anything that answers P(feasible) of a batch of plans."""

    by_prefix: bool = False
    """Is P the product of `last_feasibility` over prefixes? Then a planner can drop a plan for a prefix of it."""

    random: bool = False
    """Does it draw from `rng`? Then asking twice may give two answers, and a planner asks once."""

    @abstractmethod
    def feasibility(self, plans: Any, rng: np.random.Generator) -> np.ndarray:
        """[N] probability that each plan succeeds."""

    def last_feasibility(self, plans: Any) -> np.ndarray:
        """[N] probability that the last placement succeeds, given that those before it did; if `by_prefix`."""
        raise TypeError(f"{type(self).__name__} judges whole plans only")
