"""Poses as 4x4 matrices: `a @ b` is pose b, given in the frame of a, in the frame that a is given in. Lengths in m."""

from collections.abc import Sequence
from math import copysign, sqrt

import numpy as np

from apf.panda.client import pybullet


def pose(position: Sequence[float] | np.ndarray, rotation: np.ndarray | None = None) -> np.ndarray:
    """[4, 4] from a position [3] and a rotation matrix [3, 3] (None: not turned)."""
    result = np.eye(4)
    result[:3, 3] = position
    if rotation is not None:
        result[:3, :3] = rotation
    return result


def from_vector(vector: Sequence[float] | np.ndarray) -> np.ndarray:
    """[4, 4] from position and quaternion [7]: x, y, z, qx, qy, qz, qw."""
    matrix = pybullet.getMatrixFromQuaternion(tuple(vector[3:7]))
    return pose(vector[:3], np.array(matrix).reshape(3, 3))


def to_vector(matrix: np.ndarray) -> np.ndarray:
    """[7]: x, y, z, qx, qy, qz, qw, with qw >= 0."""
    (a, b, c), (d, e, f), (g, h, i) = matrix[:3, :3].tolist()
    w = sqrt(max(0.0, 1 + a + e + i)) / 2
    x, y, z = (sqrt(max(0.0, s)) / 2 for s in (1 + a - e - i, 1 - a + e - i, 1 - a - e + i))
    if w > 1e-6:
        x, y, z = copysign(x, h - f), copysign(y, c - g), copysign(z, d - b)
    elif x >= max(y, z):
        y, z = copysign(y, b + d), copysign(z, c + g)
    elif y >= z:
        x, z = copysign(x, b + d), copysign(z, f + h)
    else:
        x, y = copysign(x, c + g), copysign(y, f + h)
    norm = sqrt(x * x + y * y + z * z + w * w)
    return np.array([*matrix[:3, 3], x / norm, y / norm, z / norm, w / norm])


def inverse(matrix: np.ndarray) -> np.ndarray:
    """The pose that undoes this one."""
    turned = matrix[:3, :3].T
    return pose(-turned @ matrix[:3, 3], turned)


def moved(matrix: np.ndarray, offset: Sequence[float] | np.ndarray) -> np.ndarray:
    """The pose shifted by an offset [3] along the axes of the frame that it is given in."""
    result = matrix.copy()
    result[:3, 3] += offset
    return result


def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Between the origins of two poses [m]."""
    return float(np.linalg.norm(a[:3, 3] - b[:3, 3]))


def angle(a: np.ndarray, b: np.ndarray) -> float:
    """Between the orientations of two poses [rad], in 0 to pi."""
    cosine = (np.trace(a[:3, :3].T @ b[:3, :3]) - 1) / 2
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def about_z(radians: float) -> np.ndarray:
    """[3, 3] turn about the vertical."""
    c, s = np.cos(radians), np.sin(radians)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def disturbed(matrix: np.ndarray, position: float, rotation: float, rng: np.random.Generator) -> np.ndarray:
    """The pose with independent normal errors: sd `position` [m] and `rotation` [rad] on each axis. Always draws.

    Args:
        matrix: [4, 4] pose.
        position: Standard deviation on each axis [m].
        rotation: Standard deviation about each axis [rad].
        rng: The source of all draws.
    """
    shift, turn = rng.normal(0.0, 1.0, 3) * position, rng.normal(0.0, 1.0, 3) * rotation
    size = float(np.linalg.norm(turn))
    if size == 0.0:
        return moved(matrix, shift)
    quaternion = pybullet.getQuaternionFromAxisAngle((turn / size).tolist(), size)
    return pose(matrix[:3, 3] + shift, from_vector((0, 0, 0, *quaternion))[:3, :3] @ matrix[:3, :3])
