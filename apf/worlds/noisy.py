"""The noisy world: each block lands a little off, then the analytic rule decides."""

import numpy as np

from apf.settings import Deviation, settings
from apf.towers import Towers, standing_prefixes
from apf.worlds.base import World, labels_from


@settings
class NoisyWorld(World):
    """Placement noise on each block's absolute x and y, independent and normal."""

    noise: Deviation
    """Standard deviation [m]."""

    def execute(self, plans: Towers, rng: np.random.Generator) -> np.ndarray:
        """Labels [N, K] of the towers as they came to stand."""
        xy = plans.xy + rng.normal(0.0, self.noise, plans.xy.shape)
        return labels_from(standing_prefixes(plans, xy))
