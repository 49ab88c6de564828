"""How the robot sees, handles blocks, judges, and what it may ask of a person."""

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from apf.settings import Degrees, Deviation, Few, Number, settings


@settings
class Sight:
    """Errors of a pose estimate: they stand in for cameras."""

    position: Deviation = 0.0005
    """[m] standard deviation on each axis."""
    rotation: Annotated[Number, Field(ge=0, le=180)] = 0.2
    """[deg] standard deviation about each axis."""


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
    """A block is at home if it seems to be so near to its place [m], four standard deviations of the estimate added,"""
    home_rotation: Degrees = 8.0
    """and so little turned [deg]."""
