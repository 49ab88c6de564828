"""The inductive bias: what a network sees of each placement, and the symmetries of a container."""

from collections.abc import Iterator

import numpy as np

from apf.packing.packings import Packings

N_FEATURES = 13
"""Sides (3), grip, distances to the four walls and to the rim, position (3) and turn."""
N_POSITION = 4
"""The last features are x, y, z and the turn in which a box is placed: networks see differences of two boxes, so that a
pair knows which of the two comes first."""
GRIP, DIM_X, WALL_X, WALL_Y, X, Y = 3, 0, 4, 6, 9, 10
LENGTH = 0.1
"""Unit of all lengths [m]: one for all, since a network adds sides to positions."""
TURNS = 4
"""Unit of the turn [placements]."""


def features(packings: Packings) -> np.ndarray:
    """[N, K, N_FEATURES] float32, all of about unit range: lengths in units of 10 cm, sides and distances less 10 cm.

    grip: -1 where the fingers grip along x, 1 along y. Distances are from the box's sides to the walls at -x, x, -y, y
    and from its top to the rim. Position: the box's centre from the middle of the floor; its turn from 0.
    """
    n, k = packings.box.shape
    container, half = packings.cell.container, packings.dims / 2
    gripper = packings.cell.gripper
    gripped = packings.grip[..., None] == np.arange(2)
    reach = np.where(gripped, half[..., :2] + gripper.thickness, np.maximum(half[..., :2], gripper.width / 2))
    x = np.empty((n, k, N_FEATURES), np.float32)
    x[..., DIM_X : DIM_X + 3] = packings.dims / LENGTH - 1
    x[..., GRIP] = 2 * packings.grip - 1
    for axis, first in enumerate((WALL_X, WALL_Y)):
        for side, sign in enumerate((1, -1)):
            distance = container.half[axis] + sign * packings.xy[..., axis] - reach[..., axis]
            x[..., first + side] = near(distance)
    x[..., 8] = near(container.height - packings.z - packings.dims[..., 2])
    x[..., X : X + 2] = packings.xy / LENGTH
    x[..., 11] = (packings.z + half[..., 2]) / LENGTH
    x[..., 12] = np.arange(k) / TURNS
    return x


def mirrored(x: np.ndarray, axis: int) -> np.ndarray:
    """The features [N, K, N_FEATURES] of the same packings in a mirror: x (axis 0) or y (1) the other way round."""
    mirror = x.copy()
    first = (WALL_X, WALL_Y)[axis]
    mirror[..., [first, first + 1]] = x[..., [first + 1, first]]
    mirror[..., X + axis] *= -1
    return mirror


def transposed(x: np.ndarray) -> np.ndarray:
    """The features [N, K, N_FEATURES] of the same packings in a diagonal mirror: x and y exchanged."""
    other = x.copy()
    pairs = [(DIM_X, DIM_X + 1), (WALL_X, WALL_Y), (WALL_X + 1, WALL_Y + 1), (X, Y)]
    for one, two in pairs:
        other[..., [one, two]] = x[..., [two, one]]
    other[..., GRIP] *= -1
    return other


def views(packings: Packings) -> Iterator[np.ndarray]:
    """Features of packings that have the same labels, their own first: both mirror images and half a turn.

    In a square container also those turned by a quarter and mirrored in a diagonal: eight in all.
    """
    container, own = packings.cell.container, features(packings)
    for x in (own, transposed(own)) if container.length == container.width else (own,):
        for y in (x, mirrored(x, 0)):
            yield y
            yield mirrored(y, 1)


NEAR = float(__import__("os").environ.get("NEAR", 0.03))


def near(distance):
    return np.tanh(distance / NEAR)
