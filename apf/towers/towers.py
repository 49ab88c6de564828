"""Batches of towers of equal length, and how random ones are drawn."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np
from pydantic import Field

from apf.settings import Number, settings
from apf.towers.blocks import BlockSet
from apf.towers.rotations import TURN


@settings
class Offset:
    """Distribution of a random placement's x-y offset from the block below, in units of half the summed sides."""

    sd: Annotated[Number, Field(gt=0, le=10)] = 0.5
    """Standard deviation, before clipping."""
    limit: Annotated[Number, Field(gt=0, lt=1)] = 0.95
    """Largest offset: below 1 neighbours always touch."""

    def draw(self, sum_of_sides: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Offsets [m] for the summed sides [..., 2] of each pair of neighbours [m]."""
        relative = rng.normal(0.0, self.sd, sum_of_sides.shape).clip(-self.limit, self.limit)
        return sum_of_sides / 2 * relative


PUBLISHED_OFFSET = Offset()


@dataclass(frozen=True, eq=False)
class Towers:
    """N towers of K placements, from the bottom up.

    blocks: the set that `block` indexes. block: [N, K] int. rotation: [N, K] int in 0..23 (`ROTATIONS`).
    xy: [N, K, 2] centre of geometry in the world [m]. Heights follow: each block rests on the one below.
    """

    blocks: BlockSet
    block: np.ndarray
    rotation: np.ndarray
    xy: np.ndarray

    def __len__(self) -> int:
        return len(self.block)

    @property
    def length(self) -> int:
        """K, the number of placements."""
        return self.block.shape[1]

    def __getitem__(self, rows: np.ndarray | slice) -> "Towers":
        """The towers of the given rows: a slice, indices [M], or a mask [N]."""
        return Towers(self.blocks, self.block[rows], self.rotation[rows], self.xy[rows])

    def prefix(self, length: int) -> "Towers":
        """What stands after the first `length` placements."""
        return Towers(self.blocks, self.block[:, :length], self.rotation[:, :length], self.xy[:, :length])

    @staticmethod
    def concatenate(parts: Sequence["Towers"]) -> "Towers":
        """All towers of the parts, in order. They must share block set and length."""
        return Towers(
            parts[0].blocks,
            np.concatenate([p.block for p in parts]),
            np.concatenate([p.rotation for p in parts]),
            np.concatenate([p.xy for p in parts]),
        )

    @cached_property
    def dims(self) -> np.ndarray:
        """[N, K, 3] sides along the world's axes [m]."""
        return self.blocks.dims_after(self.block, self.rotation)

    @cached_property
    def com(self) -> np.ndarray:
        """[N, K, 3] centre of mass relative to the centre of geometry, along the world's axes [m]."""
        return self.blocks.com_after(self.block, self.rotation)

    @cached_property
    def mass(self) -> np.ndarray:
        """[N, K] [kg]."""
        return self.blocks.mass[self.block]

    @cached_property
    def z(self) -> np.ndarray:
        """[N, K] height of each centre of geometry above the table [m]."""
        height = self.dims[..., 2]
        return np.cumsum(height, axis=1) - height / 2

    def turned(self, quarters: int) -> "Towers":
        """The towers turned by `quarters` x 90 degrees about the vertical through the origin."""
        x, y = self.xy[..., 0], self.xy[..., 1]
        turned = [(x, y), (-y, x), (-x, -y), (y, -x)][quarters % 4]
        return replace(self, rotation=TURN[quarters % 4][self.rotation], xy=np.stack(turned, axis=-1))


def random_towers(
    blocks: BlockSet, length: int, n: int, rng: np.random.Generator, offset: Offset = PUBLISHED_OFFSET
) -> Towers:
    """n random towers of `length` different blocks: order, rotations and offsets drawn independently.

    Args:
        blocks: The set.
        length: Blocks of a tower.
        n: How many towers.
        rng: The source of all draws.
        offset: Distribution of x-y offsets.

    Raises:
        ValueError: The set has fewer than `length` blocks.
    """
    if length > len(blocks):
        raise ValueError(f"towers of {length} blocks need as many different blocks; the set has {len(blocks)}")
    block = _random_orders(len(blocks), length, n, rng)
    rotation = rng.integers(24, size=(n, length), dtype=np.int8)
    sides = blocks.dims_after(block, rotation)[..., :2]
    xy = np.zeros((n, length, 2))
    np.cumsum(offset.draw(sides[:, :-1] + sides[:, 1:], rng), axis=1, out=xy[:, 1:])
    return Towers(blocks, block, rotation, xy)


def random_extensions(towers: Towers, rng: np.random.Generator, offset: Offset = PUBLISHED_OFFSET) -> Towers:
    """Each tower with one more random placement of a block that it does not hold yet: [N, K] -> [N, K + 1].

    Args:
        towers: N towers of K blocks.
        rng: The source of all draws.
        offset: Distribution of x-y offsets.

    Raises:
        ValueError: The towers already hold every block of the set.
    """
    n, k, b = len(towers), towers.length, len(towers.blocks)
    if k >= b:
        raise ValueError(f"no block is left to extend towers of {k} blocks; the set has {b}")
    free = np.ones((n, b), bool)
    np.put_along_axis(free, towers.block, False, axis=1)
    rank = rng.integers(b - k, size=(n, 1))
    block = np.concatenate([towers.block, ((free.cumsum(1) <= rank).sum(1, keepdims=True)).astype(np.int16)], axis=1)
    rotation = np.concatenate([towers.rotation, rng.integers(24, size=(n, 1), dtype=np.int8)], axis=1)
    sides = towers.blocks.dims_after(block[:, -2:], rotation[:, -2:])[..., :2]
    step = offset.draw(sides[:, :-1] + sides[:, 1:], rng)
    return Towers(towers.blocks, block, rotation, np.concatenate([towers.xy, towers.xy[:, -1:] + step], axis=1))


def _random_orders(b: int, k: int, n: int, rng: np.random.Generator) -> np.ndarray:
    """[n, k] int16: the first k of a random order of b blocks (Fisher-Yates, all rows at once)."""
    order = np.tile(np.arange(b, dtype=np.int16), (n, 1))
    rows = np.arange(n)
    for i in range(k):
        j = rng.integers(i, b, size=n)
        order[rows, i], order[rows, j] = order[rows, j], order[rows, i].copy()
    return order[:, :k]
