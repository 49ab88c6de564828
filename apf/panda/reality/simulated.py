"""What every simulated robot has, whatever its physics: a clock, cameras, motions, and the flaws of the robot."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from apf.panda.flaws import Drawn
from apf.panda.hardware import Image
from apf.panda.kinematics import REST
from apf.panda.reality.photographer import Photographer, State
from apf.panda.reality.profile import motion_along
from apf.panda.scene import OPEN
from apf.panda.settings import Arm
from apf.towers import BlockSet

ARM_FORCES = [87.0] * 4 + [12.0] * 3
"""The Panda's largest torques [Nm]."""
FINGER_SPEED = 0.08
"""At which the fingers open and close [m/s]."""
FINGERS_STOPPED = 0.002
"""Slower than this [m/s] they hold something, or each other."""


class Simulated(ABC):
    """Hardware whose body is simulated. Time passes only in `step` and what calls it.

    Joints are said and taken as the robot measures them; `drawn.zeros` are between these and the true ones. A physics
    adds what is abstract here: bodies, one step of time, motors, contacts.

    Args:
        arm: Speeds of the joints.
        photographer: Takes the images; it knows the flaws of this robot.
        rate: Steps in a second.
    """

    def __init__(self, arm: Arm, photographer: Photographer, rate: int) -> None:
        self.arm, self.photographer, self.rate = arm, photographer, rate
        self.steps = 0
        self.on_step: list[Callable[[Any], None]] = []
        """Called after every step, e.g. to film."""
        self._held: int | None = None

    @property
    def drawn(self) -> Drawn:
        """The flaws of this robot."""
        return self.photographer.drawn

    def begin(self, blocks: BlockSet, poses: np.ndarray, rng: np.random.Generator) -> None:
        """See `Reality.begin`.

        Args:
            blocks: The set, as its file says.
            poses: [B, 4, 4] of the blocks.
            rng: The source of the noise of images, and of how blocks jump when they are let go.
        """
        self.rng, self.known, self.real = rng, blocks, self.drawn.blocks(blocks)
        self.steps, self._held = 0, None
        self._begin(self.real, self.drawn.friction(blocks), poses, REST + self.drawn.zeros)
        self._command(REST + self.drawn.zeros, np.zeros_like(REST))
        self._fingers(FINGER_SPEED)

    def step(self, n: int = 1) -> None:
        """Let n steps of time pass."""
        for _ in range(n):
            self._step()
            self.steps += 1
            for call in self.on_step:
                call(self)

    @abstractmethod
    def put(self, index: int, where: np.ndarray) -> None:
        """See `Person.put`."""

    @abstractmethod
    def close(self) -> None:
        """Give everything back."""

    def state(self) -> State:
        """How things really are."""
        return State(self.poses(), self._joints(), self._finger_places(), self.grasp_target())

    def poses(self) -> np.ndarray:
        """[B, 4, 4] of all blocks."""
        return np.array([self.pose_of(i) for i in range(len(self.real))]).reshape(-1, 4, 4)

    # -- the robot's hardware -----------------------------------------------------------------------------------

    def seconds(self) -> float:
        """Simulated time since the scene was built."""
        return self.steps / self.rate

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self.step(round(seconds * self.rate))

    def images(self, names: Collection[str]) -> dict[str, Image]:
        """See `Hardware.images`."""
        return self.photographer.images(names, self.known, self.state(), self.rng)

    def joints(self) -> np.ndarray:
        """[7] of the arm, as it measures them [rad]."""
        return self._joints() - self.drawn.zeros

    def follow(self, path: np.ndarray, speed: float) -> None:
        """See `Hardware.follow`."""
        whole = np.vstack([self.joints(), path]) + self.drawn.zeros
        for joints, velocities in motion_along(whole, speed, self.arm.acceleration, self.rate):
            for q, velocity in zip(joints, velocities):
                self._command(q, velocity)
                self.step()

    def width(self) -> float:
        """Between the fingers [m]."""
        return sum(self._finger_places())

    def grip(self) -> None:
        """Close the fingers until they stop, and hold on. With hold=constraint a block between them is tied, too."""
        self._fingers(-FINGER_SPEED)
        self.wait(0.1)
        for _ in range(self.rate):
            self.step()
            if self._finger_speed() < FINGERS_STOPPED:
                break
        self.wait(0.1)
        self._held = self._between_fingers()
        self._on_grip(self._held)

    def release(self) -> None:
        """Open the fingers, first so gently that both let go together: what they press on must not jump."""
        held, self._held = self._held, None
        self._on_release(held)
        for share in (0.3, 0.1, 0.03):
            self._fingers(-FINGER_SPEED, share)
            self.wait(0.04)
        self._fingers(FINGER_SPEED / 4)
        self.wait(0.05)
        self._fingers(FINGER_SPEED)
        for _ in range(self.rate):
            self.step()
            if self.width() > 2 * OPEN - 0.001:
                break
        if held is not None:
            self._slide(held)  # now, as open fingers leave room for it

    def _slide(self, block: int) -> None:
        """Move a block that was let go by what this robot's flaws say."""
        com = self.pose_of(block)[:3, :3] @ self.real.com[block]
        shift = self.drawn.on_release(com, self.grasp_target()[:3, 1], self.rng)
        if shift.any():
            self._shift(block, shift)

    # -- the physics --------------------------------------------------------------------------------------------

    @abstractmethod
    def _begin(self, blocks: BlockSet, friction: np.ndarray, poses: np.ndarray, q: np.ndarray) -> None:
        """Make all bodies; nothing moves, the gripper is open.

        Args:
            blocks: The set as it really is.
            friction: [B] factors of the friction of the blocks.
            poses: [B, 4, 4] of the blocks.
            q: [7] true joints [rad].
        """

    @abstractmethod
    def _step(self) -> None:
        """One step of time."""

    @abstractmethod
    def _joints(self) -> np.ndarray:
        """[7] true joints [rad]."""

    @abstractmethod
    def _command(self, q: np.ndarray, velocity: np.ndarray) -> None:
        """The arm's motors strive for true joints [7] [rad] and velocities [7] [rad/s]."""

    @abstractmethod
    def _finger_places(self) -> tuple[float, float]:
        """Of each finger from the middle [m]."""

    @abstractmethod
    def _finger_speed(self) -> float:
        """Of the faster finger [m/s]."""

    @abstractmethod
    def _fingers(self, speed: float, share: float = 1.0) -> None:
        """The fingers strive for a speed [m/s], positive to open, with a share of their force."""

    @abstractmethod
    def _between_fingers(self) -> int | None:
        """The block that both fingers touch."""

    @abstractmethod
    def _shift(self, block: int, shift: np.ndarray) -> None:
        """Move a block horizontally by [2] [m], at once; its velocity stays."""

    @abstractmethod
    def grasp_target(self) -> np.ndarray:
        """[4, 4] true pose of the point between the fingertips."""

    @abstractmethod
    def pose_of(self, index: int) -> np.ndarray:
        """[4, 4] of a block's centre of geometry."""

    @abstractmethod
    def _on_grip(self, block: int | None) -> None:
        """Called when the fingers have closed, with the block between them."""

    @abstractmethod
    def _on_release(self, block: int | None) -> None:
        """Called before the fingers open, with the block between them."""
