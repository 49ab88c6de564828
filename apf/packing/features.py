"""The inductive bias: what a network sees of each placement, and the symmetries of a container.

A network sees differences of positions only, and learns millimetres slowly from decimetres. Each placement therefore
comes with what sensors on the hand would tell on the way down: how much room is left on each side, and how much of the
underside meets something. What of it makes a placement fail is left to learn.
"""

from collections.abc import Iterator

import numpy as np

from apf.packing.packings import LEVEL, Packings, overlap

N_FEATURES = 14
"""Sides (3), grip, room on four sides and up to the rim (5), support, position (3) and turn."""
N_POSITION = 4
"""The last features are x, y, z and the turn in which a box is placed: networks see differences of two boxes, so that a
pair knows which of the two comes first."""
DIM_X, GRIP, ROOM_X, ROOM_Y, RIM, SUPPORT, X, Y, Z, TURN = 0, 3, 4, 6, 8, 9, 10, 11, 12, 13
LENGTH = 0.1
"""Unit of sides and positions [m]: one for both, since a network adds sides to positions."""
NEAR = 0.015
"""Room is told apart up to a few times this [m]: features are tanh(room / NEAR)."""
CHUNK = 8192
"""Packings that are looked at together: what is computed of them then stays in the cache."""


def features(packings: Packings) -> np.ndarray:
    """[N, K, N_FEATURES] float32, all of about unit range: lengths in units of 10 cm, sides less 10 cm.

    grip: -1 where the fingers grip along x, 1 along y. Room: see `_room`. Support: the share of the underside that
    lies on something, 1 on the floor. Position: the box's centre, from the middle of the floor; its turn from 0.
    """
    x = np.empty((*packings.box.shape, N_FEATURES), np.float32)
    x[..., DIM_X : DIM_X + 3] = packings.dims / LENGTH - 1
    x[..., GRIP] = 2 * packings.grip - 1
    for start in range(0, len(packings), CHUNK):
        part = np.s_[start : start + CHUNK]
        x[part, :, ROOM_X:RIM], x[part, :, SUPPORT] = _room(packings[part])
    x[..., RIM] = np.tanh((packings.cell.container.height - packings.z - packings.dims[..., 2]) / NEAR)
    x[..., X : X + 2] = packings.xy / LENGTH
    x[..., Z] = (packings.z + packings.dims[..., 2] / 2) / LENGTH
    x[..., TURN] = np.arange(packings.length)
    return x


def _room(packings: Packings) -> tuple[np.ndarray, np.ndarray]:
    """What is around each box when it comes down.

    Returns:
        [N, K, 4]: the room to the nearest wall, or box that rises above the fingers' tips, at -x, x, -y and y, as
        tanh(room / NEAR). On the axis of the grip it counts from the outside of the finger, and boxes in the finger's
        way count; else from the side of the box, and those beside the box.
        [N, K]: the share of the underside that lies on the floor or on a box.
    """
    container, gripper = packings.cell.container, packings.cell.gripper
    xy, half = (np.ascontiguousarray(a.transpose(1, 2, 0)) for a in (packings.xy, packings.dims[..., :2] / 2))
    z, height = (np.ascontiguousarray(a.T) for a in (packings.z, packings.dims[..., 2]))
    gripped = packings.grip.T[:, None] == np.arange(2)[:, None]
    reach = half + np.where(gripped, gripper.thickness, 0.0)
    room = np.stack([container.half[:, None] + sign * xy - reach for sign in (1, -1)], axis=2)
    low, high, top = xy - half, xy + half, z + height
    support = (z <= LEVEL).astype(float)
    for j in range(packings.length):
        for i in range(j):
            rises = top[i] > z[j] + gripper.lift
            for axis in range(2):
                across = np.where(gripped[j, axis], gripper.width / 2, half[j, 1 - axis])
                away = xy[i, axis] - xy[j, axis]
                beside = rises & (np.abs(xy[i, 1 - axis] - xy[j, 1 - axis]) < half[i, 1 - axis] + across)
                distance = np.abs(away) - half[i, axis] - reach[j, axis]
                for side, there in enumerate((away < 0, away > 0)):
                    nearest = room[j, axis, side]
                    np.minimum(nearest, np.where(beside & there, distance, np.inf), out=nearest)
            sides = np.minimum(high[i], high[j]) - np.maximum(low[i], low[j])
            bears = overlap(low[i], high[i], low[j], high[j]) & (np.abs(top[i] - z[j]) < LEVEL)
            support[j] += np.where(bears, sides[0] * sides[1] / (4 * half[j, 0] * half[j, 1]), 0.0)
    return np.tanh(room / NEAR).reshape(packings.length, 4, -1).transpose(2, 0, 1), support.T


def mirrored(x: np.ndarray, axis: int) -> np.ndarray:
    """The features [N, K, N_FEATURES] of the same packings in a mirror: x (axis 0) or y (1) the other way round."""
    mirror = x.copy()
    first = (ROOM_X, ROOM_Y)[axis]
    mirror[..., [first, first + 1]] = x[..., [first + 1, first]]
    mirror[..., X + axis] *= -1
    return mirror


def transposed(x: np.ndarray) -> np.ndarray:
    """The features [N, K, N_FEATURES] of the same packings in a diagonal mirror: x and y exchanged."""
    other = x.copy()
    for one, two in ((DIM_X, DIM_X + 1), (ROOM_X, ROOM_Y), (ROOM_X + 1, ROOM_Y + 1), (X, Y)):
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
