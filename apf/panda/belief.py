"""What the robot believes of the world, and whether a motion would touch any of it. Planning sees nothing else."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from apf.panda.geometry import to_vector
from apf.panda.kinematics import REST, forward
from apf.panda.scene import CAMERA, HAND, LEFT, RIGHT, Scene
from apf.towers import BlockSet

UPPER_ARM = (2, 3, 4, 5, 6, HAND, LEFT, RIGHT, CAMERA)
"""Links that move enough to reach the table; base and first link never leave it."""
SELF = [(link, other) for link in (5, 6, HAND, CAMERA) for other in (-1, 0, 1, 2)]
"""Pairs of links that the joints' ends do not keep apart."""
LOWER_LINKS = (-1, 0, 1, 2, 3, 4, 5)
"""Links that a held block can come to touch."""


@dataclass(frozen=True, eq=False)
class Held:
    """A block in the gripper, and where [4, 4] it is in the grasp target's frame."""

    block: int
    pose: np.ndarray


class Belief(Scene):
    """A scene without physics, in which blocks lie where they are thought to be."""

    def build(self, blocks: BlockSet, poses: np.ndarray, q: np.ndarray = REST) -> None:
        """See `Scene.build`.

        Args:
            blocks: The set.
            poses: [B, 4, 4] of the blocks.
            q: [7] joints [rad].
        """
        super().build(blocks, poses, q)
        self.thought = poses.copy()
        self.halves = blocks.dims / 2
        self.radii = np.linalg.norm(self.halves, axis=1)

    def update(self, poses: np.ndarray) -> None:
        """Blocks are thought to be at these poses [B, 4, 4] now."""
        self.thought = poses.copy()
        for i, where in enumerate(poses):
            self.put(i, where)

    def touches(
        self,
        q: np.ndarray,
        held: Held | None = None,
        clearance: float = 0.0,
        held_clearance: float | None = None,
        ignore: Collection[int] = (),
    ) -> bool:
        """Would the arm at joints q [7], or what it holds, come closer than `clearance` [m] to anything, or to itself?

        Args:
            q: [7] joints [rad].
            held: What the hand holds, if anything.
            clearance: [m] from everything else.
            held_clearance: [m] of the held block; negative: it may overlap by so much, as where it stands or was seen.
            ignore: Blocks that do not count.
        """
        self.pose_arm(q)
        blocks = [b for i, b in enumerate(self.bodies) if i not in ignore and (held is None or i != held.block)]
        obstacles = [*blocks, self.pedestal, self.table]
        robot, closest = self.robot, self.client.getClosestPoints
        if self._arm_touches(obstacles, clearance):
            return True
        if any(closest(robot, robot, 0.0, linkIndexA=a, linkIndexB=b) for a, b in SELF):
            return True
        if held is None:
            return False
        return self._held_touches(held, forward(q) @ held.pose, blocks, clearance, held_clearance)

    def _held_touches(
        self, held: Held, where: np.ndarray, blocks: list[int], clearance: float, held_clearance: float | None
    ) -> bool:
        limit = clearance if held_clearance is None else held_clearance
        half = self.halves[held.block]
        if where[2, 3] - np.abs(where[2, :3]) @ half < limit:  # its lowest corner and the table
            return True
        body, closest = self.bodies[held.block], self.client.getClosestPoints
        near = (
            np.linalg.norm(self.thought[:, :3, 3] - where[:3, 3], axis=1) < self.radii + self.radii[held.block] + 0.02
        )
        others = [self.pedestal, *(b for b, is_near in zip(self.bodies, near) if is_near and b in blocks)]
        vector = to_vector(where)
        self.client.resetBasePositionAndOrientation(body, vector[:3].tolist(), vector[3:].tolist())
        found = any(point[8] < limit for other in others for point in closest(body, other, max(limit, 0.0))) or any(
            closest(body, self.robot, 0.0, linkIndexB=link) for link in LOWER_LINKS
        )
        self.put(held.block, self.thought[held.block])
        return found

    def _arm_touches(self, obstacles: list[int], clearance: float) -> bool:
        closest = self.client.getClosestPoints
        for other in obstacles:
            for point in closest(self.robot, other, clearance):
                if point[8] < clearance and not (other == self.table and point[3] not in UPPER_ARM):
                    return True
        return False

    def touched(self, q: np.ndarray, clearance: float) -> list[int]:
        """The blocks that the arm at joints q [7] would come closer to than `clearance` [m]."""
        self.pose_arm(q)
        return [
            i
            for i, body in enumerate(self.bodies)
            if any(point[8] < clearance for point in self.client.getClosestPoints(self.robot, body, clearance))
        ]

    def fits(self, block: int, where: np.ndarray, clearance: float) -> bool:
        """Is there room for a block at a pose [4, 4], `clearance` [m] from all other blocks?

        Args:
            block: Its number.
            where: [4, 4] pose.
            clearance: [m] from all other blocks.
        """
        return not self.in_the_way(block, where, clearance)

    def in_the_way(self, block: int, where: np.ndarray, clearance: float) -> list[int]:
        """The blocks that are closer than `clearance` [m] to this one if it were at a pose [4, 4].

        Args:
            block: Its number.
            where: [4, 4] pose.
            clearance: [m] from all other blocks.
        """
        body = self.bodies[block]
        self.put(block, where)
        found = [
            i
            for i, other in enumerate(self.bodies)
            if i != block
            and any(point[8] < clearance for point in self.client.getClosestPoints(body, other, max(clearance, 0.0)))
        ]
        self.put(block, self.thought[block])
        return found
