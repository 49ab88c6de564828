"""Variations of towers, for a planner that searches: each changes a little of a tower."""

import numpy as np

from apf.domain.variation import another, exchanged, step_sizes, swapped
from apf.towers.rotations import ROTATIONS
from apf.towers.towers import Towers

JOINT, ALL, ROTATION, EXCHANGE, SWAP = range(5)
"""What a variation changes: the offset of one joint, all offsets, one rotation, a block for another one, or the order
of two placements."""
SHARES = (0.35, 0.25, 0.2, 0.1, 0.1)
"""Shares of the variations that change these."""
STEPS = (0.02, 0.5)
"""Smallest and largest standard deviation of a change of offsets, in units of half the two blocks' summed sides."""


def variations(towers: Towers, rng: np.random.Generator, limit: float) -> Towers:
    """One variation of each tower, of the blocks of its set.

    Offsets are relative: where one changes, all that lies above moves along. A block is exchanged with another block of
    the tower, or with one of the set that the tower does not hold; offsets keep their proportion to the blocks' sides.

    Args:
        towers: N towers of K blocks.
        rng: The source of all draws.
        limit: Largest offset, in units of half the two blocks' summed sides.
    """
    n, k = towers.block.shape
    kind = rng.choice(len(SHARES), (n,), p=SHARES)[:, None]
    place = rng.integers(k, size=(n,))
    block = np.where(kind == EXCHANGE, exchanged(towers.block, place, len(towers.blocks), rng), towers.block)
    turned = (kind == ROTATION) & (np.arange(k) == place[:, None])
    rotation = np.where(turned, another(towers.rotation, len(ROTATIONS), rng), towers.rotation)
    order = np.where(kind == SWAP, swapped(n, k, rng), np.arange(k))
    block, rotation = (np.take_along_axis(values, order, axis=1) for values in (block, rotation))
    joint = (kind == JOINT) & (np.arange(1, k) == rng.integers(1, max(k, 2), (n, 1)))
    moved = ((kind == ALL) | joint)[..., None]
    step = step_sizes(n, STEPS, rng)[:, None, None] * rng.normal(size=(n, k - 1, 2))
    offset = relative_offsets(towers)
    offset = np.where(moved, (offset + step).clip(-limit, limit), offset)
    return _placed(towers, block, rotation, offset)


def relative_offsets(towers: Towers) -> np.ndarray:
    """[N, K - 1, 2] offset of each block from the block below, in units of half the two blocks' summed sides."""
    sides = towers.dims[..., :2]
    return np.diff(towers.xy, axis=1) / ((sides[:, :-1] + sides[:, 1:]) / 2)


def _placed(towers: Towers, block: np.ndarray, rotation: np.ndarray, offset: np.ndarray) -> Towers:
    """Towers that begin where these do, with relative offsets [N, K - 1, 2]."""
    sides = towers.blocks.dims_after(block, rotation)[..., :2]
    steps = offset * (sides[:, :-1] + sides[:, 1:]) / 2
    return Towers(towers.blocks, block, rotation, np.cumsum(np.concatenate([towers.xy[:, :1], steps], axis=1), axis=1))
