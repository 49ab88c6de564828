"""What the robot can hold and reach: refused before anything moves, if it cannot."""

import numpy as np

from apf.errors import InputError
from apf.panda.geometry import pose
from apf.panda.grasps import Gripper, grasps_of
from apf.panda.kinematics import inverse_kinematics
from apf.panda.layout import Layout
from apf.panda.stations import Reach, posture
from apf.panda.vision.cameras import STATIC, Cameras
from apf.panda.vision.legibility import too_small
from apf.towers import BlockSet, Towers

DOWN = np.diag([1.0, -1.0, -1.0])
LONGEST = 0.15
"""A longer block [m] would stand in its neighbours' way at home."""
FARTHEST = 0.85
"""From the robot's own place [m]: nowhere does the arm put a block beyond."""
HEAVIEST = 2.0
"""[kg] that the arm and the gripper carry."""


def check_blocks(blocks: BlockSet, gripper: Gripper, layout: Layout) -> None:
    """Raises InputError, naming block and limit, if the gripper cannot hold one, or there are too many.

    Args:
        blocks: The set.
        gripper: What the fingers can hold.
        layout: Places on the table.
    """
    if len(blocks) > len(layout.homes_at):
        raise InputError(f"there are {len(blocks)} blocks; the table has places for {len(layout.homes_at)}")
    for name, dims, mass in zip(blocks.name, blocks.dims, blocks.mass):
        if dims.min() > gripper.widest:
            raise InputError(
                f"block {name}: its shortest side is {dims.min():.3f} m; the gripper takes at most {gripper.widest:g} m"
            )
        if not grasps_of(dims, gripper):
            raise InputError(f"block {name}: its sides are {dims.round(3).tolist()} m; the fingers find no hold on it")
        if dims.max() > LONGEST:
            raise InputError(f"block {name}: its longest side is {dims.max():.3f} m; it may be {LONGEST:g} m at most")
        if mass > HEAVIEST:
            raise InputError(f"block {name}: its mass is {mass:g} kg; the arm carries at most {HEAVIEST:g} kg")


def check_legible(blocks: BlockSet, layout: Layout, cameras: Cameras) -> None:
    """Raises InputError, naming block, camera and pixels, if no camera beside the table reads a block at home.

    Args:
        blocks: The set.
        layout: Places on the table.
        cameras: Of the robot.
    """
    static = {name: camera for name, camera in cameras.named().items() if name in STATIC}
    places = {name: camera.mounting for name, camera in static.items()}
    found = too_small(blocks, layout.home_poses(blocks.dims), static, places)
    for name in blocks.name:
        of_block = [each for each in found if each.block == name]
        if len(of_block) == len(static):
            raise InputError(
                f"{max(of_block, key=lambda each: each.pixels)}, and no other camera sees it better: it takes larger "
                "blocks, or a camera that is nearer or has more pixels"
            )


def check_height(height: float, layout: Layout, reach: Reach) -> None:
    """Raises InputError if a tower of that height [m] is higher than the arm can put a block on.

    Args:
        height: Of the tower [m].
        layout: Places on the table.
        reach: Of the arm.
    """
    limit = highest(layout, reach)
    if height > limit:
        raise InputError(f"the tower is {height:.3f} m high; over its base the arm reaches up to {limit:.2f} m")


def check_places(towers: Towers, layout: Layout) -> None:
    """Raises InputError, naming the block, if one belongs where the table or the arm does not reach."""
    for places, blocks in zip(towers.xy + np.array(layout.base), towers.block):
        for (x, y), block in zip(places, blocks):
            name = towers.blocks.name[block]
            if not layout.holds(np.array([x, y, 0.0])):
                raise InputError(
                    f"block {name}: its place, x = {x:.3f}, y = {y:.3f} m from the robot, is off the table"
                )
            if np.hypot(x, y) > FARTHEST:
                far = np.hypot(x, y)
                raise InputError(f"block {name}: its place is {far:.3f} m from the robot; it reaches {FARTHEST:g} m")


def highest(layout: Layout, reach: Reach) -> float:
    """Largest height of a tower [m]: the arm, its hand pointing down, can still lower the top block onto the tower."""
    for centimetres in range(100, 0, -1):
        target = pose((*layout.base, centimetres / 100 + reach.lift), DOWN)
        if len(inverse_kinematics(target, posture(target))):
            return centimetres / 100
    return 0.0
