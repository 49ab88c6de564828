"""Markers in an image."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from apf.panda.vision.markers import DICTIONARY, FACES
from apf.panda.vision.refinement import refined

WINDOW = 3
"""Half of the window in which a corner is looked for [pixels]."""


@dataclass(frozen=True, eq=False)
class Detection:
    """A marker in an image: the block and the face that it belongs to, and its corners [4, 2] in pixels."""

    block: int
    face: int
    corners: np.ndarray


def _detector() -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.cornerRefinementWinSize = WINDOW
    return cv2.aruco.ArucoDetector(DICTIONARY, parameters)


def detect(image: np.ndarray, blocks: int) -> list[Detection]:
    """The markers of the first `blocks` blocks in an image [H, W] uint8, in the order of their numbers.

    A number that is seen twice is a misreading, or a marker that was printed twice: it is left out.
    """
    return sorted_out(detect_all(image, blocks))[0]


def sorted_out(found: Sequence[Detection]) -> tuple[list[Detection], list[Detection]]:
    """The markers that were found once, and those that were found more often."""
    times = Counter((each.block, each.face) for each in found)
    once = [each for each in found if times[each.block, each.face] == 1]
    return once, [each for each in found if times[each.block, each.face] > 1]


def detect_all(image: np.ndarray, blocks: int) -> list[Detection]:
    """As `detect`, with what is seen twice."""
    corners, numbers, _ = _detector().detectMarkers(image)
    if numbers is None:
        return []
    places = refined(image, np.reshape(corners, (-1, 4, 2)).astype(float))
    found = [int(number) for number in numbers.ravel()]
    order = sorted(range(len(found)), key=lambda i: found[i])
    return [Detection(*divmod(found[i], FACES), places[i]) for i in order if found[i] < FACES * blocks]


def drawn(image: np.ndarray, detections: list[Detection], names: tuple[str, ...]) -> np.ndarray:
    """[H, W, 3] uint8: an image with the markers that were found in it, and the names of their blocks.

    Args:
        image: [H, W] uint8.
        detections: What was found.
        names: [B] of the blocks.
    """
    picture = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)
    for each in detections:
        cv2.polylines(picture, [np.round(each.corners).astype(np.int32)], True, (0, 160, 0), 2, cv2.LINE_AA)
        x, y = np.round(each.corners.mean(0)).astype(int)
        for colour, width in (((255, 255, 255), 4), ((200, 30, 30), 1)):
            cv2.putText(
                picture, names[each.block], (x - 20, y), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, width, cv2.LINE_AA
            )
    return picture
