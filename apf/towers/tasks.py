"""The paper's three objectives for towers (Section Domain)."""

import numpy as np

from apf.domain import Task
from apf.settings import settings
from apf.towers.domain import TowerDomain
from apf.towers.towers import Towers


@settings
class Tallest(Task):
    """The height of the tower [m]."""

    for_domain = TowerDomain
    title = "Tallest tower"
    unit = "m"

    def value(self, plans: Towers) -> np.ndarray:
        """[N] sum of the blocks' heights."""
        return plans.dims[..., 2].sum(1)


@settings
class Overhang(Task):
    """From the bottom block's centre of geometry to the furthest vertical side of the top block [m]."""

    for_domain = TowerDomain
    title = "Longest overhang"
    unit = "m"

    def value(self, plans: Towers) -> np.ndarray:
        """[N] the distance to the plane of that side, along x or y."""
        reach = np.abs(plans.xy[:, -1] - plans.xy[:, 0]) + plans.dims[:, -1, :2] / 2
        return np.maximum(reach[:, 0], reach[:, 1])


@settings
class Unsupported(Task):
    """How much of each block's underside is not on the block below, summed [m^2]."""

    for_domain = TowerDomain
    title = "Maximum unsupported area"
    unit = "m²"

    def value(self, plans: Towers) -> np.ndarray:
        """[N] total unsupported area; the bottom block stands on the table and adds nothing."""
        half = plans.dims[..., :2] / 2
        low, high = plans.xy - half, plans.xy + half
        overlap = np.minimum(high[:, 1:], high[:, :-1]) - np.maximum(low[:, 1:], low[:, :-1])
        return (_area(plans.dims[:, 1:]) - _area(np.maximum(overlap, 0))).sum(1)


def _area(sides: np.ndarray) -> np.ndarray:
    """[..., 2 or more] -> [...] of the horizontal rectangle with these sides; `prod` over so few takes far longer."""
    return sides[..., 0] * sides[..., 1]
