"""PyBullet, without the lines that it prints when it is imported and when a client connects."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from apf.errors import InputError


@contextmanager
def _silent() -> Iterator[None]:
    """Drop the output of native code meanwhile."""
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    kept = [os.dup(1), os.dup(2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for descriptor in (1, 2):
            os.dup2(nowhere, descriptor)
        yield
    finally:
        for descriptor, before in zip((1, 2), kept):
            os.dup2(before, descriptor)
            os.close(before)
        os.close(nowhere)


with _silent():
    import pybullet
    from pybullet_utils.bullet_client import BulletClient

EXTRAS = (
    pybullet.COV_ENABLE_SHADOWS,
    pybullet.COV_ENABLE_GUI,
    pybullet.COV_ENABLE_RGB_BUFFER_PREVIEW,
    pybullet.COV_ENABLE_DEPTH_BUFFER_PREVIEW,
    pybullet.COV_ENABLE_SEGMENTATION_MARK_PREVIEW,
)
"""Parts of a window besides the scene."""

VIEW = {
    "cameraTargetPosition": (0.22, 0.0, 0.25),
    "cameraDistance": 1.55,
    "cameraYaw": 52.0,
    "cameraPitch": -26.0,
}
"""First viewpoint of a window [m, deg]: the default viewpoint of films."""


def connect(gui: bool = False) -> Any:
    """A new client, with a window or without; its attributes are PyBullet's functions and constants.

    Raises InputError if there is no display to show a window on: PyBullet would end the process.
    """
    if gui and sys.platform == "linux" and not os.environ.get("DISPLAY"):
        raise InputError("gui=true needs a display (DISPLAY is not set)")
    with _silent():
        client = BulletClient(pybullet.GUI if gui else pybullet.DIRECT)
        if gui:  # physics waits for every picture: leave out what makes them slow, and what shows nothing here
            for extra in EXTRAS:
                client.configureDebugVisualizer(extra, 0)
            client.resetDebugVisualizerCamera(**VIEW)
        return client


__all__ = ["connect", "pybullet"]
