"""Boxes and box sets: cuboids of uniform density, each with a value."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from apf.errors import InputError

ORIENTATIONS = ("z0", "z90", "x0", "x90", "y0", "y90")
"""The box's axis that is vertical, and the quarter turn about it [deg]."""
ALONG = np.array([[0, 1, 2], [1, 0, 2], [1, 2, 0], [2, 1, 0], [2, 0, 1], [0, 2, 1]])
"""[6, 3]: the box's axis that lies along each axis of the container in each of `ORIENTATIONS`."""
GRIP = np.array([0, 1, 0, 1, 0, 1])
"""[6]: the container's axis, x or y, on which the fingers grip: it turns with the box."""
SIDES = (1e-3, 10.0)
"""Sides of a box [m]."""
VALUES = (0.0, 1e9)
"""Values of a box."""


@dataclass(frozen=True, eq=False)
class BoxSet:
    """B distinct boxes.

    name: [B] unique strings. dims: [B, 3] sides [m]. value: [B] what it is worth to have the box packed.

    Raises InputError for a side or a value that is not possible, and for a name that stands twice or cannot be printed.
    """

    name: tuple[str, ...]
    dims: np.ndarray
    value: np.ndarray

    def __post_init__(self) -> None:
        if not self.name:
            raise InputError("a box set needs at least one box")
        if fault := first_fault(self.name, self.dims, self.value):
            raise InputError(fault[1])

    def __len__(self) -> int:
        return len(self.name)

    def equals(self, other: "BoxSet") -> bool:
        """The same names and, bit for bit, the same numbers?"""
        return (
            self.name == other.name
            and np.array_equal(self.dims, other.dims)
            and np.array_equal(self.value, other.value)
        )

    @property
    def digest(self) -> str:
        """Sixteen hexadecimal digits of the names and, bit for bit, the numbers."""
        numbers = np.column_stack([self.dims, self.value]).astype("<f8").tobytes()
        return hashlib.sha256(json.dumps(self.name).encode() + b"\0" + numbers).hexdigest()[:16]

    def subset(self, which: np.ndarray) -> "BoxSet":
        """The boxes of the given indices [M]."""
        return BoxSet(tuple(self.name[i] for i in which), self.dims[which], self.value[which])

    def dims_after(self, box: np.ndarray, orientation: np.ndarray) -> np.ndarray:
        """[..., 3] sides along the container's axes of boxes [...] in orientations [...] [m]."""
        return self._turned.take(box.astype(np.intp) * len(ORIENTATIONS) + orientation, axis=0)

    @cached_property
    def _turned(self) -> np.ndarray:
        """[B x 6, 3] sides along the container's axes in each orientation [m]."""
        return self.dims[:, ALONG].reshape(-1, 3)


def first_fault(names: Sequence[str], dims: np.ndarray, value: np.ndarray) -> tuple[int, str] | None:
    """The first of B boxes that is impossible, and what is wrong with it; None if all are possible.

    Args:
        names: [B] as `BoxSet` has them, and so the others.
        dims: [B, 3] sides [m].
        value: [B].
    """
    seen: set[str] = set()
    for i, name in enumerate(names):
        if not ((dims[i] >= SIDES[0]) & (dims[i] <= SIDES[1])).all():
            sides = ", ".join(f"{side:g}" for side in dims[i])
            unit = "; write a unit in the header, as in dim_x [mm]" if (dims[i] > SIDES[1]).any() else ""
            return (
                i,
                f"box {name}: dim_x, dim_y, dim_z = {sides}; sides must be {SIDES[0]:g} to {SIDES[1]:g} [m]{unit}",
            )
        if not VALUES[0] <= value[i] <= VALUES[1]:
            return i, f"box {name}: value = {value[i]:g}; it must be {VALUES[0]:g} to {VALUES[1]:g}"
        if not name or name.strip() != name or not name.isprintable():
            return i, f"box {name!a}: names must be printable, and not begin or end with blanks"
        if name in seen:
            return i, f"box {name}: the name stands twice; names must be unique"
        seen.add(name)
    return None
