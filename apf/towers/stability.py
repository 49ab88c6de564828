"""The analytic rule: which prefixes of a tower stand (Sections Domain and Learning)."""

import numpy as np

from apf.towers.towers import Towers


def standing_prefixes(towers: Towers, xy: np.ndarray | None = None) -> np.ndarray:
    """[..., N, K] bool: does each prefix stand, given that those before it did?

    A tower stands if for every block i the joint centre of mass of the blocks above i lies within the contact
    patch on i (strictly: balance on an edge does not count). A prefix that holds a fallen one has fallen too.

    xy: [..., N, K, 2] positions to judge instead of the towers' own [m], e.g. noisy ones; extra leading axes
    broadcast against the towers.
    """
    xy = towers.xy if xy is None else xy
    half = towers.dims[..., :2] / 2
    weight = towers.mass[..., None]
    total = np.cumsum(weight, axis=-2)
    moment = np.cumsum(weight * (xy + towers.com[..., :2]), axis=-2)
    low, high = xy - half, xy + half
    stands = np.ones(xy.shape[:-1], bool)
    for i in range(towers.length - 1):
        above = slice(i + 1, None)
        joint = (moment[..., above, :] - moment[..., i : i + 1, :]) / (total[..., above, :] - total[..., i : i + 1, :])
        patch_low = np.maximum(low[..., i, :], low[..., i + 1, :])[..., None, :]
        patch_high = np.minimum(high[..., i, :], high[..., i + 1, :])[..., None, :]
        stands[..., above] &= ((patch_low < joint) & (joint < patch_high)).all(-1)
    return np.logical_and.accumulate(stands, axis=-1)


def stands(towers: Towers) -> np.ndarray:
    """[N] bool: does the whole tower stand, every prefix of it included?"""
    return standing_prefixes(towers)[:, -1]
