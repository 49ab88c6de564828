"""Which physics a reality has, and what every reality offers besides the robot's hardware."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np

from apf.panda.grasps import Gripper
from apf.panda.hardware import Hardware, Person
from apf.panda.layout import Layout
from apf.panda.reality.photographer import Photographer, State
from apf.panda.settings import Arm
from apf.panda.vision.cameras import WristCamera
from apf.settings import settings
from apf.towers import BlockSet

Hold = Literal["friction", "constraint"]
"""How the hand holds a block: by friction alone, or tied to the hand, too."""


class Reality(Hardware, Person, Protocol):
    """A simulated robot and its table: hardware for the robot, and for the world what only a simulation has."""

    photographer: Photographer
    on_step: list[Callable[[Any], None]]
    """Called after every step, with this reality, e.g. to film."""
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


@dataclass(frozen=True, eq=False)
class Rig:
    """What a reality is made of, whatever its physics.

    Attributes:
        layout: Places on the table.
        arm: Speeds of the joints.
        gripper: What the fingers can hold.
        photographer: Takes the images; it knows the flaws of this robot.
        wrist: The camera on the hand.
        hold: How the hand holds a block: by friction alone, or tied to the hand, too (constraint).
        gui: Show a window?
    """

    layout: Layout
    arm: Arm
    gripper: Gripper
    photographer: Photographer
    wrist: WristCamera
    hold: Hold = "friction"
    gui: bool = False


@settings
class Physics(ABC):
    """The physics of a reality."""

    @abstractmethod
    def reality(self, rig: Rig) -> Reality:
        """A reality of this physics. Raises InputError if the physics has no window, and one is wanted."""
