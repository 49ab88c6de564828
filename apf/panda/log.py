"""A log of what a robot did: an MCAP file of Foxglove's messages, which Foxglove and Rerun open."""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import cv2
import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointState_pb2 import JointState
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.Log_pb2 import Log as Event
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from mcap_protobuf.writer import Writer

from apf.errors import InputError
from apf.panda.geometry import pose, to_vector
from apf.panda.kinematics import forward
from apf.panda.layout import Layout
from apf.panda.scene import COLOURS, STONE, WOOD
from apf.panda.vision.cameras import WRIST, Camera
from apf.towers import BlockSet

ENDING = ".mcap"
BELIEVED, TRUE = "believed", "true"
"""Kinds of poses of blocks."""
INFO, WARNING, ERROR = Event.INFO, Event.WARNING, Event.ERROR
"""How grave an event is."""
ROBOT, HAND = "robot", "hand"
"""Frames: where the robot stands, and the point between the fingertips."""
JOINTS = (*(f"panda_joint{i}" for i in range(1, 8)), "panda_finger_joint1", "panda_finger_joint2")
"""As the Panda's URDF calls them."""
QUALITY = 80
"""Of JPEG images, of 100."""
TABLE = 0.01
"""Thickness of the table as it is drawn [m]."""


class Content(StrEnum):
    """What a log holds."""

    NOTHING = "nothing"
    """There is no log."""
    MOTION = "motion"
    """Joints, poses of blocks, events."""
    IMAGES = "images"
    """And all that the cameras saw."""


