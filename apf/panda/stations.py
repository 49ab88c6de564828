"""Samplers for the task planner: joint configurations at which a block can be taken from, or put at, a pose."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from apf.panda.belief import Belief, Held
from apf.panda.geometry import inverse, moved
from apf.panda.grasps import Grasp
from apf.panda.kinematics import LOWER, REST, UPPER, inverse_kinematics, straight
from apf.panda.motion import MotionSettings
from apf.settings import Degrees, Few, Number, settings

APPROACH_STEPS, LIFT_STEPS = 5, 5


@settings
class Reach:
    """How the hand comes to a block and leaves it."""

    approach: Annotated[Number, Field(gt=0, le=1)] = 0.07
    """Straight along the fingers, the last so many metres."""
    lift: Annotated[Number, Field(gt=0, le=1)] = 0.10
    """Straight up with the block, the first so many metres."""
    tilt: Degrees = 50.0
    """From straight down, at most [deg]."""
    solutions: Few = 4
    """Solutions of the inverse kinematics that are tried for a grasp."""


@dataclass(frozen=True, eq=False)
class Station:
    """A way to hold a block at a pose by a grasp.

    Attributes:
        grasp: Number of the grasp.
        q: [7] joints [rad] with the block between the fingers.
        approach: [M, 7] joints [rad] from before the block to q, gripper open.
        lift: [M, 7] joints [rad] from q to above, the block held.
        held: The block in the hand.
    """

    grasp: int
    q: np.ndarray
    approach: np.ndarray
    lift: np.ndarray
    held: Held

    @property
    def before(self) -> np.ndarray:
        """[7] where the approach begins."""
        return self.approach[0]

    @property
    def above(self) -> np.ndarray:
        """[7] where the lift ends."""
        return self.lift[-1]


def tilts(where: np.ndarray, grasps: list[Grasp]) -> np.ndarray:
    """[G] angle [rad] between straight down and the approach of each grasp of a block at a pose [4, 4]."""
    approaches = np.array([grasp.pose[:3, 2] for grasp in grasps]).reshape(-1, 3)
    return np.arccos(np.clip(-(approaches @ where[2, :3]), -1.0, 1.0))


def posture(target: np.ndarray) -> np.ndarray:
    """[7] the arm at rest, turned towards a pose [4, 4]: joints near it are near each other, and moves short."""
    q = REST.copy()
    q[0] = np.clip(np.arctan2(target[1, 3], target[0, 3]), LOWER[0], UPPER[0])
    return q


def find_station(
    belief: Belief,
    block: int,
    where: np.ndarray,
    number: int,
    grasp: Grasp,
    reach: Reach,
    motion: MotionSettings,
    overlap: float,
    ignore: Collection[int] = (),
) -> Station | None:
    """The first way found to hold a block at a pose [4, 4] by a grasp that touches nothing else; None: there is none.

    The block itself is no obstacle at the place where it lies now.

    Args:
        belief: Where everything is thought to be.
        block: Its number.
        where: [4, 4] pose of the block.
        number: Of the grasp, as the station names it.
        grasp: The grasp.
        reach: Of the arm.
        motion: The settings.
        overlap: The block may seem to sink so far into what it stands on [m]: pose estimates are not exact.
        ignore: Blocks that do not count.
    """
    target = where @ grasp.pose
    down = target[:3, 2]
    held = Held(block, inverse(grasp.pose))
    backwards = [moved(target, -down * reach.approach * i / APPROACH_STEPS) for i in range(1, APPROACH_STEPS + 1)]
    upwards = [moved(target, (0, 0, reach.lift * i / LIFT_STEPS)) for i in range(1, LIFT_STEPS + 1)]

    def clear(q: np.ndarray) -> bool:
        return not belief.touches(q, None, motion.near, ignore={block, *ignore})

    def clear_with(q: np.ndarray, overlap: float) -> bool:
        return not belief.touches(q, held, motion.near, held_clearance=overlap, ignore=ignore)

    for q in inverse_kinematics(target, posture(target))[: reach.solutions]:
        if not clear(q):
            continue
        back, up = straight(backwards, q), straight(upwards, q)
        if back is None or up is None:
            continue
        if belief.touches(back[-1], None, motion.clearance, ignore={block, *ignore}):
            continue
        if belief.touches(up[-1], held, motion.clearance, ignore=ignore):
            continue
        if all(clear(q) for q in back[:-1]) and all(clear_with(q, -overlap) for q in [q, *up[:-1]]):
            return Station(number, q, np.vstack([back[::-1], q]), np.vstack([q, up]), held)
    return None
