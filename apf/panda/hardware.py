"""The boundary between the robot's mind and its body: all that planning, perception and judging know of reality.

Behind `Hardware` is a simulation (`apf.panda.reality`), or a real arm. A person who helps (`Person`) and the truth that
the account of errors is made of (`Witness`) are apart: no decision depends on the truth.
"""

from collections.abc import Callable, Collection
from typing import Protocol

import numpy as np

Image = np.ndarray
"""[height, width] uint8, grey."""

Witness = Callable[[int], np.ndarray]
"""Tells the true pose [4, 4] of a block, for the account alone. A real robot has none."""


class Refused(Exception):
    """The arm refused a motion, or stopped in it. Its message says why."""


class Hardware(Protocol):
    """An arm with seven joints, a gripper with two fingers, cameras and a clock."""

    def seconds(self) -> float:
        """The clock [s]."""
        ...

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        ...

    def joints(self) -> np.ndarray:
        """[7] measured joints of the arm [rad]."""
        ...

    def follow(self, path: np.ndarray, speed: float) -> None:
        """Move the joints along a path [M, 7] [rad], from rest to rest, the fastest joint at most at `speed` [rad/s].

        Raises:
            Refused: The arm does not move so.
        """
        ...

    def width(self) -> float:
        """Measured distance between the fingers [m]."""
        ...

    def grip(self) -> None:
        """Close the fingers until they stop, and hold on."""
        ...

    def release(self) -> None:
        """Open the fingers, gently."""
        ...

    def images(self, names: Collection[str]) -> dict[str, Image]:
        """What the cameras of these names see now. A camera that does not answer is left out."""
        ...


class Person(Protocol):
    """Somebody who helps the robot."""

    def put(self, index: int, where: np.ndarray) -> None:
        """Put a block at a pose [4, 4]."""
        ...
