"""The cell (container and gripper), and batches of packings of equal length."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
from pydantic import Field

from apf.packing.boxes import GRIP, BoxSet
from apf.settings import Metres, Number, settings

LEVEL = 1e-4
"""Surfaces whose heights differ by less [m] are level: a box rests on all of them."""


@settings
class Container:
    """An open container: its inner sides [m]. Coordinates begin in the middle of its floor."""

    length: Metres = 0.34
    """Along x."""
    width: Metres = 0.26
    """Along y."""
    height: Metres = 0.18
    """From the floor to the rim."""

    @cached_property
    def half(self) -> np.ndarray:
        """[2]: from the middle to the walls, along x and y [m]."""
        return np.array([self.length, self.width]) / 2


@settings
class Gripper:
    """Two open fingers, one beside each of two opposite sides of the box that they hold. All in m."""

    thickness: Metres = 0.012
    """Room that a finger takes on the axis on which they grip, counted from the side of the box."""
    width: Metres = 0.02
    """Of a finger, across that axis."""
    lift: Annotated[Number, Field(ge=0, le=10)] = 0.02
    """The fingers end so high above the bottom of the box."""


@dataclass(frozen=True)
class Cell:
    """Where boxes are packed, and with what."""

    container: Container
    gripper: Gripper


@dataclass(frozen=True, eq=False)
class Packings:
    """N packings of K placements, from the first to the last.

    cell: container and gripper. boxes: the set that `box` indexes. box: [N, K] int. orientation: [N, K] int in 0..5
    (`ORIENTATIONS`). xy: [N, K, 2] centre of the box, from the middle of the container [m]. Heights follow: each box
    rests on the highest thing below it.
    """

    cell: Cell
    boxes: BoxSet
    box: np.ndarray
    orientation: np.ndarray
    xy: np.ndarray

    def __len__(self) -> int:
        return len(self.box)

    @property
    def length(self) -> int:
        """K, the number of placements."""
        return self.box.shape[1]

    def __getitem__(self, rows: np.ndarray | slice) -> "Packings":
        """The packings of the given rows: a slice, indices [M], or a mask [N]."""
        return Packings(self.cell, self.boxes, self.box[rows], self.orientation[rows], self.xy[rows])

    def prefix(self, length: int) -> "Packings":
        """What lies there after the first `length` placements."""
        part = np.s_[:, :length]
        return Packings(self.cell, self.boxes, self.box[part], self.orientation[part], self.xy[part])

    @staticmethod
    def concatenate(parts: Sequence["Packings"]) -> "Packings":
        """All packings of the parts, in order. They must share cell, box set and length."""
        arrays = ([getattr(part, name) for part in parts] for name in ("box", "orientation", "xy"))
        return Packings(parts[0].cell, parts[0].boxes, *map(np.concatenate, arrays))

    @cached_property
    def dims(self) -> np.ndarray:
        """[N, K, 3] sides along the container's axes [m]."""
        return self.boxes.dims_after(self.box, self.orientation)

    @cached_property
    def grip(self) -> np.ndarray:
        """[N, K] the axis on which the fingers grip: 0 is x, 1 is y."""
        return GRIP[self.orientation]

    @cached_property
    def z(self) -> np.ndarray:
        """[N, K] height of the bottom of each box above the floor [m]."""
        k = self.length
        half = self.dims[..., :2] / 2
        low, high = (np.ascontiguousarray((self.xy + sign * half).transpose(1, 2, 0)) for sign in (-1, 1))
        height = np.ascontiguousarray(self.dims[..., 2].T)
        z, top = np.zeros((2, k, len(self)))
        for j in range(k):
            for i in range(j):
                np.maximum(z[j], np.where(overlap(low[i], high[i], low[j], high[j]), top[i], 0.0), out=z[j])
            top[j] = z[j] + height[j]
        return z.T


def overlap(low: np.ndarray, high: np.ndarray, other_low: np.ndarray, other_high: np.ndarray) -> np.ndarray:
    """[N] bool: do rectangles, given by two corners [2, N] each, share some area?

    Args:
        low: [2, N] corners of some rectangles.
        high: [2, N] the opposite corners.
        other_low: [2, N] corners of others.
        other_high: [2, N] the opposite corners.
    """
    return (low[0] < other_high[0]) & (other_low[0] < high[0]) & (low[1] < other_high[1]) & (other_low[1] < high[1])
