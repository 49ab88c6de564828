"""Three objectives for packings. Each asks for what is hard to pack."""

import numpy as np

from apf.domain import Task
from apf.packing.domain import PackingDomain
from apf.packing.packings import Packings
from apf.settings import settings

LITRE = 1e-3
"""[m^3]"""


@settings
class Volume(Task):
    """The volume of all boxes together [l]: large boxes leave little room for boxes and fingers."""

    for_domain = PackingDomain
    title = "Most volume"
    unit = "l"

    def value(self, plans: Packings) -> np.ndarray:
        """[N] sum of the boxes' volumes."""
        return plans.dims.prod(-1).sum(1) / LITRE


@settings
class Value(Task):
    """The values of all boxes together: the boxes that are worth most may be those that are hard to pack."""

    for_domain = PackingDomain
    title = "Most value"
    unit = ""

    def value(self, plans: Packings) -> np.ndarray:
        """[N] sum of the boxes' values."""
        return plans.boxes.value[plans.box].sum(1)


@settings
class Flat(Task):
    """How far below the rim a low and flat filling stays [m]: boxes that lie flat get into each other's way.

    The filling's height is the root mean square of the heights of the boxes' tops. Its square is that of their mean
    plus that of their standard deviation, so both what is high and what is uneven counts.
    """

    for_domain = PackingDomain
    title = "Lowest and flattest filling"
    unit = "m"

    def value(self, plans: Packings) -> np.ndarray:
        """[N] from the filling's height to the rim; 0 if it is above the rim."""
        tops = plans.z + plans.dims[..., 2]
        return np.maximum(plans.cell.container.height - np.sqrt((tops**2).mean(1)), 0.0)
