"""Worlds without a robot: blocks land where the plan puts them or a little off, then the analytic rule decides."""

import numpy as np

from apf.domain import World, labels_from
from apf.settings import Deviation, settings
from apf.towers.domain import TowerDomain
from apf.towers.stability import standing_prefixes
from apf.towers.towers import Towers


@settings
class AnalyticWorld(World):
    """Blocks land exactly where the plan puts them."""

    for_domain = TowerDomain

    def execute(self, plans: Towers, rng: np.random.Generator) -> np.ndarray:
        """Labels [N, K]; draws nothing from `rng`."""
        return labels_from(standing_prefixes(plans))


@settings
class NoisyWorld(World):
    """Placement noise on each block's absolute x and y, independent and normal."""

    for_domain = TowerDomain

    noise: Deviation
    """Standard deviation [m]."""

    def execute(self, plans: Towers, rng: np.random.Generator) -> np.ndarray:
        """Labels [N, K] of the towers as they came to stand."""
        xy = plans.xy + rng.normal(0.0, self.noise, plans.xy.shape)
        return labels_from(standing_prefixes(plans, xy))
