"""Forward and inverse kinematics of the Panda, analytic, by frankik. Angles in rad, lengths in m."""

from collections.abc import Sequence

import frankik
import numpy as np

from apf.panda.geometry import about_z, inverse, pose

JOINTS = 7
REST = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
"""[7] where the arm waits: upright, away from the table."""
MARGIN = 0.02
"""The planner stays this far [rad] from the ends of each joint."""
LOWER = np.array(frankik.q_min_panda) + MARGIN
UPPER = np.array(frankik.q_max_panda) - MARGIN

TARGET_ABOVE_HAND = 0.105
"""From the hand to the point between the fingertips that grasps are stated for, as in the URDF (panda_grasptarget)."""
FRANKIK_ABOVE_HAND = 0.1034
"""From the hand to the point that `frankik.fk` answers."""
FLANGE_TO_TARGET = pose((0, 0, 0), about_z(-np.pi / 4)) @ pose((0, 0, TARGET_ABOVE_HAND))
TARGET_TO_FLANGE = inverse(FLANGE_TO_TARGET)
FRANKIK_TO_TARGET = pose((0, 0, TARGET_ABOVE_HAND - FRANKIK_ABOVE_HAND))
WRIST_ANGLES = np.linspace(LOWER[6], UPPER[6], 15)
"""The redundant joint is tried at these."""
WRIST_TURNS = (0.0, 0.06, -0.06, 0.12, -0.12, 0.2, -0.2)
"""By which a straight line may turn the redundant joint at its beginning [rad]."""
JUMP = 0.35
"""Between two neighbouring points of a straight line no joint moves more than this [rad]."""


def forward(q: np.ndarray) -> np.ndarray:
    """[4, 4] pose of the grasp target in the robot's frame, for joints q [7]."""
    return frankik.fk(q) @ FRANKIK_TO_TARGET


def within_limits(q: np.ndarray) -> np.ndarray:
    """[...] bool, for joints [..., 7]: is every joint between its ends? NaN is not."""
    return np.asarray(((q >= LOWER) & (q <= UPPER)).all(-1))


def inverse_kinematics(target: np.ndarray, near: np.ndarray) -> np.ndarray:
    """[M, 7] joints that bring the grasp target to a pose [4, 4], nearest to `near` [7] first; M may be 0.

    Near are joints of which none but the last, which only turns the hand, is far from its own in `near`.
    """
    flange = target @ TARGET_TO_FLANGE
    found = np.concatenate([frankik.ik_full(flange, near, q7) for q7 in WRIST_ANGLES])
    found = found[within_limits(found)]
    return found[np.argsort(np.abs(found - near)[:, :-1].max(1), kind="stable")]


def straight(targets: Sequence[np.ndarray], start: np.ndarray) -> np.ndarray | None:
    """[M, 7] joints that bring the grasp target to each of M poses in turn, going on from `start` [7] smoothly.

    The last joint keeps its angle, or turns a little at the beginning. None if a pose cannot be reached, or only by a
    jump.
    """
    for turn in WRIST_TURNS:
        path = _at_wrist_angle(targets, start, start[6] + turn)
        if path is not None:
            return path
    return None


def _at_wrist_angle(targets: Sequence[np.ndarray], start: np.ndarray, angle: float) -> np.ndarray | None:
    path, q = [], start
    for target in targets:
        found = frankik.ik_full(target @ TARGET_TO_FLANGE, q, angle)
        found = found[within_limits(found)]
        if not len(found):
            return None
        jumps = np.abs(found - q).max(1)
        if jumps.min() > JUMP:
            return None
        q = found[jumps.argmin()]
        path.append(q)
    return np.array(path)
