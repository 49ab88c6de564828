"""Worlds: boxes come down where the plan puts them or a little off, then the rule decides."""

import numpy as np

from apf.domain import World, labels_from
from apf.packing.domain import PackingDomain
from apf.packing.packings import Packings
from apf.packing.rule import packed_prefixes
from apf.settings import Deviation, settings


@settings
class AnalyticWorld(World):
    """Boxes come down exactly where the plan puts them."""

    for_domain = PackingDomain

    def execute(self, plans: Packings, rng: np.random.Generator) -> np.ndarray:
        """Labels [N, K]; draws nothing from `rng`."""
        return labels_from(packed_prefixes(plans))


@settings
class NoisyWorld(World):
    """The gripper is a little off: independent normal noise on each box's x and y, on the way down and up."""

    for_domain = PackingDomain

    noise: Deviation
    """Standard deviation [m]."""

    def execute(self, plans: Packings, rng: np.random.Generator) -> np.ndarray:
        """Labels [N, K] of the boxes as they came down."""
        return labels_from(packed_prefixes(plans, plans.xy + rng.normal(0.0, self.noise, plans.xy.shape)))
