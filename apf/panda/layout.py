"""Where things are on the table: the tower's base, the pedestal for regrasping, a home for each block."""

from functools import cached_property
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from apf.panda.geometry import pose
from apf.settings import Coordinate, Metres, Number, settings

Interval = tuple[Coordinate, Coordinate]
Angles = Annotated[list[Annotated[Number, Field(gt=-160, lt=160)]], Field(max_length=1000)]

HOMES = (60.0, -70.0, 80.0, -90.0, 100.0, -110.0, 120.0, -130.0, 140.0, -150.0)
"""[deg] left and right in turn, so that every number of blocks is stored on both sides."""


@settings
class Layout:
    """All in the robot's frame [m]: x ahead, y to the left, z up, the origin where it stands, on the table's top."""

    table_x: Interval = (-0.75, 0.95)
    """From where to where the table reaches."""
    table_y: Interval = (-0.95, 0.95)
    base: tuple[Coordinate, Coordinate] = (0.45, 0.0)
    """Origin of a tower's coordinates [m]."""
    pedestal: tuple[Coordinate, Coordinate] = (0.4, -0.28)
    pedestal_size: tuple[Metres, Metres, Metres] = (0.09, 0.09, 0.10)
    homes_radius: Metres = 0.56
    """Of the arc around the robot on which the blocks are stored."""
    homes_at: Angles = Field(default_factory=lambda: list(HOMES))
    """[deg] where on the arc each block's place is, in the order of the set."""
    margin: Metres = 0.08
    """Least distance of base, pedestal and homes from the edges of the table [m]."""

    @model_validator(mode="after")
    def _on_the_table(self) -> "Layout":
        homes = {f"homes_at[{i}]={a:g}": xy for i, (a, xy) in enumerate(zip(self.homes_at, self.homes[:, :2, 3]))}
        for name, xy in {"base": self.base, "pedestal": self.pedestal, **homes}.items():
            for value, (low, high), axis in zip(xy, (self.table_x, self.table_y), "xy"):
                if not low + self.margin <= value <= high - self.margin:
                    raise ValueError(
                        f"{name}: {axis} is {value:g}; on this table it must be {low + self.margin:g} to "
                        f"{high - self.margin:g} m"
                    )
        return self

    @cached_property
    def homes(self) -> np.ndarray:
        """[places, 4, 4] spots on the table, not turned, z = 0."""
        angles = np.deg2rad(self.homes_at)
        return np.array([pose((self.homes_radius * np.cos(a), self.homes_radius * np.sin(a), 0)) for a in angles])

    def home_poses(self, dims: np.ndarray) -> np.ndarray:
        """[B, 4, 4] of blocks with sides dims [B, 3], each upright in its place."""
        poses = self.homes[: len(dims)].copy()
        poses[:, 2, 3] = dims[:, 2] / 2
        return poses

    def holds(self, position: np.ndarray) -> bool:
        """Is a point [3] above the table, and not below its top?"""
        (x0, x1), (y0, y1) = self.table_x, self.table_y
        return bool(x0 < position[0] < x1 and y0 < position[1] < y1 and position[2] > -0.02)
