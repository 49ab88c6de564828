"""Ruins by script: what a fallen tower may look like, and worse."""

import numpy as np

from apf.panda.geometry import about_z, pose
from apf.panda.layout import Layout
from apf.towers import BlockSet

KINDS = ("crosswise", "leaning", "upside_down", "touching", "swapped")


def about_x(radians: float) -> np.ndarray:
    c, s = np.cos(radians), np.sin(radians)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def up(height: float) -> np.ndarray:
    return np.array([0.0, 0.0, height])


def jumble(kind: str, blocks: BlockSet, number: int) -> np.ndarray:
    """[B, 4, 4] poses of which some are not at home: of a kind, and of that kind the one of this number."""
    rng = np.random.default_rng([KINDS.index(kind), number])
    layout = Layout()
    poses = layout.home_poses(blocks.dims)
    a, b, c = rng.permutation(len(blocks))[:3]
    middle = np.array([*(layout.base + rng.uniform(-0.06, 0.06, 2)), 0.0])
    dims, yaw = blocks.dims, rng.uniform(-np.pi, np.pi)
    if kind == "crosswise":
        z = 0.0
        for block, turn in ((a, yaw), (b, yaw + np.pi / 4), (c, yaw + np.pi / 2)):
            poses[block] = pose(middle + up(z + dims[block, 2] / 2), about_z(turn))
            z += dims[block, 2]
    elif kind == "leaning":
        poses[a] = pose(middle + up(dims[a, 2] / 2), about_z(yaw))
        beside = about_z(yaw) @ [0, dims[a, 1] / 2 + dims[b, 1] / 2 + 0.012, 0]
        poses[b] = pose(middle + beside + up(dims[b, 2] / 2 + 0.012), about_z(yaw) @ about_x(0.45))
    elif kind == "upside_down":
        for block, side, turn in ((a, -1, np.pi), (b, 1, np.pi / 2)):
            height = dims[block, 2 if side < 0 else 1] / 2
            place = middle + np.array([0.05 * side, 0.08 * side, height])
            poses[block] = pose(place, about_z(yaw) @ about_x(turn))
    elif kind == "touching":
        x = 0.0
        for block in (a, b, c):
            x += dims[block, 0] / 2
            poses[block] = pose(middle + about_z(yaw) @ [x, 0, 0] + up(dims[block, 2] / 2), about_z(yaw))
            x += dims[block, 0] / 2 + 1e-4
    else:  # each of two lies where the other belongs
        for block, other in ((a, b), (b, a)):
            poses[block] = pose(layout.homes[other][:3, 3] + up(dims[block, 2] / 2), about_z(yaw))
    return poses
