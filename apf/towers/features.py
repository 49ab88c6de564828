"""What a network sees of each placement."""

from enum import StrEnum
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


class PositionOf(StrEnum):
    """Where the position in the features of a block counts from."""

    BOTTOM = "bottom"
    """The bottom block. Graph networks see differences of positions alone."""
    BELOW = "below"
    """The block below, as the parameter r of an action does (Section Domain); the bottom block's is on the table."""
    WORLD = "world"
    """The origin of the world, on the table."""


def features(towers: Towers, position_of: PositionOf = PositionOf.BOTTOM) -> np.ndarray:
    """[N, K, N_FEATURES] float32: mass, centre of mass, sides and position after rotation.

    All are of about unit range: lengths in units of 10 cm, sides less 10 cm, masses less 0.55 kg doubled. Positions
    from the bottom block do not tell where on the table a tower stands.

    Args:
        towers: N towers.
        position_of: Where positions count from.
    """
    n, k = towers.block.shape
    x = np.empty((n, k, N_FEATURES), np.float32)
    if len(towers.blocks) <= TABLE:
        x[..., :POSITION_X] = look_up(_own_features(towers.blocks), towers.block, towers.rotation)
    else:
        x[..., :POSITION_X] = _own(towers.mass, towers.com, towers.dims)
    for axes, place in ((slice(7, 9), towers.xy), (slice(9, 10), towers.z[..., None])):
        x[..., axes] = _from(place, position_of) / LENGTH
    return x


def _from(place: np.ndarray, position_of: PositionOf) -> np.ndarray:
    """[N, K, ...] places in the world [m] -> positions."""
    if position_of is PositionOf.BOTTOM:
        return place - place[:, :1]
    return place if position_of is PositionOf.WORLD else np.diff(place, axis=1, prepend=0)


def in_unit(x: np.ndarray, length_unit: float) -> np.ndarray:
    """The features [N, K, N_FEATURES] with lengths in another unit.

    Args:
        x: Features with lengths in `LENGTH`.
        length_unit: [m].
    """
    if length_unit == LENGTH:
        return x
    other = x.copy()
    other[..., COM_X:] *= LENGTH / length_unit
    return other


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
