"""Pictures of the robot at work, by PyBullet's renderer that needs no graphics card: a film, and a strip of stills."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import imageio.v2 as imageio
import numpy as np
from pydantic import Field

from apf.errors import InputError
from apf.panda.caption import captioned, with_inset
from apf.panda.reality import Reality
from apf.panda.scene import WOOD
from apf.panda.vision.cameras import WRIST
from apf.panda.vision.studio import UNSEEN
from apf.settings import Coordinate, Metres, Number, Whole, settings

ENDINGS = (".mp4", ".gif")
BACKGROUND = (236, 238, 240)


@settings
class Camera:
    """From where, and how large."""

    width: Annotated[Whole, Field(ge=16, le=4096)] = 960
    """[pixels]"""
    height: Annotated[Whole, Field(ge=16, le=4096)] = 640
    target: tuple[Coordinate, Coordinate, Coordinate] = (0.38, 0.0, 0.16)
    """The middle of the picture [m]."""
    distance: Metres = 1.05
    """From there [m]."""
    yaw: Annotated[Number, Field(ge=-360, le=360)] = 58.0
    """[deg] around it."""
    pitch: Annotated[Number, Field(ge=-90, le=90)] = -20.0
    """[deg] above it, negative."""
    view: Annotated[Number, Field(gt=0, lt=180)] = 34.0
    """Angle of view [deg], up and down."""
    fps: Annotated[Whole, Field(ge=1, le=240)] = 20
    """Pictures in a second of the film."""
    speed: Annotated[Number, Field(ge=0.01, le=1000)] = 4.0
    """Simulated seconds in a second of the film."""
    caption: bool = True
    """Say in each picture what the robot is at, and what has come of each prefix."""
    inset: bool = True
    """Show in each picture what the camera on the hand sees."""


def picture(reality: Reality, camera: Camera) -> np.ndarray:
    """[height, width, 3] uint8 of the scene as it is."""
    studio, state = reality.photographer.studio, reality.state()
    studio.set(state.poses, state.joints, state.fingers)
    client = studio.client
    view = client.computeViewMatrixFromYawPitchRoll(camera.target, camera.distance, camera.yaw, camera.pitch, 0, 2)
    projection = client.computeProjectionMatrixFOV(camera.view, camera.width / camera.height, 0.05, 5.0)
    client.changeVisualShape(studio.table, -1, rgbaColor=WOOD)  # hidden where cameras look, as it is drawn otherwise
    image = client.getCameraImage(
        camera.width,
        camera.height,
        view,
        projection,
        lightDirection=(0.6, 0.8, 1.6),
        lightDistance=3,
        shadow=1,
        lightAmbientCoeff=0.55,
        lightDiffuseCoeff=0.5,
        lightSpecularCoeff=0.05,
        renderer=client.ER_TINY_RENDERER,
        flags=client.ER_NO_SEGMENTATION_MASK,
    )
    client.changeVisualShape(studio.table, -1, rgbaColor=UNSEEN)
    pixels = np.reshape(np.asarray(image[2], np.uint8), (camera.height, camera.width, 4))[..., :3].copy()
    depth = np.reshape(np.asarray(image[3]), (camera.height, camera.width))
    pixels[depth >= 1.0] = BACKGROUND
    if camera.inset:
        wrist = replace(reality.photographer.cameras[WRIST], noise=0.0)  # noise would make films large
        where = state.hand @ wrist.mounting
        pixels = with_inset(pixels, studio.photograph(wrist, where, np.random.default_rng(0)))
    return pixels


@dataclass
class Film:
    """Follows a reality while it is filmed; `still` keeps what is seen now for the strip."""

    camera: Camera
    writer: Any
    caption: Callable[[], Sequence[str]] = tuple
    """What the robot is at, in lines."""
    stills: list[np.ndarray] = field(default_factory=list)
    _next: int = 0

    def __call__(self, reality: Reality) -> None:
        """Called after every step of time."""
        if reality.steps < self._next:
            return
        self._next = reality.steps + round(self.camera.speed * reality.rate / self.camera.fps)
        self.writer.append_data(self._picture(reality))

    def still(self, reality: Reality) -> None:
        """One more picture for the strip."""
        self.stills.append(self._picture(reality))

    def _picture(self, reality: Reality) -> np.ndarray:
        """[height, width, 3] uint8 of the scene as it is, and in words."""
        seen, lines = picture(reality, self.camera), self.caption() if self.camera.caption else ()
        return captioned(seen, lines) if lines else seen


@contextmanager
def filming(path: Path, camera: Camera) -> Iterator[Film]:
    """A film that is written to a .mp4 or .gif file, and its stills to a .png beside it."""
    if path.suffix not in ENDINGS:
        raise InputError(f"out={path}: the ending must be {' or '.join(ENDINGS)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        more: dict[str, Any] = {"macro_block_size": 2, "quality": 7} if path.suffix == ".mp4" else {"loop": 0}
        with imageio.get_writer(
            path, **({"fps": camera.fps} if path.suffix == ".mp4" else {"duration": 1000 / camera.fps}), **more
        ) as writer:
            film = Film(camera, writer)
            yield film
        if film.stills:
            imageio.imwrite(path.with_suffix(".png"), np.concatenate(film.stills, axis=1))
    except OSError as error:
        raise InputError(f"out={path}: cannot be written: {error.strerror or error}") from None
