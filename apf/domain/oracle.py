"""An oracle: what a predictor could know at best."""

from typing import Any

import numpy as np

from apf.domain.predictor import Predictor
from apf.domain.world import World
from apf.settings import Few, settings


@settings
class Oracle(Predictor):
    """Knows how likely a plan succeeds in a world, since it may try each plan there as often as it likes.

    What regret it leaves comes from the world's noise and from the planner alone: the floor for a learned predictor.
    """

    world: World
    """Where it tries plans."""
    tries: Few = 100
    """Of each plan."""

    random = True

    def feasibility(self, plans: Any, rng: np.random.Generator) -> np.ndarray:
        """[N] the share of tries in which each plan succeeds."""
        successes = np.zeros(len(plans))
        for _ in range(self.tries):
            successes += (self.world.execute(plans, rng) == 1).all(1)
        return successes / self.tries