class Log:
    """Writes one MCAP file; what an earlier one of this name held is lost. A context.

    Frames: `robot`, `hand`, each camera, and for each block where it is believed to be and where it is.

    Args:
        path: Of the file.
        blocks: The set.
        cameras: By their names.
        layout: Places on the table.

    Raises:
        InputError: The file cannot be written.
    """

    def __init__(self, path: Path, blocks: BlockSet, cameras: Mapping[str, Camera], layout: Layout) -> None:
        self.blocks = blocks
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("wb")
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
        self._writer = Writer(self._file)
        self._place_cameras(cameras)
        self._furnish(layout)

    def __enter__(self) -> Self:
        """The log itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Finish the file, also after an error: what led to it is worth reading."""
        with self._file:
            self._writer.finish()

    def joints(self, seconds: float, q: np.ndarray, width: float) -> None:
        """What the arm and the gripper measure.

        Args:
            seconds: The time [s].
            q: [7] joints [rad].
            width: Between the fingers [m].
        """
        places = _short([*q, width / 2, width / 2])
        states = [JointState(name=name, position=place) for name, place in zip(JOINTS, places)]
        self._write("/joints", seconds, JointStates(timestamp=_time(seconds), joints=states))
        self._transform(seconds, {HAND: (ROBOT, forward(q))})

    def poses(self, seconds: float, kind: str, poses: Mapping[int, np.ndarray]) -> None:
        """Where blocks are believed to be, or are.

        Args:
            seconds: The time [s].
            kind: `BELIEVED` or `TRUE`.
            poses: [4, 4] by the numbers of blocks; the others lie as they did.
        """
        self._transform(seconds, {self._frame(kind, block): (ROBOT, where) for block, where in poses.items()})

    def image(self, seconds: float, camera: str, image: np.ndarray) -> None:
        """What a camera saw.

        Args:
            seconds: The time [s].
            camera: Its name.
            image: [height, width] uint8.
        """
        _, jpeg = cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_QUALITY, QUALITY))
        message = CompressedImage(timestamp=_time(seconds), frame_id=camera, format="jpeg", data=jpeg.tobytes())
        self._write(f"/cameras/{camera}/image", seconds, message)

    def event(self, seconds: float, level: Any, text: str) -> None:
        """One line.

        Args:
            seconds: The time [s].
            level: `INFO`, `WARNING` or `ERROR`.
            text: What happened.
        """
        self._write("/events", seconds, Event(timestamp=_time(seconds), level=level, name="apf", message=text))

    # -- what stands still --------------------------------------------------------------------------------------

    def _place_cameras(self, cameras: Mapping[str, Camera]) -> None:
        """Where the robot believes its cameras to be, and their lenses."""
        for name, camera in cameras.items():
            matrix = camera.intrinsics
            projection = np.hstack([matrix, np.zeros((3, 1))])
            calibration = CameraCalibration(
                timestamp=_time(0.0),
                frame_id=name,
                width=camera.width,
                height=camera.height,
                K=matrix.ravel().tolist(),
                R=np.eye(3).ravel().tolist(),
                P=projection.ravel().tolist(),
            )
            self._write(f"/cameras/{name}/calibration", 0.0, calibration)
        self._transform(0.0, {n: (HAND if n == WRIST else ROBOT, camera.mounting) for n, camera in cameras.items()})

    def _furnish(self, layout: Layout) -> None:
        """Draw table and pedestal, and each block in its own frames: solid where it is, pale where it is believed."""
        (x0, x1), (y0, y1) = layout.table_x, layout.table_y
        width, depth, height = layout.pedestal_size
        table = _cube((x1 - x0, y1 - y0, TABLE), WOOD, pose(((x0 + x1) / 2, (y0 + y1) / 2, -TABLE / 2)))
        pedestal = _cube((width, depth, height), STONE, pose((*layout.pedestal, height / 2)))
        furniture = SceneEntity(timestamp=_time(0.0), frame_id=ROBOT, id="table", cubes=[table, pedestal])
        self._write("/table", 0.0, SceneUpdate(entities=[furniture]))
        for kind, alpha in ((BELIEVED, 0.4), (TRUE, 1.0)):
            entities = [
                SceneEntity(
                    timestamp=_time(0.0),
                    frame_id=self._frame(kind, block),
                    id=name,
                    frame_locked=True,
                    cubes=[_cube(dims, (*COLOURS[block % len(COLOURS)][:3], alpha))],
                )
                for block, (name, dims) in enumerate(zip(self.blocks.name, self.blocks.dims))
            ]
            self._write(f"/blocks/{kind}", 0.0, SceneUpdate(entities=entities))

    # -- messages -----------------------------------------------------------------------------------------------

    def _frame(self, kind: str, block: int) -> str:
        return f"{kind}/{self.blocks.name[block]}"

    def _transform(self, seconds: float, frames: Mapping[str, tuple[str, np.ndarray]]) -> None:
        """Write poses [4, 4] of frames in their parents, by the names of the frames."""
        transforms = []
        for child, (parent, where) in frames.items():
            x, y, z, qx, qy, qz, qw = _short(to_vector(where))
            transforms.append(
                FrameTransform(
                    timestamp=_time(seconds),
                    parent_frame_id=parent,
                    child_frame_id=child,
                    translation=Vector3(x=x, y=y, z=z),
                    rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
                )
            )
        if transforms:
            self._write("/transforms", seconds, FrameTransforms(transforms=transforms))

    def _write(self, topic: str, seconds: float, message: Any) -> None:
        at = round(1e9 * seconds)
        self._writer.write_message(topic, message, log_time=at, publish_time=at)


def _time(seconds: float) -> Timestamp:
    whole, rest = divmod(round(1e9 * seconds), 10**9)
    return Timestamp(seconds=whole, nanos=rest)


def _short(values: Sequence[float] | np.ndarray) -> list[float]:
    """Values with the 24 bits of single precision: the zeros that follow take no room once they are compressed."""
    return np.asarray(values, np.float32).tolist()


def _cube(size: Any, colour: tuple[float, ...], where: np.ndarray | None = None) -> CubePrimitive:
    """A box with sides [3] [m] and a colour (red, green, blue, alpha) at a pose [4, 4]; None: in its frame's origin."""
    x, y, z, qx, qy, qz, qw = to_vector(np.eye(4) if where is None else where)
    red, green, blue, alpha = colour
    return CubePrimitive(
        pose=Pose(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw)),
        size=Vector3(x=size[0], y=size[1], z=size[2]),
        color=Color(r=red, g=green, b=blue, a=alpha),
    )
