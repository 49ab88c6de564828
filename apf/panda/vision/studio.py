"""Images of a scene as cameras would make them, by PyBullet's renderer that needs no graphics card."""

import tempfile
from functools import cache
from pathlib import Path

import cv2
import imageio.v3 as imageio
import numpy as np

from apf.panda.layout import Layout
from apf.panda.scene import COLOURS, FINGERS, WOOD, Scene
from apf.panda.vision.cameras import Camera
from apf.panda.vision.markers import check_number, mesh, texture
from apf.towers import BlockSet

NEAR, FAR = 0.02, 4.0
"""What is nearer or farther [m] is not drawn."""
BACKGROUND, TABLE = 200, 174
"""Brightness of what is empty, and of the table's top in this light."""

UNSEEN = (*WOOD[:3], 0)
"""Colour of the table where the renderer leaves it out."""


@cache
def _directory() -> tempfile.TemporaryDirectory:
    """Of textures and meshes; removed with the process."""
    return tempfile.TemporaryDirectory(prefix="apf-blocks-")


class Studio(Scene):
    """A scene without physics whose blocks carry their markers. It is set as reality is, and then photographed."""

    plain = True

    def __init__(self, layout: Layout) -> None:
        super().__init__(layout)
        self._number = 0

    def prepare(self, blocks: BlockSet) -> None:
        """Make the blocks of a set, unless they are there. Raises InputError if there are too few markers."""
        check_number(len(blocks))
        if self.blocks is None or not self.blocks.equals(blocks):
            self._number += 1
            self.build(blocks, self.layout.home_poses(blocks.dims))
            # the renderer needs more time for the large, plain table than for all else, so it is drawn here
            self.client.changeVisualShape(self.table, -1, rgbaColor=UNSEEN)

    def _visual(self, index: int) -> int:
        assert self.blocks is not None
        path = Path(_directory().name) / f"{id(self)}-{self._number}-{index}.obj"
        path.write_text(mesh(self.blocks.dims[index]))
        return self.client.createVisualShape(self.client.GEOM_MESH, fileName=str(path), rgbaColor=(1, 1, 1, 1))

    def _finish(self, body: int, index: int) -> None:
        assert self.blocks is not None
        path = Path(_directory().name) / f"{id(self)}-{self._number}-{index}.png"
        imageio.imwrite(path, texture(index, self.blocks.dims[index], COLOURS[index % len(COLOURS)]))
        self.client.changeVisualShape(body, -1, textureUniqueId=self.client.loadTexture(str(path)))

    def set(self, poses: np.ndarray, q: np.ndarray, fingers: tuple[float, float]) -> None:
        """Put all things where they are.

        Args:
            poses: [B, 4, 4] of the blocks.
            q: [7] joints of the arm [rad].
            fingers: Position of each finger [m].
        """
        for index, where in enumerate(poses):
            self.put(index, where)
        self.pose_arm(q)
        self.client.resetJointStatesMultiDof(self.robot, FINGERS, [[finger] for finger in fingers])

    def photograph(self, camera: Camera, where: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """[height, width] uint8 image of the scene as it was set, with blur and noise.

        Args:
            camera: What kind of image.
            where: [4, 4] the optical frame of the camera in the robot's frame.
            rng: The source of the noise.
        """
        many = camera.supersampling
        width, height = camera.width * many, camera.height * many
        eye, ahead, down = where[:3, 3], where[:3, 2], where[:3, 1]
        view = self.client.computeViewMatrix(eye.tolist(), (eye + ahead).tolist(), (-down).tolist())
        picture = self.client.getCameraImage(
            width,
            height,
            view,
            self._projection(camera),
            lightDirection=(0.6, 0.8, 1.6),
            lightDistance=3,
            shadow=0,
            lightAmbientCoeff=0.75,
            lightDiffuseCoeff=0.3,
            lightSpecularCoeff=0.0,
            renderer=self.client.ER_TINY_RENDERER,
            flags=self.client.ER_NO_SEGMENTATION_MASK,
        )
        grey = cv2.cvtColor(np.reshape(np.asarray(picture[2], np.uint8), (height, width, 4)), cv2.COLOR_RGBA2GRAY)
        depth = np.reshape(np.asarray(picture[3], np.float32), (height, width))
        grey[depth >= 1.0] = BACKGROUND
        grey[self._table_seen(camera, where, depth)] = TABLE
        image: np.ndarray = grey.astype(np.float32)
        if many > 1:
            image = cv2.resize(image, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
        if camera.blur:
            image = cv2.GaussianBlur(image, (0, 0), camera.blur)
        noise = rng.standard_normal(image.shape, np.float32) * np.float32(camera.noise)
        return np.clip(np.round(image + noise), 0, 255).astype(np.uint8)

    def _table_seen(self, camera: Camera, where: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """[H, W] bool: in which pixels is the table's top the nearest thing?

        Along the ray of each pixel, the inverse of the distance to a plane is linear in the pixel. The table's sides,
        in view of a camera beyond its edge alone, are not drawn.

        Args:
            camera: What kind of image.
            where: [4, 4] its optical frame.
            depth: [H, W] the renderer's depth of what else is seen: 0 at `NEAR`, 1 at `FAR`.
        """
        if where[2, 3] <= 0:
            return np.zeros(depth.shape, bool)
        height, width = depth.shape
        u, v = (
            ((np.arange(n) + 0.5 - n / 2) / (camera.focal * n / m))
            for n, m in ((width, camera.width), (height, camera.height))
        )

        def linear(row: np.ndarray) -> np.ndarray:
            return (row[0] * u).astype(np.float32) + (row[1] * v + row[2]).astype(np.float32)[:, None]

        plane = -where[2, :3] / where[2, 3]
        seen = linear(plane) > (1 - depth * np.float32(1 - NEAR / FAR)) / np.float32(NEAR)
        for axis, ends in enumerate((self.layout.table_x, self.layout.table_y)):
            for sign, end in zip((1, -1), ends):
                seen &= linear(sign * (where[axis, :3] - (end - where[axis, 3]) * plane)) >= 0
        return seen

    def _projection(self, camera: Camera) -> list[float]:
        """PyBullet's matrix of a camera.

        The renderer's grid of pixels is not in the middle of its image (by a pixel in y, by less in x), which the
        frustum makes up for.
        """
        many = camera.supersampling
        lag = (many - 1) / (2 * many)
        right = (camera.width - 1) / 2 - (camera.width / 2 - lag)
        down = (camera.height - 1) / 2 - (camera.height / 2 - 1 / many - lag)
        scale = NEAR / camera.focal
        return self.client.computeProjectionMatrix(
            -scale * (camera.width / 2 + right),
            scale * (camera.width / 2 - right),
            -scale * (camera.height / 2 - down),
            scale * (camera.height / 2 + down),
            NEAR,
            FAR,
        )
