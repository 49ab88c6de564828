"""The 24 axis-aligned rotations of a cuboid, as matrices and as quaternions."""

from itertools import product

import numpy as np

from apf.errors import InputError


def _group() -> np.ndarray:
    """The 24 rotations of a cube as unit quaternions (x, y, z, w) [24, 4], identity first.

    They are the integer vectors with 1, 2 or 4 equal non-zero entries, one of each pair {q, -q}: the one
    whose last non-zero entry is positive.
    """
    vectors = [np.array(v, float) for v in product((0, 1, -1), repeat=4) if np.count_nonzero(v) in (1, 2, 4)]
    half = [v for v in vectors if v[np.flatnonzero(v)[-1]] > 0]
    return np.array([v / np.linalg.norm(v) for v in half])


def _matrices(q: np.ndarray) -> np.ndarray:
    """Rotation matrices [..., 3, 3] of unit quaternions (x, y, z, w) [..., 4]."""
    v, w = q[..., :3], q[..., 3]
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(w)
    cross = np.stack([o, -z, y, z, o, -x, -y, x, o], axis=-1).reshape(*w.shape, 3, 3)
    outer = v[..., :, None] * v[..., None, :]
    return (w**2 - (v**2).sum(-1))[..., None, None] * np.eye(3) + 2 * outer + 2 * w[..., None, None] * cross


QUATERNIONS = _group()
"""[24, 4], order (x, y, z, w), identity first."""

ROTATIONS = np.rint(_matrices(QUATERNIONS))
"""[24, 3, 3] signed permutation matrices; `ROTATIONS[r] @ v` turns v from the block's frame into the world's."""


def _turn_table() -> np.ndarray:
    """[4, 24]: the rotation that results from `r` followed by 0, 1, 2, 3 quarter turns about the vertical."""
    quarter = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turned = [np.linalg.matrix_power(quarter, k) @ ROTATIONS for k in range(4)]
    return np.array([[int(np.argmax((m == ROTATIONS).all((1, 2)))) for m in turn] for turn in turned])


TURN = _turn_table()


AXES = np.abs(ROTATIONS).argmax(2)
"""[24, 3]: the block's own axis that lies along each axis of the world after each rotation."""

SIGNS = ROTATIONS.sum(2)
"""[24, 3]: does it point along it (1) or against it (-1)?"""

TOLERANCE = 6e-4
"""How far an entry of a quaternion may be off: files round to three digits."""


def rotation_index(quaternion: np.ndarray, tolerance: float = TOLERANCE) -> np.ndarray:
    """Which of the 24 rotations each quaternion is. [..., 4] (x, y, z, w), any sign -> [...] in 0..23.

    Raises InputError, which says how far off it is, if an entry of one is farther than `tolerance` from all of them.
    """
    q = np.asarray(quaternion, float)
    nearest, error = _nearest(q)
    if not np.all(error <= tolerance):
        worst = q.reshape(-1, 4)[np.argmax(~(error.reshape(-1) <= tolerance))]
        raise InputError(not_axis_aligned(worst))
    return nearest


def off_axis(quaternions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of quaternions [N, 4] (x, y, z, w), the nearest rotation [N] in 0..23, and which are too far off [N] bool."""
    nearest, error = _nearest(quaternions)
    return nearest, ~(error <= TOLERANCE)


def not_axis_aligned(q: np.ndarray) -> str:
    """What to say of a quaternion [4] (x, y, z, w) that is none of the 24: how far it is from the nearest."""
    said = f"quaternion (qx, qy, qz, qw) = {tuple(q.tolist())} is not one of the 24 axis-aligned rotations"
    length = float(np.linalg.norm(q)) if np.isfinite(q).all() else np.inf
    if not 0 < length < np.inf:
        return f"{said}; it must have the length 1"
    cosines = np.abs(QUATERNIONS @ (q / length))
    best = int(cosines.argmax())
    angle = np.degrees(2 * np.arccos(min(cosines[best], 1.0)))
    near = ", ".join(f"{v:.3g}" for v in QUATERNIONS[best])
    return (
        f"{said}: it is {angle:.3g} degrees off the nearest, ({near}), and its length is {length:.4g}, not 1"
        if (abs(length - 1) > TOLERANCE)
        else f"{said}: it is {angle:.3g} degrees off the nearest, ({near})"
    )


def _nearest(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest rotation of each quaternion [..., 4], and by how much its worst entry differs [...]."""
    with np.errstate(all="ignore"):
        nearest = np.abs(q @ QUATERNIONS.T).argmax(-1)
        sign = np.sign((q * QUATERNIONS[nearest]).sum(-1, keepdims=True))
        return nearest, np.abs(sign * q - QUATERNIONS[nearest]).max(-1)
