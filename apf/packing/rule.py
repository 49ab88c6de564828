"""The feasibility detector: which prefixes of a packing succeed, and why a placement fails."""

from dataclasses import replace
from enum import IntEnum

import numpy as np

from apf.packing.packings import LEVEL, Packings, overlap

CHUNK = 8192
"""Number of packings that are judged at once. The arrays of so many packings fit in the processor's cache."""


class Failure(IntEnum):
    """What went wrong with a placement. If several things did, the smallest number is reported."""

    NONE = 0
    WALL = 1
    """The box hits a wall."""
    FINGER_WALL = 2
    """A finger hits a wall."""
    FINGER_BOX = 3
    """A finger hits a box that was placed before."""
    TOO_HIGH = 4
    """The box stands out above the rim."""
    UNSUPPORTED = 5
    """The box tips: its centre of mass is not above its support."""
    PUSHED = 6
    """A box that was placed before tips under the weight on it."""


def packed_prefixes(packings: Packings, xy: np.ndarray | None = None) -> np.ndarray:
    """[N, K] bool: does each prefix succeed? All prefixes after a failed prefix fail, too.

    Args:
        packings: N packings of K boxes.
        xy: [N, K, 2] places where the boxes came down [m], e.g. with noise; None: the places of the packings.
    """
    return np.logical_and.accumulate(failures(packings, xy) == Failure.NONE, axis=1)


def packed(packings: Packings) -> np.ndarray:
    """[N] bool: does the whole packing succeed?"""
    return packed_prefixes(packings)[:, -1]


def failures(packings: Packings, xy: np.ndarray | None = None) -> np.ndarray:
    """[N, K] int8: what goes wrong with each placement (`Failure`), if all boxes before it lie where they came down.

    Args:
        packings: N packings of K boxes.
        xy: [N, K, 2] places where the boxes came down [m], e.g. with noise; None: the places of the packings.
    """
    if xy is not None:
        packings = replace(packings, xy=xy)
    starts = range(0, max(len(packings), 1), CHUNK)
    return np.concatenate([_failures(packings[start : start + CHUNK]) for start in starts])


def _failures(packings: Packings) -> np.ndarray:
    """As `failures`, of a few thousand packings. Arithmetic runs along packings: arrays are [K, ..., N]."""
    container, gripper = packings.cell.container, packings.cell.gripper
    k, half = packings.length, packings.dims[..., :2] / 2
    low, high = (np.ascontiguousarray((packings.xy + sign * half).transpose(1, 2, 0)) for sign in (-1, 1))
    z, top = (np.ascontiguousarray(a.T) for a in (packings.z, packings.z + packings.dims[..., 2]))
    fingers = _fingers(packings, half)
    found = np.zeros((k, len(packings)), np.int8)
    wall = container.half[:, None]
    for j in range(k):
        tips = z[j] + gripper.lift
        hits_wall, hits_box = np.zeros((2, len(packings)), bool)
        for finger_low, finger_high in fingers:
            hits_wall |= ((finger_low[j] < -wall) | (finger_high[j] > wall)).any(0)
            for i in range(j):
                hits_box |= overlap(low[i], high[i], finger_low[j], finger_high[j]) & (top[i] > tips)
        checks = [
            (Failure.TOO_HIGH, top[j] > container.height),
            (Failure.FINGER_BOX, hits_box),
            (Failure.FINGER_WALL, hits_wall & (tips < container.height)),
            (Failure.WALL, ((low[j] < -wall) | (high[j] > wall)).any(0)),
        ]
        for failure, failed in checks:
            found[j, failed] = failure
    _check_balance(found, low, high, z, top)
    return found.T


