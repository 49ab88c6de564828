"""Which physics a reality has, and what every reality offers besides the robot's hardware."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from importlib.util import find_spec
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from pydantic import Field, model_validator

from apf.panda.grasps import Gripper
from apf.panda.hardware import Hardware, Person
from apf.panda.layout import Layout
from apf.panda.reality.photographer import Photographer, State
from apf.panda.settings import Arm
from apf.panda.vision.cameras import WristCamera
from apf.settings import Few, Number, Whole, settings
from apf.towers import BlockSet


class Reality(Hardware, Person, Protocol):
    """A simulated robot and its table: hardware for the robot, and for the world what only a simulation has."""

    photographer: Photographer
    on_step: Callable[[Any], None] | None
    """Called after every step, e.g. to film."""
    steps: int
    """Since the scene was built."""

    @property
    def rate(self) -> int:
        """Steps in a second."""
        ...

    def begin(self, blocks: BlockSet, poses: np.ndarray, rng: np.random.Generator) -> None:
        """Begin anew: the arm at rest, its gripper open, and each block at its pose; nothing moves yet.

        Args:
            blocks: The set, as its file says.
            poses: [B, 4, 4] of the blocks.
            rng: The source of the noise of images, and of how blocks jump when they are let go.
        """
        ...

    def state(self) -> State:
        """How things really are."""
        ...

    def pose_of(self, index: int) -> np.ndarray:
        """[4, 4] of a block's centre of geometry."""
        ...

    def poses(self) -> np.ndarray:
        """[B, 4, 4] of all blocks."""
        ...

    def close(self) -> None:
        """Give everything back."""
        ...


@settings
class Physics(ABC):
    """The physics of a reality."""

    @abstractmethod
    def reality(
        self,
        layout: Layout,
        arm: Arm,
        gripper: Gripper,
        hold: Literal["friction", "constraint"],
        photographer: Photographer,
        wrist: WristCamera,
        gui: bool,
    ) -> Reality:
        """A reality of this physics.

        Args:
            layout: Places on the table.
            arm: Speeds of the joints.
            gripper: What the fingers can hold.
            hold: How the hand holds a block: by friction alone, or tied to the hand, too (constraint).
            photographer: Takes the images; it knows the flaws of this robot.
            wrist: The camera on the hand.
            gui: Show a window?
        """


@settings
class Bullet(Physics):
    """PyBullet."""

    rate: Annotated[Whole, Field(ge=60, le=10000)] = 240
    """Steps in a second."""
    iterations: Few = 200
    """Of the contact solver in each step; with PyBullet's usual 50 towers creep."""
    friction: Annotated[Number, Field(gt=0, le=10)] = 0.6
    """Coefficient of blocks, table and pedestal."""

    def reality(
        self,
        layout: Layout,
        arm: Arm,
        gripper: Gripper,
        hold: Literal["friction", "constraint"],
        photographer: Photographer,
        wrist: WristCamera,
        gui: bool,
    ) -> Reality:
        """See `Physics.reality`.

        Args:
            layout: Places on the table.
            arm: Speeds of the joints.
            gripper: What the fingers can hold.
            hold: How the hand holds a block: by friction alone, or tied to the hand, too (constraint).
            photographer: Takes the images; it knows the flaws of this robot.
            wrist: The camera on the hand.
            gui: Show a window?
        """
        from apf.panda.reality.bullet import BulletReality

        return BulletReality(layout, self, arm, gripper, hold, photographer, wrist, gui)


@settings
class Mujoco(Physics):
    """MuJoCo: contacts are a little soft, and friction is solved for exactly. Needs `pip install "apf[mujoco]"`."""

    rate: Annotated[Whole, Field(ge=100, le=10000)] = 500
    """Steps in a second."""
    iterations: Few = 100
    """Of the contact solver in each step, at most."""
    friction: Annotated[Number, Field(gt=0, le=10)] = 0.6
    """Coefficient of blocks, table and pedestal; a contact has the product of both bodies' coefficients."""
    contact: Annotated[Number, Field(ge=0.001, le=1)] = 0.006
    """Time in which two bodies that overlap are pushed apart [s]; at least two steps."""
    grip: Annotated[Number, Field(ge=1, le=1000)] = 10.0
    """How much stiffer friction is than the contact itself: with 1, what is held slowly slips."""

    @model_validator(mode="after")
    def _two_steps(self) -> "Mujoco":
        if self.contact < 2 / self.rate:
            raise ValueError(f"contact={self.contact:g} is less than two steps of 1/{self.rate} s")
        if find_spec("mujoco") is None:
            raise ValueError("MuJoCo is not installed: pip install 'apf[mujoco]'")
        return self

    def reality(
        self,
        layout: Layout,
        arm: Arm,
        gripper: Gripper,
        hold: Literal["friction", "constraint"],
        photographer: Photographer,
        wrist: WristCamera,
        gui: bool,
    ) -> Reality:
        """See `Physics.reality`.

        Args:
            layout: Places on the table.
            arm: Speeds of the joints.
            gripper: What the fingers can hold.
            hold: How the hand holds a block: by friction alone, or tied to the hand, too (constraint).
            photographer: Takes the images; it knows the flaws of this robot.
            wrist: The camera on the hand.
            gui: Show a window? There is none for this physics.
        """
        from apf.panda.reality.mujoco import MujocoReality

        return MujocoReality(layout, self, arm, gripper, hold, photographer, wrist, gui)
