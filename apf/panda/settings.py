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
    """It is let go this far above where it will lie [m]."""
    pause: Annotated[Number, Field(ge=0, le=60)] = 0.1
    """Before the gripper opens [s]."""
    width: Annotated[Number, Field(gt=0, le=0.1)] = 0.006
    """It is not held if the fingers are wider or narrower than its side by so much [m]."""
    slip: Annotated[Number, Field(gt=0, le=1)] = 0.03
    """It is lost if it lies so far from where it should in the hand [m]."""


@settings
class Judging:
    """When a prefix stands: the last block is where it should be."""

    settle: Annotated[Number, Field(gt=0, le=60)] = 1.0
    """Seconds after a placement, simulated."""
    position: Annotated[Number, Field(gt=0, le=1)] = 0.02
    """[m] it may be away from its place."""
    rotation: Annotated[Number, Field(gt=0, lt=90)] = 12.0
    """[deg] it may be turned."""


class Help(StrEnum):
    """What happens when the robot cannot go on by itself."""

    AUTO = "auto"
    """The block is put home, as a person would, and counted."""
    ASK = "ask"
    """A person at the terminal is asked to put it home."""
    STOP = "stop"
    """The run stops; it can be resumed."""


@settings
class Recovery:
    """How often the robot tries again."""

    attempts: Few = 4
    """To place a block of a tower, before the plan is given up."""
    tries: Few = 5
    """To bring a block home, before a person is needed."""
    home_position: Annotated[Number, Field(gt=0, le=1)] = 0.015
    """A block is at home if it seems to be so near to its place [m], four standard deviations of the estimate added,"""
    home_rotation: Degrees = 8.0
    """and so little turned [deg]."""
