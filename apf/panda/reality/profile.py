"""How the joints move along a path: the same for every reality."""

from itertools import pairwise

import numpy as np


def motion_along(path: np.ndarray, speed: float, acceleration: float, rate: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Pieces of a motion along a path [M, 7], from rest to rest, with a halt at each sharp corner.

    Args:
        path: [M, 7] joints [rad]; the motion begins at the first.
        speed: Of the joint that moves most, at most [rad/s].
        acceleration: Of that joint [rad/s^2].
        rate: Steps in a second.

    Returns:
        For each piece the joints [T, 7] [rad] and their velocities [T, 7] [rad/s], a row for each step.
    """
    pieces = []
    for piece in smooth_pieces(path):
        lengths = np.abs(np.diff(piece, axis=0)).max(1)
        marks = np.concatenate([[0.0], np.cumsum(lengths)])
        if marks[-1] < 1e-6:
            continue
        times, positions = trapezoid(marks[-1], speed, acceleration, rate)
        joints = np.stack([np.interp(positions, marks, joint) for joint in piece.T], axis=1)
        velocities = np.gradient(joints, times, axis=0) if len(times) > 1 else np.zeros_like(joints)
        velocities[-1] = 0.0
        pieces.append((joints, velocities))
    return pieces


def smooth_pieces(path: np.ndarray) -> list[np.ndarray]:
    """A path [M, 7] cut where its direction turns by more than 15 degrees."""
    steps = np.diff(path, axis=0)
    keep = np.concatenate([[True], np.abs(steps).max(1) > 1e-9])
    path = path[keep]
    steps = np.diff(path, axis=0)
    directions = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    turns = (directions[1:] * directions[:-1]).sum(1) < np.cos(np.deg2rad(15))
    corners = [0, *(np.flatnonzero(turns) + 1).tolist(), len(path) - 1]
    return [path[a : b + 1] for a, b in pairwise(corners) if b > a]


def trapezoid(length: float, speed: float, acceleration: float, rate: int) -> tuple[np.ndarray, np.ndarray]:
    """Times [M] in steps of 1/rate and places [M] along a line, from rest to rest, ending exactly at `length`.

    Args:
        length: Of the line.
        speed: The largest, in units of the line a second.
        acceleration: In units of the line a second squared.
        rate: Steps in a second.
    """
    peak = min(speed, float(np.sqrt(length * acceleration)))
    ramp = peak / acceleration
    total = length / peak + ramp
    n = max(2, int(np.ceil(total * rate)) + 1)
    times = np.arange(n) / rate
    t = np.minimum(times, total)
    left = total - t
    places = np.where(
        t < ramp,
        acceleration * t**2 / 2,
        np.where(left < ramp, length - acceleration * left**2 / 2, peak * (t - ramp / 2)),
    )
    return times, places
