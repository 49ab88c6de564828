"""Variations of packings, for a planner that searches: each changes a little of a packing."""

from dataclasses import replace

import numpy as np

from apf.domain.variation import another, exchanged, step_sizes, swapped
from apf.packing.boxes import ORIENTATIONS
from apf.packing.packings import Packings
from apf.packing.random_packings import Places

SHIFT, ALL, MOVE, TURN, EXCHANGE, SWAP = range(6)
"""What a variation changes: the place of one box a little, all places a little, one place altogether, an orientation, a
box for another one, or the order of two placements."""
SHARES = (0.3, 0.2, 0.1, 0.15, 0.15, 0.1)
"""Shares of the variations that change these."""
STEPS = (0.01, 0.3)
"""Smallest and largest standard deviation of a small change of a place, in units of half the container's sides."""


def variations(packings: Packings, rng: np.random.Generator, places: Places) -> Packings:
    """One variation of each packing, of the boxes of its set.

    A box is exchanged with another box of the packing, or with one of the set that is not packed. What changes stays
    between the walls if it fits there. The first box has room for the fingers on all sides, as in random packings.

    Args:
        packings: N packings of K boxes.
        rng: The source of all draws.
        places: Says how much room the first box has.
    """
    n, k = packings.box.shape
    half = packings.cell.container.half
    kind = rng.choice(len(SHARES), (n,), p=SHARES)[:, None]
    place = rng.integers(k, size=(n,))
    chosen = np.arange(k) == place[:, None]
    box = np.where(kind == EXCHANGE, exchanged(packings.box, place, len(packings.boxes), rng), packings.box)
    turned = another(packings.orientation, len(ORIENTATIONS), rng)
    orientation = np.where((kind == TURN) & chosen, turned, packings.orientation)
    step = half * step_sizes(n, STEPS, rng)[:, None, None] * rng.normal(size=(n, k, 2))
    moved = ((kind == ALL) | ((kind == SHIFT) & chosen))[..., None]
    xy = np.where(moved, packings.xy + step, packings.xy)
    xy = np.where(((kind == MOVE) & chosen)[..., None], half * rng.uniform(-1.0, 1.0, (n, k, 2)), xy)
    order = np.where(kind == SWAP, swapped(n, k, rng), np.arange(k))
    box, orientation = (np.take_along_axis(values, order, axis=1) for values in (box, orientation))
    xy = np.take_along_axis(xy, order[..., None], axis=1)
    found = replace(packings, box=box, orientation=orientation, xy=xy)
    changed = (box != packings.box) | (orientation != packings.orientation) | (xy != packings.xy).any(-1)
    return replace(found, xy=np.where(changed[..., None], _between_walls(found, places), xy))


def _between_walls(packings: Packings, places: Places) -> np.ndarray:
    """[N, K, 2] the place of each box [m], moved into the room that there is for it; the middle if there is none."""
    half, sides = packings.cell.container.half, packings.dims[..., :2]
    room = half - sides / 2
    room[:, 0] = half - places.reach(packings.cell, sides[:, 0], packings.grip[:, 0]) - places.room
    room = np.maximum(room, 0.0)
    return packings.xy.clip(-room, room)
