"""How the robot sees, handles blocks, judges, and what it may ask of a person."""

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from apf.settings import CountOrNone, Degrees, Few, Number, settings


@settings
class Arm:
    """How fast the joints move."""

    speed: Annotated[Number, Field(ge=0.01, le=10)] = 1.5
    """[rad/s] of the fastest joint."""
    acceleration: Annotated[Number, Field(ge=0.01, le=100)] = 6.0
    """[rad/s^2] of the fastest joint."""
    careful: Annotated[Number, Field(ge=0.01, le=10)] = 0.6
    """[rad/s] near blocks: approach, lift, lower, retreat."""


@settings
class Sight:
    """How far pose estimates are trusted."""

    uncertainty: Annotated[Number, Field(ge=0, le=0.1)] = 0.004
    """Of the cameras beside the table [m]. Blocks may seem to overlap by four times as much; they count as at home
    within as much more."""
    still: Annotated[Number, Field(gt=0, le=1000)] = 8.0
    """A block whose markers are seen within so many pixels of where they should be has not moved."""
    refine: Annotated[Number, Field(gt=0, le=1)] = 0.03
    """The camera on the hand may move the estimate of a block so far before it is grasped [m]; beyond, the robot plans
    anew."""
    refine_turn: Degrees = 20.0
    """And turn it so far [deg]."""
    retries: CountOrNone = 5
    """A camera that does not answer is asked again so often; then the robot goes on without it."""
    retry_pause: Annotated[Number, Field(gt=0, le=60)] = 0.5
    """Time between two such attempts [s]."""
    blind: Few = 10
    """The run stops after so many looks in a row in which the cameras beside the table see no block at all."""

    @property
    def overlap(self) -> float:
        """By how much blocks may seem to overlap [m]."""
        return max(0.004, 4 * self.uncertainty)


@settings
class Handling:
    """How a block is held and put down."""

    correct: bool = True
    """Look at the block in the hand before it is lowered, and correct for how it lies there."""
    gap: Annotated[Number, Field(ge=0, le=0.1)] = 0.001
    """Height above its place at which the hand lets a block go [m]."""
    pause: Annotated[Number, Field(ge=0, le=60)] = 0.1
    """Time that the arm waits before the gripper opens [s]."""
    width: Annotated[Number, Field(gt=0, le=0.1)] = 0.006
    """A block counts as not held if the width between the fingers differs so much from the side of the block [m]."""
    slip: Annotated[Number, Field(gt=0, le=1)] = 0.03
    """A block counts as lost if it lies so far from its expected place in the hand [m]."""


@settings
class Judging:
    """When a prefix stands: the last block is where it should be."""

    settle: Annotated[Number, Field(gt=0, le=60)] = 1.0
    """Simulated time between a placement and its judgement [s]."""
    position: Annotated[Number, Field(gt=0, le=1)] = 0.02
    """Largest distance of the block from its place [m]."""
    rotation: Annotated[Number, Field(gt=0, lt=90)] = 12.0
    """Largest turn of the block [deg]."""


class Help(StrEnum):
    """What happens when the robot cannot go on by itself."""

    AUTO = "auto"
    """The program puts the block home, as a person would. The account counts this."""
    ASK = "ask"
    """A person at the terminal is asked to put it home."""
    STOP = "stop"
    """The run stops; it can be resumed."""


@settings
class Recovery:
    """How often the robot tries again."""

    attempts: Few = 4
    """Attempts to place a block of a tower, before the plan is given up."""
    tries: Few = 5
    """Attempts to bring a block home, before a person is needed."""
    home_position: Annotated[Number, Field(gt=0, le=1)] = 0.015
    """A block is at home if it seems to be so near to its place [m], four times the uncertainty of sight added,"""
    home_rotation: Degrees = 8.0
    """and so little turned [deg]."""