def _fingers(packings: Packings, half: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Two corners [K, 2, N] of the room that each of the two fingers takes, seen from above [m]."""
    gripper = packings.cell.gripper
    on_axis = packings.grip[..., None] == np.arange(2)
    offset = np.where(on_axis, half + gripper.thickness / 2, 0.0)
    extent = np.where(on_axis, gripper.thickness / 2, gripper.width / 2)
    places = (packings.xy + sign * offset for sign in (-1, 1))
    return [
        (
            np.ascontiguousarray((place - extent).transpose(1, 2, 0)),
            np.ascontiguousarray((place + extent).transpose(1, 2, 0)),
        )
        for place in places
    ]


def _check_balance(found: np.ndarray, low: np.ndarray, high: np.ndarray, z: np.ndarray, top: np.ndarray) -> None:
    """Writes UNSUPPORTED and PUSHED into failures [K, N] where nothing else went wrong.

    Args:
        found: [K, N] `Failure` of each placement.
        low: [K, 2, N] corner of each box, seen from above [m].
        high: [K, 2, N] the opposite corner [m].
        z: [K, N] bottoms [m].
        top: [K, N] tops [m].
    """
    failed_before = np.zeros(found.shape[1], bool)
    for j in range(len(found)):
        failed_before |= found[j] != Failure.NONE
        rows = np.flatnonzero((z[j] > LEVEL) & ~failed_before)  # on the floor nothing tips
        if len(rows):
            part = np.s_[: j + 1, ..., rows]
            found[j, rows] = _balance(low[part], high[part], z[part], top[part])
            failed_before[rows] |= found[j, rows] != Failure.NONE


def _balance(low: np.ndarray, high: np.ndarray, z: np.ndarray, top: np.ndarray) -> np.ndarray:
    """[N] `Failure`: is the last of K boxes in balance, and are the boxes below it?

    A box is in balance if the joint centre of mass of the box and its load lies within the convex hull of the areas on
    which the box rests. From the last box to the first, each box passes its weight to the boxes below. A box on one box
    alone loads that box at its centre of mass. A box on several boxes divides its weight in an unknown way: each of
    these boxes must bear the whole weight, anywhere in the area of contact. The joint centre of mass therefore lies in
    a rectangle. All corners of the rectangle are tested.
    Arguments: as those of `_check_balance`.
    """
    k, n = z.shape
    weight = (high - low).prod(1) * (top - z)
    moment_low = weight[:, None] * (low + high) / 2
    moment_high = moment_low.copy()
    failure = np.zeros(n, np.int8)
    for b in range(k - 1, 0, -1):
        touching = np.array(
            [overlap(low[s], high[s], low[b], high[b]) & (np.abs(top[s] - z[b]) < LEVEL) for s in range(b)]
        )
        contact_low, contact_high = np.maximum(low[:b], low[b]), np.minimum(high[:b], high[b])
        rows = np.flatnonzero(touching.any(0) & (failure == Failure.NONE))
        centre = (moment_low[b][:, rows] / weight[b, rows], moment_high[b][:, rows] / weight[b, rows])
        area = contact_low[..., rows], contact_high[..., rows], touching[:, rows]
        inside = [inside_hull(np.stack([centre[x][0], centre[y][1]]), *area) for x in range(2) for y in range(2)]
        failure[rows[~np.logical_and.reduce(inside)]] = Failure.UNSUPPORTED if b == k - 1 else Failure.PUSHED
        alone = touching.sum(0) == 1
        for s in range(b):
            load = np.where(touching[s], weight[b], 0.0)
            weight[s] += load
            moment_low[s] += np.where(alone & touching[s], moment_low[b], load * contact_low[s])
            moment_high[s] += np.where(alone & touching[s], moment_high[b], load * contact_high[s])
    return failure


def inside_hull(point: np.ndarray, low: np.ndarray, high: np.ndarray, used: np.ndarray) -> np.ndarray:
    """[N] bool: do points lie inside the convex hull of rectangles? A point on the border is not inside.

    The test is exact. A point lies outside, or on the border, if all corners lie on one side of a straight line through
    the point, or on that line. One such line then runs through a corner.

    Args:
        point: [2, N].
        low: [M, 2, N] corners of M rectangles.
        high: [M, 2, N] the opposite corners.
        used: [M, N] bool: which rectangles there are.
    """
    inside = np.logical_or.reduce(((low < point) & (point < high)).all(1) & used)
    rest = np.flatnonzero(~inside & (used.sum(0) > 1))
    if len(rest):
        first = used[:, rest].argmax(0)
        low, high = (
            np.where(used[:, None, rest], a[..., rest], a[first, :, rest].T) - point[:, rest] for a in (low, high)
        )
        x = np.concatenate([low[:, 0], high[:, 0], low[:, 0], high[:, 0]])
        y = np.concatenate([low[:, 1], low[:, 1], high[:, 1], high[:, 1]])
        outside = np.zeros(len(rest), bool)
        for c in range(len(x)):
            side = x[c] * y - y[c] * x
            outside |= ((x[c] != 0) | (y[c] != 0)) & ((side >= 0).all(0) | (side <= 0).all(0))
        inside[rest] = ~outside
    return inside
