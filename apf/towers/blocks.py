"""Blocks and block sets: cuboids with their own dimensions, mass and centre of mass (Section Domain)."""

import hashlib
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from apf.errors import InputError
from apf.towers.rotations import AXES, ROTATIONS, SIGNS

SIDES = (1e-6, 1e6)
"""Sides that can be computed with [m]: differences of positions keep a few digits, and products do not overflow."""
MASSES = (1e-9, 1e9)
"""Masses that can be computed with [kg]."""
MOST = 32_767
"""Blocks that random towers are drawn from are numbered by int16."""
TABLE = 4096
"""Sets of up to so many blocks keep a table of all their rotations."""
_UNREADABLE = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]|^\s|\s$|^$")


@dataclass(frozen=True, eq=False)
class BlockSet:
    """B distinct cuboids.

    name: [B] unique strings. dims: [B, 3] sides [m]. com: [B, 3] centre of mass relative to the centre of
    geometry [m]. mass: [B] [kg]. All in the block's own frame.

    Raises InputError if a side or mass is not positive, finite and within what can be computed with (`SIDES`,
    `MASSES`), a centre of mass lies outside its block, a name stands twice, or one could not be read back from a file.
    """

    name: tuple[str, ...]
    dims: np.ndarray
    com: np.ndarray
    mass: np.ndarray

    def __post_init__(self) -> None:
        if len(self.name) == 0:
            raise InputError("a block set needs at least one block")
        fault = first_fault(self.name, self.dims, self.com, self.mass)
        if fault:
            raise InputError(fault[1])

    def __len__(self) -> int:
        return len(self.name)

    def equals(self, other: "BlockSet") -> bool:
        """The same names and, bit for bit, the same numbers?"""
        mine, theirs = ((b.dims, b.com, b.mass) for b in (self, other))
        return self.name == other.name and all(map(np.array_equal, mine, theirs))

    @property
    def digest(self) -> str:
        """Sixteen hexadecimal digits of the names and, bit for bit, the numbers."""
        numbers = (np.asarray(a, "<f8").tobytes() for a in (self.dims, self.com, self.mass))
        return hashlib.sha256(b"\0".join((json.dumps(self.name).encode(), *numbers))).hexdigest()[:16]

    def subset(self, which: np.ndarray) -> "BlockSet":
        """The blocks of the given indices [M]."""
        return BlockSet(tuple(self.name[i] for i in which), self.dims[which], self.com[which], self.mass[which])

    def dims_after(self, block: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """[..., 3] sides along the world's axes of blocks [...] after rotations [...] [m]."""
        if len(self) <= TABLE:
            return look_up(self.rotated_dims, block, rotation)
        return np.take_along_axis(self.dims[block], AXES[rotation], -1)

    def com_after(self, block: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """[..., 3] centre of mass of blocks [...] after rotations [...], relative to the centre of geometry [m]."""
        if len(self) <= TABLE:
            return look_up(self.rotated_com, block, rotation)
        return SIGNS[rotation] * np.take_along_axis(self.com[block], AXES[rotation], -1) + 0.0

    @cached_property
    def rotated_dims(self) -> np.ndarray:
        """[B, 24, 3] sides along the world's axes after each rotation [m]."""
        return np.abs(np.einsum("rij,bj->bri", ROTATIONS, self.dims))

    @cached_property
    def rotated_com(self) -> np.ndarray:
        """[B, 24, 3] centre of mass relative to the centre of geometry after each rotation [m]."""
        return np.einsum("rij,bj->bri", ROTATIONS, self.com)


def look_up(table: np.ndarray, block: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """[..., M] the rows of a table [B, 24, M] for blocks [...] after rotations [...].

    Args:
        table: [B, 24, M].
        block: [...] rows of the first axis.
        rotation: [...] rows of the second axis.
    """
    rows = table.reshape(-1, table.shape[-1])
    return rows.take(block.astype(np.intp) * len(ROTATIONS) + rotation, axis=0)


def first_fault(names: Sequence[str], dims: np.ndarray, com: np.ndarray, mass: np.ndarray) -> tuple[int, str] | None:
    """The first of B blocks that is impossible, and what is wrong with it; None if all are possible.

    Args:
        names: [B] as `BlockSet` has them, and so the others.
        dims: [B, 3] sides [m].
        com: [B, 3] centre of mass relative to the centre of geometry [m].
        mass: [B] [kg].
    """
    good = ((dims >= SIDES[0]) & (dims <= SIDES[1])).all(1) & (mass >= MASSES[0]) & (mass <= MASSES[1])
    good &= (np.abs(com) < dims / 2).all(1)
    bad = [int(np.argmin(good))] if not good.all() else []
    bad += [i for i, name in enumerate(names) if _UNREADABLE.search(name)][:1]
    if len(set(names)) < len(names):
        seen: set[str] = set()
        bad.append(next(i for i, name in enumerate(names) if name in seen or seen.add(name)))  # type: ignore[func-returns-value]
    if not bad:
        return None
    i = min(bad)
    return i, f"block {_fault(names[i], dims[i], com[i], float(mass[i])) or _fault_of_name(names[i])}"


def _fault(name: str, dims: np.ndarray, com: np.ndarray, mass: float) -> str | None:
    """The name of a block, and the fault in its numbers; None: no fault."""
    sides = f"{name}: dim_x, dim_y, dim_z = {_show(dims)}"
    if not (np.isfinite(dims).all() and (dims > 0).all()):
        return f"{sides}; sides must be > 0 [m]"
    if (dims < SIDES[0]).any() or (dims > SIDES[1]).any():
        return f"{sides}; sides must be {SIDES[0]:g} to {SIDES[1]:g} [m]"
    if not (np.isfinite(mass) and mass > 0):
        return f"{name}: mass = {mass:g}; it must be > 0 [kg]"
    if not MASSES[0] <= mass <= MASSES[1]:
        return f"{name}: mass = {mass:g}; it must be {MASSES[0]:g} to {MASSES[1]:g} [kg]"
    if not (np.abs(com) < dims / 2).all():
        return (
            f"{name}: com_x, com_y, com_z = {_show(com)} lies outside the block; each must be "
            f"within half a side, {_show(dims / 2)} [m], of the centre of geometry"
        )
    return None


def _fault_of_name(name: str) -> str:
    if _UNREADABLE.search(name):
        return f"{name!a}: names must not be empty, begin or end with blanks, or hold control characters"
    return f"{name}: the name stands twice; names must be unique"


def _show(values: np.ndarray) -> str:
    return ", ".join(f"{v:g}" for v in values)
