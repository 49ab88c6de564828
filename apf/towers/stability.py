"""The analytic rule: which prefixes of a tower stand (Sections Domain and Learning)."""

import numpy as np

from apf.towers.towers import Towers

CHUNK = 8192
"""Towers that are judged at once: what is computed of them then stays in the cache."""


def standing_prefixes(towers: Towers, xy: np.ndarray | None = None) -> np.ndarray:
    """[..., N, K] bool: does each prefix stand, given that those before it did?

    A tower stands if for every block i the joint centre of mass of the blocks above i lies within the contact
    patch on i (strictly: balance on an edge does not count). A prefix that holds a fallen one has fallen too.

    xy: [..., N, K, 2] positions to judge instead of the towers' own [m], e.g. noisy ones; extra leading axes
    broadcast against the towers.
    """
    xy = towers.xy if xy is None else xy
    starts = range(0, max(len(towers), 1), CHUNK)
    parts = (slice(start, start + CHUNK) for start in starts)
    return np.concatenate([_standing_prefixes(towers[part], xy[..., part, :, :]) for part in parts], axis=-2)


def _standing_prefixes(towers: Towers, xy: np.ndarray) -> np.ndarray:
    """As `standing_prefixes`, of a few thousand towers."""
    k, mass = towers.length, _by_placement(towers.mass)
    stands = np.ones((k, *xy.shape[:-2]), bool)
    for axis in range(2):
        place, half, com = (
            _by_placement(values[..., axis]) for values in (xy, towers.dims[..., :2] / 2, towers.com[..., :2])
        )
        low, high, centre = (
            [x + sign * y for x, y in zip(place, ys)] for sign, ys in ((-1, half), (1, half), (1, com))
        )
        for i in range(k - 1):
            patch_low, patch_high = np.maximum(low[i], low[i + 1]), np.minimum(high[i], high[i + 1])
            total, moment = np.zeros_like(mass[0]), np.zeros_like(centre[0])
            for top in range(i + 1, k):
                total += mass[top]
                moment += mass[top] * centre[top]
                joint = moment / total
                stands[top] &= (patch_low < joint) & (joint < patch_high)
    return np.moveaxis(np.logical_and.accumulate(stands, axis=0), 0, -1)


def _by_placement(values: np.ndarray) -> np.ndarray:
    """[..., N, K] -> [K, ..., N]: arithmetic then runs along many towers, not along a few placements."""
    return np.ascontiguousarray(np.moveaxis(values, -1, 0))


def stands(towers: Towers) -> np.ndarray:
    """[N] bool: does the whole tower stand, every prefix of it included?"""
    return standing_prefixes(towers)[:, -1]
