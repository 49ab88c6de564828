"""How a gripper with two parallel fingers can hold a cuboid."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from apf.panda.geometry import pose
from apf.settings import Number, settings

ANGLES = np.deg2rad(np.arange(0, 360, 15))
"""Directions of approach around the axis along which the fingers close."""
FINGERTIP = 0.008
"""A pad touches the face at least this far [m] from the face's edge."""


@settings
class Gripper:
    """The hand, and how it holds."""

    widest: Annotated[Number, Field(gt=0, le=0.08)] = 0.075
    """The longest side that it takes between the fingers [m]; they open to 0.08 m."""
    depth: Annotated[Number, Field(gt=0, le=0.1)] = 0.036
    """A block reaches this far [m] past the grasp target towards the palm, at most."""
    force: Annotated[Number, Field(gt=0, le=1000)] = 40.0
    """Of each finger [N]."""
    friction: Annotated[Number, Field(gt=0, le=10)] = 1.0
    """Coefficient of the fingers' pads; a contact has the product of both bodies' coefficients."""


@dataclass(frozen=True, eq=False)
class Grasp:
    """A grasp of a block.

    pose: [4, 4] grasp target in the block's frame: z is the approach, the fingers close along y. width: the side [m]
    between the fingers. offset: how far from the middle of the block along the third axis [m].
    """

    pose: np.ndarray
    width: float
    offset: float


def grasps_of(dims: np.ndarray, gripper: Gripper) -> list[Grasp]:
    """All grasps of a block with sides dims [3], in the middle first; none if every side is too long."""
    found = []
    for closing in range(3):
        if dims[closing] > gripper.widest:
            continue
        first, second = (axis for axis in range(3) if axis != closing)
        for share in (0.0, 0.25, -0.25):
            for sign in (1.0, -1.0):
                for turn in ANGLES:
                    grasp = _grasp(dims, closing, first, second, sign, turn, share, gripper)
                    if grasp is not None:
                        found.append(grasp)
    return sorted(found, key=lambda grasp: abs(grasp.offset))


def _grasp(
    dims: np.ndarray, closing: int, first: int, second: int, sign: float, turn: float, share: float, gripper: Gripper
) -> Grasp | None:
    """None if the fingertips would miss the face."""
    approach, y = np.zeros(3), np.zeros(3)
    approach[first], approach[second], y[closing] = np.cos(turn), np.sin(turn), sign
    approach[np.abs(approach) < 1e-12] = 0.0
    x = np.cross(y, approach)
    behind = np.abs(approach) @ dims / 2
    offset = share * float(np.abs(x) @ dims)
    target = -approach * max(0.0, behind - gripper.depth) + x * offset
    others = [first, second]
    if (np.abs(target[others]) > dims[others] / 2 - FINGERTIP).any():
        return None
    return Grasp(pose(target, np.stack([x, y, approach], axis=1)), float(dims[closing]), offset)
