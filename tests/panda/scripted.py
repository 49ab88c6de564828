"""A robot that follows a script, with the truth in its hands: what a physics must be able to do, without a planner."""

import numpy as np

from apf.panda.flaws import Flaws
from apf.panda.geometry import inverse, moved, pose
from apf.panda.grasps import Grasp, Gripper, grasps_of
from apf.panda.kinematics import REST, forward, inverse_kinematics, straight
from apf.panda.layout import Layout
from apf.panda.reality import Physics, Reality, Rig
from apf.panda.reality.base import Hold
from apf.panda.reality.photographer import Photographer
from apf.panda.settings import Arm
from apf.panda.vision.cameras import Cameras

FAST, CAREFUL, ABOVE = 1.5, 0.6, 0.1


def reality_of(physics: Physics, flaws: Flaws | None = None, hold: Hold = "friction", gui: bool = False) -> Reality:
    cameras, layout = Cameras(), Layout()
    photographer = Photographer(layout, cameras.named(), (flaws or Flaws()).drawn(cameras.named()))
    return physics.reality(Rig(layout, Arm(), Gripper(), photographer, cameras.wrist, hold, gui))


def from_above(dims: np.ndarray) -> Grasp:
    """In the middle of the block, straight down, with the fingers beside its faces in y."""
    return next(
        grasp
        for grasp in grasps_of(dims, Gripper())
        if grasp.offset == 0 and grasp.pose[2, 2] < -0.99 and abs(grasp.pose[1, 1]) > 0.9
    )


def go_above(reality: Reality, target: np.ndarray) -> None:
    """To where the hand can come down straight on a pose [4, 4]."""
    high = moved(target, (0, 0, ABOVE))
    down = [moved(target, (0, 0, ABOVE - ABOVE * i / 8)) for i in range(9)]
    q = next(q for q in inverse_kinematics(high, REST) if straight(down, q) is not None)
    reality.follow(q[None], FAST)


def go_straight(reality: Reality, target: np.ndarray) -> None:
    q = reality.joints()
    hand = forward(q)
    points = [pose(hand[:3, 3] + (target - hand)[:3, 3] * i / 8, target[:3, :3]) for i in range(1, 9)]
    path = straight(points, q)
    assert path is not None
    reality.follow(path, CAREFUL)


def take(reality: Reality, block: int, dims: np.ndarray) -> Grasp:
    """Grip a block and lift it."""
    grasp = from_above(dims)
    target = reality.pose_of(block) @ grasp.pose
    go_above(reality, target)
    go_straight(reality, target)
    reality.grip()
    go_straight(reality, moved(target, (0, 0, ABOVE)))
    return grasp


def place(reality: Reality, block: int, goal: np.ndarray, grasp: Grasp) -> None:
    """Lower a block in the hand to a pose [4, 4], let go, and draw back."""
    go_above(reality, goal @ grasp.pose)
    held = inverse(forward(reality.joints())) @ reality.pose_of(block)
    target = moved(goal, (0, 0, 0.001)) @ inverse(held)
    go_straight(reality, target)
    reality.wait(0.1)
    reality.release()
    go_straight(reality, moved(target, (0, 0, ABOVE)))
    reality.follow(REST[None], FAST)


def stack(reality: Reality, blocks: tuple[int, ...], dims: np.ndarray) -> list[np.ndarray]:
    """Build a tower of blocks one above the other; the poses where they belong."""
    goals, height = [], 0.0
    for block in blocks:
        goal = pose((0.45, 0.0, height + dims[block, 2] / 2))
        place(reality, block, goal, take(reality, block, dims[block]))
        height += dims[block, 2]
        goals.append(goal)
    return goals
