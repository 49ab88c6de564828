"""What differs between reality and what the robot believes of itself and of the blocks, as with a real robot."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from apf.panda.geometry import disturbed
from apf.panda.vision.cameras import WRIST, Camera
from apf.rng import stream
from apf.settings import Deviation, Number, Seed, settings
from apf.towers import BlockSet

Share = Annotated[Number, Field(ge=0, le=1)]
Turn = Annotated[Number, Field(ge=0, le=45)]


@settings
class Flaws:
    """How far reality may be off. What is drawn is drawn once for a robot, but for `release`."""

    seed: Seed = 0
    """Of the robot: another seed is another robot of the same kind."""
    joints: Turn = 0.0
    """Of each joint's zero [deg], standard deviation."""
    hand_eye: Deviation = 0.0
    """Of the place of the camera on the hand [m], standard deviation on each axis,"""
    hand_eye_turn: Turn = 0.0
    """and about each axis [deg]."""
    static: Deviation = 0.0
    """Of the places of the cameras beside the table [m], standard deviation on each axis,"""
    static_turn: Turn = 0.0
    """and about each axis [deg]."""
    slide: Share = 0.0
    """A block that is let go slides by this share of the horizontal offset of its centre of mass, towards it."""
    drag: Deviation = 0.0
    """The gripper pulls a block that is let go so far to one side, along the line on which the fingers close [m]."""
    release: Deviation = 0.0
    """A block that is let go jumps, standard deviation on each horizontal axis [m]; drawn at each release."""
    mass: Share = 0.0
    """Of each block's mass, relative standard deviation."""
    com: Deviation = 0.0
    """Of each block's centre of mass [m], standard deviation on each axis; it stays inside the block."""
    friction: Annotated[Number, Field(gt=0, le=10)] = 1.0
    """Factor of the friction of blocks,"""
    friction_spread: Share = 0.0
    """and the relative standard deviation of this factor from block to block."""

    def drawn(self, cameras: Mapping[str, Camera]) -> "Drawn":
        """One robot.

        Args:
            cameras: By their names, where the robot believes them to be.
        """
        rng = stream(self.seed, "robot")
        zeros = np.deg2rad(self.joints) * rng.standard_normal(7)
        mounted = {}
        for name, camera in cameras.items():
            shift, turn = (self.hand_eye, self.hand_eye_turn) if name == WRIST else (self.static, self.static_turn)
            mounted[name] = disturbed(camera.mounting, shift, np.deg2rad(turn), rng)
        return Drawn(self, zeros, mounted)


@dataclass(frozen=True, eq=False)
class Drawn:
    """The flaws of one robot.

    zeros: [7] which every joint is really turned further by than is measured [rad]. mounted: by the name of the camera,
    [4, 4] where its optical frame really is in the robot's frame, or the hand's.
    """

    flaws: Flaws
    zeros: np.ndarray
    mounted: Mapping[str, np.ndarray]

    def blocks(self, blocks: BlockSet) -> BlockSet:
        """The blocks as they really are; each set has its own draws."""
        rng = stream(self.flaws.seed, f"blocks of {blocks.digest}")
        mass = blocks.mass * np.maximum(0.2, 1 + self.flaws.mass * rng.standard_normal(len(blocks)))
        inside = 0.45 * blocks.dims
        com = blocks.com + self.flaws.com * rng.standard_normal(blocks.com.shape)
        bound = np.maximum(inside, np.abs(blocks.com))
        return replace(blocks, mass=mass, com=np.clip(com, -bound, bound))

    def friction(self, blocks: BlockSet) -> np.ndarray:
        """[B] factors of the friction of the blocks."""
        rng = stream(self.flaws.seed, f"friction of {blocks.digest}")
        spread = np.maximum(0.2, 1 + self.flaws.friction_spread * rng.standard_normal(len(blocks)))
        return self.flaws.friction * spread

    def on_release(self, com: np.ndarray, closing: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """[2] by which a block moves horizontally when it is let go [m].

        Args:
            com: [3] its centre of mass from its middle, along the world's axes [m].
            closing: [3] unit vector of the line on which the fingers close.
            rng: The source of all draws.
        """
        jump = self.flaws.release * rng.standard_normal(2)
        return self.flaws.slide * com[:2] + self.flaws.drag * closing[:2] + jump
