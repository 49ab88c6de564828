"""How random packings are drawn: often close to what can be hit, so that the borders of feasibility matter."""

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from apf.packing.boxes import GRIP, ORIENTATIONS, BoxSet
from apf.packing.packings import Cell, Packings
from apf.settings import Number, from_low_to_high, settings

Share = Annotated[Number, Field(ge=0, le=1)]
Gap = Annotated[Number, Field(ge=-10, le=10)]


@settings
class Places:
    """Distribution of a random placement's x and y.

    Each axis is drawn by itself: beside a wall, beside a box that lies there, on that box, or else uniform between the
    walls. It is the same box on both axes. The first box has room for the fingers on all sides: a plan's first
    placement succeeds, and models are not asked about it.
    """

    wall: Share = 0.2
    """Probability, on each axis, of a place beside a wall."""
    beside: Share = 0.3
    """Probability, on each axis, of a place beside a box that was placed before."""
    stacked: Share = 0.3
    """Probability, on each axis, of a place on that box: at most half its side from its centre."""
    gap: Annotated[tuple[Gap, Gap], AfterValidator(from_low_to_high)] = (-0.002, 0.03)
    """Range of the gap to a wall or box [m]: below 0 they overlap, above the fingers' thickness they fit."""
    room: Annotated[Number, Field(ge=0, le=10)] = 0.01
    """Around the first box and its fingers [m], at least."""

    @model_validator(mode="after")
    def _add_up(self) -> "Places":
        total = self.wall + self.beside + self.stacked
        if total > 1 + 1e-9:
            raise ValueError(f"wall + beside + stacked is {total:g}; these shares must be at most 1 together")
        return self

    def first(self, cell: Cell, sides: np.ndarray, grip: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """[N, 2] x and y of boxes in an empty container [m].

        Args:
            cell: Container and gripper.
            sides: [N, 2] along x and y [m].
            grip: [N] the axis on which the fingers grip.
            rng: The source of all draws.
        """
        room = cell.container.half - self.reach(cell, sides, grip) - self.room
        return rng.uniform(-1.0, 1.0, room.shape) * np.maximum(room, 0.0)

    @staticmethod
    def reach(cell: Cell, sides: np.ndarray, grip: np.ndarray) -> np.ndarray:
        """[N, 2] from the centre to where box and fingers end [m].

        Args:
            cell: Container and gripper.
            sides: [N, 2] along x and y [m].
            grip: [N] the axis on which the fingers grip.
        """
        gripped = np.arange(2) == grip[:, None]
        across = np.maximum(sides, cell.gripper.width) / 2
        return np.where(gripped, sides / 2 + cell.gripper.thickness, across)

    def next(self, packings: Packings, sides: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """[N, 2] x and y of one more box with these sides [N, 2] in each packing [m].

        Args:
            packings: N packings.
            sides: [N, 2] along x and y [m].
            rng: The source of all draws.
        """
        n = len(packings)
        rows, near = np.arange(n), rng.integers(packings.length, size=n)
        centre, half = packings.xy[rows, near], packings.dims[rows, near, :2] / 2
        room = np.maximum(packings.cell.container.half - sides / 2, 0.0)
        uniform = rng.uniform(-1.0, 1.0, (n, 2))
        sign = np.where(rng.random((n, 2)) < 0.5, -1.0, 1.0)
        gap = rng.uniform(*self.gap, (n, 2))
        kind = np.searchsorted(np.cumsum([self.wall, self.beside, self.stacked]), rng.random((n, 2)), side="right")
        distance = half + sides / 2 + gap
        beside = centre + sign * distance
        beside = np.where(np.abs(beside) > room, centre - sign * distance, beside)
        xy = np.choose(kind, [sign * (room - gap), beside, centre + uniform * half, uniform * room])
        return np.where((kind > 0) & (np.abs(xy) > room), uniform * room, xy)  # where no room is: anywhere


def random_packings(
    cell: Cell, boxes: BoxSet, length: int, n: int, rng: np.random.Generator, places: Places
) -> Packings:
    """n random packings of `length` different boxes: order, orientations and places.

    Args:
        cell: Container and gripper.
        boxes: What is packed.
        length: Placements of a packing.
        n: How many.
        rng: The source of all draws.
        places: Distribution of x and y.

    Raises:
        ValueError: There are fewer than `length` boxes.
    """
    if length > len(boxes):
        raise ValueError(f"packings of {length} boxes need as many different boxes; the set has {len(boxes)}")
    packings = Packings(cell, boxes, np.empty((n, 0), np.int16), np.empty((n, 0), np.int8), np.empty((n, 0, 2)))
    for _ in range(length):
        packings = random_extensions(packings, rng, places)
    return packings


def random_extensions(packings: Packings, rng: np.random.Generator, places: Places) -> Packings:
    """Each packing with one more random placement of a box that it does not hold yet: [N, K] -> [N, K + 1].

    Args:
        packings: N packings of K boxes.
        rng: The source of all draws.
        places: Distribution of x and y.

    Raises:
        ValueError: The packings already hold every box of the set.
    """
    n, b = len(packings), len(packings.boxes)
    if packings.length >= b:
        raise ValueError(f"no box is left to extend packings of {packings.length} boxes; the set has {b}")
    box = rng.integers(b - packings.length, size=n)
    for used in np.sort(packings.box, axis=1).T:  # count only boxes that are free
        box += box >= used
    orientation = rng.integers(len(ORIENTATIONS), size=n, dtype=np.int8)
    sides = packings.boxes.dims_after(box, orientation)[:, :2]
    if packings.length:
        xy = places.next(packings, sides, rng)
    else:
        xy = places.first(packings.cell, sides, GRIP[orientation], rng)
    return Packings(
        packings.cell,
        packings.boxes,
        np.column_stack([packings.box, box.astype(np.int16)]),
        np.column_stack([packings.orientation, orientation]),
        np.concatenate([packings.xy, xy[:, None]], axis=1),
    )
