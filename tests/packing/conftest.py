"""A cell and boxes whose numbers are exact in binary, and packings made by hand."""

from collections.abc import Callable

import numpy as np
import pytest

from apf.packing import BoxSet, Cell, Container, Gripper, PackingDomain, Packings
from apf.packing.sources import BoxSource

Placement = tuple[str, str, float, float]
"""Box, orientation, x [m], y [m]."""


@pytest.fixture(scope="session")
def cell() -> Cell:
    """A container of 1 m x 1 m x 0.5 m; fingers of 1/16 m x 1/8 m that end 1/16 m above the bottom of a box."""
    return Cell(Container(length=1, width=1, height=0.5), Gripper(thickness=1 / 16, width=1 / 8, lift=1 / 16))


@pytest.fixture(scope="session")
def boxes() -> BoxSet:
    """Cubes a to d of 1/4 m, a plate p of 1/2 x 1/4 x 1/16 m, a second one q, a stick s of 1/8 x 1/8 x 3/8 m."""
    side = [0.25, 0.25, 0.25]
    plate = [0.5, 0.25, 0.0625]
    dims = np.array([side, side, side, side, plate, plate, [0.125, 0.125, 0.375]])
    return BoxSet(tuple("abcdpqs"), dims, np.arange(1.0, 8.0))


@pytest.fixture(scope="session")
def pack(cell: Cell, boxes: BoxSet) -> Callable[..., Packings]:
    """`pack(placement, ...)`: one packing of placements (box, orientation, x, y)."""
    from apf.packing import ORIENTATIONS

    def pack(*placements: Placement) -> Packings:
        box, orientation, x, y = zip(*placements, strict=True)
        return Packings(
            cell,
            boxes,
            np.array([[boxes.name.index(name) for name in box]], np.int16),
            np.array([[ORIENTATIONS.index(name) for name in orientation]], np.int8),
            np.array([list(zip(x, y, strict=True))]),
        )

    return pack


@pytest.fixture(scope="session")
def domain() -> PackingDomain:
    """Eight training boxes and twelve others."""
    return PackingDomain(training=BoxSource(boxes=8, seed=0), evaluation=BoxSource(boxes=12, seed=1))
