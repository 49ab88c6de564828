"""How large the markers of blocks are in the images of cameras, and which are too small to be read."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from apf.panda.vision.cameras import Camera, projected
from apf.panda.vision.markers import marker_corners
from apf.towers import BlockSet

LEAST = 12.0
"""Markers whose pictures are narrower [pixels] are often not read."""


@dataclass(frozen=True)
class TooSmall:
    """A block that a camera would not read: even its best marker is narrower than it must be.

    pixels: Width of the picture of that marker; 0: no marker of the block would be in view.
    """

    block: str
    camera: str
    pixels: float
    least: float

    def __str__(self) -> str:
        """In one line, for people."""
        if self.pixels == 0:
            return f"camera {self.camera}: block {self.block} would not be in view"
        return (
            f"camera {self.camera}: the best marker of block {self.block} would be {self.pixels:.1f} pixels wide; "
            f"it must be at least {self.least:g}"
        )


def too_small(
    blocks: BlockSet,
    poses: np.ndarray,
    cameras: Mapping[str, Camera],
    places: Mapping[str, np.ndarray],
    least: float = LEAST,
) -> list[TooSmall]:
    """The blocks that cameras would not read, camera by camera. What stands in the way does not count.

    Args:
        blocks: The set.
        poses: [B, 4, 4] where the blocks would be.
        cameras: By their names.
        places: [4, 4] by the names of the cameras that count: their optical frames in the robot's frame.
        least: Width that the picture of a marker needs [pixels].
    """
    best = {
        name: [marker_widths(dims, where, cameras[name], place).max() for dims, where in zip(blocks.dims, poses)]
        for name, place in places.items()
    }
    return [
        TooSmall(block, name, float(width), least)
        for name, widths in best.items()
        for block, width in zip(blocks.name, widths)
        if width < least
    ]


def marker_widths(dims: np.ndarray, where: np.ndarray, camera: Camera, place: np.ndarray) -> np.ndarray:
    """[6] how wide the pictures of a block's markers are where they are narrowest [pixels]: area by longest side.

    A marker that looks away, or is not wholly in the image, has width 0.

    Args:
        dims: [3] sides of the block [m].
        where: [4, 4] pose of the block.
        camera: What kind of image.
        place: [4, 4] the optical frame of the camera in the robot's frame.
    """
    points = marker_corners(dims) @ where[:3, :3].T + where[:3, 3]
    seen = projected(points, place, camera.intrinsics)
    across, along = seen[:, 2] - seen[:, 0], seen[:, 3] - seen[:, 1]
    area = (across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0]) / 2
    longest = np.linalg.norm(seen - np.roll(seen, 1, axis=1), axis=-1).max(1)
    inside = ((seen >= 0) & (seen <= [camera.width - 1, camera.height - 1])).all((1, 2))
    return np.where(inside & (area > 0), area / longest, 0.0)
