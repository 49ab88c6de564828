"""Blocks and block sets: cuboids with their own dimensions, mass and centre of mass (Section Domain)."""

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from apf.errors import InputError
from apf.rng import stream
from apf.settings import Name, Number, Seed, Whole, settings
from apf.towers.rotations import ROTATIONS


@dataclass(frozen=True, eq=False)
class BlockSet:
    """B distinct cuboids.

    name: [B] unique strings. dims: [B, 3] sides [m]. com: [B, 3] centre of mass relative to the centre of
    geometry [m]. mass: [B] [kg]. All in the block's own frame.

    Raises InputError if a side or mass is not positive and finite, a centre of mass lies outside its block,
    or a name stands twice.
    """

    name: tuple[str, ...]
    dims: np.ndarray
    com: np.ndarray
    mass: np.ndarray

    def __post_init__(self) -> None:
        if len(self.name) == 0:
            raise InputError("a block set needs at least one block")
        for i, name in enumerate(self.name):
            if name in self.name[:i]:
                raise InputError(f"block {name}: the name stands twice; names must be unique")
            if not (np.isfinite(self.dims[i]).all() and (self.dims[i] > 0).all()):
                raise InputError(f"block {name}: dim_x, dim_y, dim_z = {_show(self.dims[i])}; sides must be > 0 [m]")
            if not (np.isfinite(self.mass[i]) and self.mass[i] > 0):
                raise InputError(f"block {name}: mass = {self.mass[i]:g}; it must be > 0 [kg]")
            if not (np.abs(self.com[i]) < self.dims[i] / 2).all():
                raise InputError(
                    f"block {name}: com_x, com_y, com_z = {_show(self.com[i])} lies outside the block; each must be "
                    f"within half a side, {_show(self.dims[i] / 2)} [m], of the centre of geometry"
                )

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

    @cached_property
    def rotated_dims(self) -> np.ndarray:
        """[B, 24, 3] sides along the world's axes after each rotation [m]."""
        return np.abs(np.einsum("rij,bj->bri", ROTATIONS, self.dims))

    @cached_property
    def rotated_com(self) -> np.ndarray:
        """[B, 24, 3] centre of mass relative to the centre of geometry after each rotation [m]."""
        return np.einsum("rij,bj->bri", ROTATIONS, self.com)


def _from_low_to_high(bounds: tuple[float, float]) -> tuple[float, float]:
    if bounds[0] > bounds[1]:
        raise ValueError(f"is {bounds[0]:g} to {bounds[1]:g}; the lower bound comes first")
    return bounds


Side = Annotated[Number, Field(ge=0.0001, le=10)]
Mass = Annotated[Number, Field(ge=0.000001, le=10_000)]


@settings
class BlockSource:
    """Where a block set comes from: a file, or the published distribution, fixed by a seed of its own."""

    blocks: Annotated[Whole, Field(ge=1, le=10000)] = 10
    """How many to draw."""
    seed: Seed = 0
    prefix: Name = "block"
    """Blocks are named prefix_00, prefix_01, ..."""
    side: Annotated[tuple[Side, Side], AfterValidator(_from_low_to_high)] = (0.05, 0.15)
    """Range of each side [m]."""
    mass: Annotated[tuple[Mass, Mass], AfterValidator(_from_low_to_high)] = (0.1, 1.0)
    """Range of the mass [kg]."""
    com_share: Annotated[Number, Field(ge=0, lt=1)] = 0.9
    """The centre of mass lies in this middle share of the block, on each axis."""
    file: Path | None = None
    """A block file (CSV or parquet) to use instead of random blocks."""

    def load(self) -> BlockSet:
        """The blocks of the file, or random ones. Raises InputError if the file is wrong."""
        if self.file is not None:
            from apf.towers.files import read_blocks

            return read_blocks(self.file)
        rng = stream(self.seed, "blocks")
        dims = rng.uniform(*self.side, (self.blocks, 3))
        mass = rng.uniform(*self.mass, self.blocks)
        com = dims * self.com_share * rng.uniform(-0.5, 0.5, (self.blocks, 3))
        return BlockSet(tuple(f"{self.prefix}_{i:02d}" for i in range(self.blocks)), dims, com, mass)


def _show(values: np.ndarray) -> str:
    return ", ".join(f"{v:g}" for v in values)
