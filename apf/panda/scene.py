"""What belief and reality have in common: one PyBullet world each, with the same bodies in the same order."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from apf.panda.client import connect
from apf.panda.geometry import from_vector, to_vector
from apf.panda.kinematics import JOINTS, REST
from apf.panda.layout import Layout
from apf.panda.model import urdf
from apf.panda.vision.cameras import WristCamera
from apf.towers import BlockSet

ARM = list(range(JOINTS))
HAND, LEFT, RIGHT, TARGET, CAMERA = 8, 9, 10, 11, 12
"""Links of the URDF: the hand, its two fingers, the point between their tips, and the camera on the hand."""
FINGERS = [LEFT, RIGHT]
OPEN = 0.04
"""Position of each finger when the gripper is open [m]."""
TABLE_THICKNESS = 0.1
MARK = (0.16, 0.16, 0.0005)
"""The tower's base is a mark on the table, as large as this [m]; nothing collides with it."""

WOOD, STONE, GREEN = (0.78, 0.67, 0.52, 1), (0.5, 0.53, 0.57, 1), (0.35, 0.55, 0.42, 1)
COLOURS = [
    (0.12, 0.47, 0.71, 1),
    (1.00, 0.50, 0.05, 1),
    (0.17, 0.63, 0.17, 1),
    (0.84, 0.15, 0.16, 1),
    (0.58, 0.40, 0.74, 1),
    (0.55, 0.34, 0.29, 1),
    (0.89, 0.47, 0.76, 1),
    (0.45, 0.45, 0.45, 1),
    (0.74, 0.74, 0.13, 1),
    (0.09, 0.75, 0.81, 1),
]
"""Of the blocks, in the order of the set."""


class Scene:
    """Table, pedestal, arm and blocks in a PyBullet client of their own.

    A scene is never restored: `build` empties the client and inserts all bodies anew, in one order.
    """

    movable = False
    """Do blocks have mass?"""
    plain = False
    """Is the arm drawn as what it collides with? An image then takes less time."""

    def __init__(self, layout: Layout, wrist: WristCamera | None = None, gui: bool = False) -> None:
        self.layout, self.wrist = layout, wrist or WristCamera()
        self.client = connect(gui)
        self.blocks: BlockSet | None = None
        self.bodies: list[int] = []

    def close(self) -> None:
        """Give the client back."""
        if self.client.isConnected():
            self.client.disconnect()

    def build(self, blocks: BlockSet, poses: np.ndarray, q: np.ndarray = REST) -> None:
        """Begin anew: the arm at q [7], its gripper open, and each block of the set at its pose [B, 4, 4].

        Args:
            blocks: The set.
            poses: [B, 4, 4] of the blocks.
            q: [7] joints [rad].
        """
        self.client.resetSimulation()
        self.blocks = blocks
        (x0, x1), (y0, y1) = self.layout.table_x, self.layout.table_y
        with self._unseen():
            self.table = self._box(
                (x1 - x0, y1 - y0, TABLE_THICKNESS), ((x0 + x1) / 2, (y0 + y1) / 2, -TABLE_THICKNESS / 2), WOOD
            )
            width, depth, height = self.layout.pedestal_size
            self.pedestal = self._box((width, depth, height), (*self.layout.pedestal, height / 2), STONE)
            self._box(MARK, (*self.layout.base, 0), GREEN, collides=False)
            flags = self.client.URDF_ENABLE_CACHED_GRAPHICS_SHAPES
            self.robot = self.client.loadURDF(urdf(self.wrist, self.plain), useFixedBase=True, flags=flags)
            self.bodies = [self._block(i) for i in range(len(blocks))]
        for i, where in enumerate(poses):
            self.put(i, where)
        self.pose_arm(q)
        self.client.resetJointStatesMultiDof(self.robot, FINGERS, [[OPEN], [OPEN]])

    @contextmanager
    def _unseen(self) -> Iterator[None]:
        """A window draws only what is there in the end."""
        self.client.configureDebugVisualizer(self.client.COV_ENABLE_RENDERING, 0)
        yield
        self.client.configureDebugVisualizer(self.client.COV_ENABLE_RENDERING, 1)

    def _box(
        self, size: tuple[float, ...], position: tuple[float, ...], colour: tuple[float, ...], collides: bool = True
    ) -> int:
        half = [side / 2 for side in size]
        shape = self.client.createCollisionShape(self.client.GEOM_BOX, halfExtents=half) if collides else -1
        visual = self.client.createVisualShape(self.client.GEOM_BOX, halfExtents=half, rgbaColor=colour)
        return self.client.createMultiBody(0, shape, visual, position)

    def _block(self, index: int) -> int:
        assert self.blocks is not None
        half = (self.blocks.dims[index] / 2).tolist()
        shape = self.client.createCollisionShape(self.client.GEOM_BOX, halfExtents=half)
        mass = float(self.blocks.mass[index]) if self.movable else 0.0
        com = self._com(index).tolist()
        body = self.client.createMultiBody(
            mass, shape, self._visual(index), baseInertialFramePosition=com, basePosition=(0, 0, 10 + index)
        )
        self._finish(body, index)
        return body

    def _visual(self, index: int) -> int:
        """How a block looks."""
        assert self.blocks is not None
        half, colour = (self.blocks.dims[index] / 2).tolist(), COLOURS[index % len(COLOURS)]
        return self.client.createVisualShape(self.client.GEOM_BOX, halfExtents=half, rgbaColor=colour)

    def _finish(self, body: int, index: int) -> None:
        """Called when the body of a block was made."""

    def _com(self, index: int) -> np.ndarray:
        """PyBullet states a body's pose at its centre of mass; without mass it is the centre of geometry here."""
        assert self.blocks is not None
        return self.blocks.com[index] if self.movable else np.zeros(3)

    def put(self, index: int, where: np.ndarray) -> None:
        """A block at a pose [4, 4] of its centre of geometry, at rest."""
        vector = to_vector(where)
        position = vector[:3] + where[:3, :3] @ self._com(index)
        self.client.resetBasePositionAndOrientation(self.bodies[index], position.tolist(), vector[3:].tolist())
        self.client.resetBaseVelocity(self.bodies[index], (0, 0, 0), (0, 0, 0))

    def pose_of(self, index: int) -> np.ndarray:
        """[4, 4] of a block's centre of geometry."""
        position, quaternion = self.client.getBasePositionAndOrientation(self.bodies[index])
        where = from_vector((*position, *quaternion))
        where[:3, 3] -= where[:3, :3] @ self._com(index)
        return where

    def poses(self) -> np.ndarray:
        """[B, 4, 4] of all blocks."""
        return np.array([self.pose_of(i) for i in range(len(self.bodies))]).reshape(-1, 4, 4)

    def pose_arm(self, q: np.ndarray) -> None:
        """The arm's joints at q [7], at once."""
        self.client.resetJointStatesMultiDof(self.robot, ARM, q[:, None].tolist())

    def joints(self) -> np.ndarray:
        """[7] of the arm."""
        return np.array([state[0] for state in self.client.getJointStates(self.robot, ARM)])
