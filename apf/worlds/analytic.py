"""The noiseless world: a tower stands if the analytic rule says so."""

import numpy as np

from apf.settings import settings
from apf.towers import Towers, standing_prefixes
from apf.worlds.base import World, labels_from


@settings
class AnalyticWorld(World):
    """Blocks land exactly where the plan puts them."""

    def execute(self, plans: Towers, rng: np.random.Generator) -> np.ndarray:
        """Labels [N, K]; draws nothing from `rng`."""
        return labels_from(standing_prefixes(plans))
