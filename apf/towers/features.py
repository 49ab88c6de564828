"""What a network sees of each placement."""

from functools import lru_cache

import numpy as np

from apf.towers.blocks import TABLE, BlockSet, look_up
from apf.towers.towers import Towers

N_FEATURES = 10
"""Mass, centre of mass (3), sides (3), position (3)."""
N_POSITION = 3
"""The last features are the position."""
MASS, COM_X, POSITION_X = 0, 1, 7
COM, SIDES, POSITION = slice(1, 4), slice(4, 7), slice(7, 10)
MEAN_MASS = 0.55
"""[kg]"""
LENGTH = 0.1
"""Unit of all lengths [m]: one for all, since a network adds centres of mass to positions."""
MEAN_SIDE = 1
"""[`LENGTH`] what a side is less in the features."""


def features(towers: Towers) -> np.ndarray:
    """[N, K, N_FEATURES] float32: mass, centre of mass, sides and position after rotation.

    All are of about unit range: lengths in units of 10 cm, sides less 10 cm, masses less 0.55 kg doubled. Positions
    count from the bottom block: where on the table a tower stands does not matter.
    """
    n, k = towers.block.shape
    x = np.empty((n, k, N_FEATURES), np.float32)
    if len(towers.blocks) <= TABLE:
        x[..., :POSITION_X] = look_up(_own_features(towers.blocks), towers.block, towers.rotation)
    else:
        x[..., :POSITION_X] = _own(towers.mass, towers.com, towers.dims)
    x[..., 7:9] = (towers.xy - towers.xy[:, :1]) / LENGTH
    x[..., 9] = (towers.z - towers.z[:, :1]) / LENGTH
    return x


@lru_cache(maxsize=8)
def _own_features(blocks: BlockSet) -> np.ndarray:
    """[B, 24, 7] float32 of each block in each rotation: all features but its position."""
    return _own(blocks.mass[:, None], blocks.rotated_com, blocks.rotated_dims)


def _own(mass: np.ndarray, com: np.ndarray, dims: np.ndarray) -> np.ndarray:
    """[..., 7] float32 of masses that broadcast to [...] [kg], centres of mass [..., 3] and sides [..., 3] [m]."""
    own = np.empty((*com.shape[:-1], POSITION_X), np.float32)
    own[..., MASS] = (mass - MEAN_MASS) * 2
    own[..., COM] = com / LENGTH
    own[..., SIDES] = dims / LENGTH - MEAN_SIDE
    return own


def mirrored(x: np.ndarray) -> np.ndarray:
    """The features [N, K, N_FEATURES] of the same towers in a mirror: every x coordinate the other way round."""
    mirror = x.copy()
    mirror[..., [COM_X, POSITION_X]] *= -1
    return mirror


def weighed(x: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """The features [N, K, N_FEATURES] of the same towers, were the masses of their blocks these [N, K] [kg]."""
    other = x.copy()
    other[..., MASS] = (mass - MEAN_MASS) * 2
    return other


def stretched(x: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """The features [N, K, N_FEATURES] of the same towers, were all lengths along each axis so many times as long.

    Args:
        x: Features of N towers.
        factor: [N, 3] along x, y and z.
    """
    other, factor = x.copy(), factor[:, None].astype(x.dtype)
    other[..., SIDES] += MEAN_SIDE
    for part in (COM, SIDES, POSITION):
        other[..., part] *= factor
    other[..., SIDES] -= MEAN_SIDE
    return other
