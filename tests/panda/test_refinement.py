"""Corners of markers to a fraction of a pixel, in pictures drawn by hand."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from apf.panda.vision.markers import marker_image
from apf.panda.vision.refinement import refined

MIDDLE = np.array([60.0, 50.0])
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def picture(matrix: np.ndarray, blur: float = 0.6, noise: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """[100, 120] of a marker, the square from -1 to 1 mapped by a matrix [2, 2], and its corners [4, 2]."""
    corners = MIDDLE + SQUARE @ matrix.T
    fine, cells = 8, 8 * 16
    whole = fine * (MIDDLE + SQUARE * 8 / 6 @ matrix.T + 0.5) - 0.5
    source = np.array([[0, 0], [cells, 0], [cells, cells], [0, cells]]) - 0.5
    mapped = cv2.getPerspectiveTransform(source.astype(np.float32), whole.astype(np.float32))
    large = cv2.warpPerspective(marker_image(7, 16), mapped, (fine * 120, fine * 100), borderValue=180)
    image = cv2.GaussianBlur(cv2.resize(large, (120, 100), interpolation=cv2.INTER_AREA), (0, 0), blur)
    noisy = image + np.random.default_rng(0).normal(0, noise, image.shape)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8), corners


@pytest.mark.parametrize(("blur", "cell"), [(0.4, 2.5), (0.6, 2.5), (1.0, 5.0)])
@given(st.floats(1, 2), st.floats(-0.4, 0.4), st.floats(1, 1.5), st.floats(-3.1, 3.1))
def test_corners_are_found_from_near_them(
    blur: float, cell: float, size: float, shear: float, stretch: float, turn: float
) -> None:
    """Parallelograms, first found too far inside: to a seventh of a pixel."""
    c, s = np.cos(turn), np.sin(turn)
    image, corners = picture(3 * cell * size * np.array([[c, -s], [s, c]]) @ np.array([[1, shear], [0, stretch]]), blur)
    inside = corners + 0.5 * (MIDDLE - corners) / np.linalg.norm(MIDDLE - corners, axis=1, keepdims=True)
    assert np.abs(refined(image, inside[None])[0] - corners).max() < 0.15


def test_noise_is_averaged() -> None:
    image, corners = picture(np.diag([12.0, 12.0]), noise=6)
    assert np.abs(refined(image, corners[None])[0] - corners).max() < 0.25


def test_what_covers_a_part_of_an_edge_counts_for_little() -> None:
    image, corners = picture(np.diag([15.0, 15.0]))
    image[33:35, 62:66] = 20  # dark beyond the upper edge, for a seventh of it
    assert np.abs(refined(image, corners[None])[0] - corners).max() < 0.3


@pytest.mark.parametrize("away", [(0, 0), (25, 0)])
def test_where_there_is_no_marker_corners_stay(away: tuple[int, int]) -> None:
    image, corners = picture(np.diag([12.0, 12.0]))
    if away == (0, 0):
        image[:] = 200
    told = corners + away
    np.testing.assert_array_equal(refined(image, told[None])[0], told)


def test_each_marker_for_itself() -> None:
    """None, and two of which one is at the edge of the image."""
    image, corners = picture(np.diag([12.0, 12.0]))
    assert refined(image, np.empty((0, 4, 2))).shape == (0, 4, 2)
    outside = corners - MIDDLE
    both = refined(image, np.array([corners, outside]))
    np.testing.assert_array_equal(both[0], refined(image, corners[None])[0])
    assert np.abs(both[1] - outside).max() <= 2.5
