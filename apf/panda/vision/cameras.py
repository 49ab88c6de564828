"""Cameras: what images they make, and where they are. Optical frames as in OpenCV: x right, y down, z ahead."""

from dataclasses import field
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from apf.panda.geometry import pose
from apf.settings import Coordinate, Number, Whole, settings

Point = tuple[Coordinate, Coordinate, Coordinate]

LEFT, RIGHT, WRIST = "left", "right", "wrist"
STATIC = (LEFT, RIGHT)


@settings
class Camera:
    """A camera that stands beside the table."""

    position: Point
    """In the robot's frame [m]."""
    target: Point
    """The point that the camera looks at [m]."""
    width: Annotated[Whole, Field(ge=64, le=8192)] = 1280
    """[pixels]"""
    height: Annotated[Whole, Field(ge=64, le=8192)] = 720
    """[pixels]"""
    focal: Annotated[Number, Field(ge=20, le=100_000)] = 920.0
    """Focal length [pixels]; the principal point is the middle of the image."""
    blur: Annotated[Number, Field(ge=0, le=20)] = 0.6
    """Standard deviation of the blur [pixels]."""
    noise: Annotated[Number, Field(ge=0, le=128)] = 4.0
    """Standard deviation of each pixel's brightness, of 255."""
    supersampling: Annotated[Whole, Field(ge=1, le=4)] = 1
    """Pixels that are rendered for one of the image, along each axis."""

    @model_validator(mode="after")
    def _looks_somewhere(self) -> "Camera":
        if np.linalg.norm(np.subtract(self.target, self.position)) < 0.01:
            raise ValueError(f"the camera at {self.position} looks at {self.target}; it must be another point")
        return self

    @property
    def intrinsics(self) -> np.ndarray:
        """[3, 3] matrix K: a point [x, y, z] in the optical frame is seen at K [x / z, y / z, 1]."""
        return np.array(
            [[self.focal, 0, (self.width - 1) / 2], [0, self.focal, (self.height - 1) / 2], [0, 0, 1]], float
        )

    @property
    def mounting(self) -> np.ndarray:
        """[4, 4] the optical frame in the frame that the camera is mounted in: of the robot, or of the hand."""
        return looking(np.array(self.position), np.array(self.target), np.array(self._up))

    @property
    def _up(self) -> Point:
        return (0.0, 0.0, 1.0)


@settings
class WristCamera(Camera):
    """A camera on the hand. Position and target are in the frame of the grasp target: z ahead, y where fingers close.

    From where it sits, the camera sees a block before it is grasped, after it was put down, and in the hand.
    """

    position: Point = (0.085, 0.0, -0.07)
    target: Point = (0.0, 0.0, 0.02)
    width: Annotated[Whole, Field(ge=64, le=8192)] = 640
    """[pixels]"""
    height: Annotated[Whole, Field(ge=64, le=8192)] = 480
    """[pixels]"""
    focal: Annotated[Number, Field(ge=20, le=100_000)] = 450.0
    """Focal length [pixels]; the principal point is the middle of the image."""
    size: Annotated[Number, Field(gt=0, le=0.2)] = 0.03
    """Of the cube that holds the camera [m]; collisions with it count."""

    @property
    def _up(self) -> Point:
        return (0.0, 1.0, 0.0)


@settings
class Cameras:
    """Two cameras beside the table, and one on the hand."""

    left: Camera = field(default_factory=lambda: Camera(position=(0.95, 0.75, 0.75), target=(0.2, 0.0, 0.1)))
    right: Camera = field(default_factory=lambda: Camera(position=(0.95, -0.75, 0.75), target=(0.2, 0.0, 0.1)))
    wrist: WristCamera = field(default_factory=WristCamera)

    def named(self) -> dict[str, Camera]:
        """All cameras by their names."""
        return {LEFT: self.left, RIGHT: self.right, WRIST: self.wrist}


def looking(position: np.ndarray, target: np.ndarray, up: np.ndarray) -> np.ndarray:
    """[4, 4] of an optical frame at a position [3] that looks at a target [3].

    Args:
        position: [3] of the frame [m].
        target: [3] point on its axis [m].
        up: [3] direction that is up in the image, as far as it can be.
    """
    ahead = (target - position) / np.linalg.norm(target - position)
    side = np.cross(ahead, up)
    if np.linalg.norm(side) < 1e-6:
        side = np.cross(ahead, [1.0, 0.0, 0.0])
    right = side / np.linalg.norm(side)
    return pose(position, np.stack([right, np.cross(ahead, right), ahead], axis=1))


def projected(points: np.ndarray, camera_pose: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
    """[..., 2] pixels at which points [..., 3] are seen; points behind the camera are seen nowhere: NaN.

    Args:
        points: [..., 3] in the robot's frame [m].
        camera_pose: [4, 4] of the optical frame in the robot's frame.
        intrinsics: [3, 3].
    """
    local = (points - camera_pose[:3, 3]) @ camera_pose[:3, :3]
    depth = np.where(local[..., 2:] > 1e-6, local[..., 2:], np.nan)
    return (local / depth @ intrinsics.T)[..., :2]
