import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from apf.errors import InputError
from apf.panda.vision.detection import Detection, detect, drawn
from apf.panda.vision.markers import (
    FACES,
    MOST,
    TILE,
    check_number,
    marker_corners,
    marker_image,
    marker_poses,
    marker_sides,
    mesh,
    texture,
)

DIMS = np.array([0.04, 0.06, 0.08])
SIDES = st.floats(0.01, 0.2)


def test_corners_by_hand() -> None:
    """The face +x is 6 cm wide (y) and 8 cm high (z): its marker is 6/8 of 6 cm, from the upper left clockwise."""
    corners = marker_corners(DIMS)
    half = 0.0225
    assert corners.shape == (6, 4, 3)
    expected = [[0.02, -half, half], [0.02, half, half], [0.02, half, -half], [0.02, -half, -half]]
    np.testing.assert_allclose(corners[0], expected, atol=1e-12)
    half = 0.015  # the face -z is 4 cm wide (-x) and 6 cm high (y)
    expected = [[half, half, -0.04], [-half, half, -0.04], [-half, -half, -0.04], [half, -half, -0.04]]
    np.testing.assert_allclose(corners[5], expected, atol=1e-12)
    np.testing.assert_allclose(marker_sides(DIMS), [0.045, 0.045, 0.03, 0.03, 0.03, 0.03])


@given(st.tuples(SIDES, SIDES, SIDES))
def test_markers_lie_on_their_faces(sides: tuple[float, float, float]) -> None:
    dims = np.array(sides)
    corners, poses = marker_corners(dims), marker_poses(dims)
    assert np.allclose(np.linalg.det(poses[:, :3, :3]), 1), "right-handed"
    out = poses[:, :3, 2]
    np.testing.assert_allclose(out.sum(0), 0, atol=1e-12)
    np.testing.assert_allclose(np.einsum("fci,fi->fc", corners, out), np.abs(out @ dims)[:, None] / 2 * np.ones(4))
    assert (np.abs(corners) <= dims / 2 + 1e-12).all()
    clockwise = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1])
    assert (np.einsum("fi,fi->f", clockwise, out) < 0).all(), "clockwise from outside"
    np.testing.assert_allclose(corners.mean(1), poses[:, :3, 3], atol=1e-12)
    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1)
    np.testing.assert_allclose(lengths, marker_sides(dims)[:, None] * np.ones(4), rtol=1e-9)


def test_no_number_twice_and_all_are_read() -> None:
    """Every marker of as many blocks as there can be, each in a picture of its own."""
    pictures = {marker_image(number).tobytes() for number in range(FACES * MOST)}
    assert len(pictures) == FACES * MOST == 246
    for number in range(FACES * MOST):
        (found,) = detect(np.pad(marker_image(number, 8), 20, constant_values=255), MOST)
        assert (found.block, found.face) == divmod(number, FACES)


def test_a_number_that_no_block_has_is_left_out() -> None:
    image = np.pad(marker_image(6, 8), 20, constant_values=255)
    assert [each.block for each in detect(image, 2)] == [1]
    assert detect(image, 1) == []


def test_a_number_that_is_seen_twice_is_left_out() -> None:
    one, other = (np.pad(marker_image(number, 8), 20, constant_values=255) for number in (3, 4))
    assert [each.face for each in detect(np.hstack([one, other]), 1)] == [3, 4]
    assert [each.face for each in detect(np.hstack([one, other, one]), 1)] == [4]


def test_more_blocks_than_markers_are_refused() -> None:
    check_number(41)
    with pytest.raises(InputError, match="there are 42 blocks; there are markers for 41"):
        check_number(42)


def test_a_texture_shows_each_face_as_it_looks_from_outside() -> None:
    """Its picture of a face, stretched back to the shape of the face, has the marker in the middle."""
    image = cv2.cvtColor(texture(2, DIMS, (0.5, 0.5, 0.5, 1)), cv2.COLOR_RGB2GRAY)
    tile = image[:TILE, :TILE]  # of the face +x, 60 x 80 mm; drawn with 5 pixels a mm
    (found,) = detect(cv2.resize(tile, (300, 400)), 3)
    assert (found.block, found.face) == (2, 0)
    expected = 5 * np.array([[7.5, 17.5], [52.5, 17.5], [52.5, 62.5], [7.5, 62.5]])
    np.testing.assert_allclose(found.corners, expected, atol=1.5)


def test_a_mesh_has_the_faces_of_the_block() -> None:
    """24 vertices, of which each face has four; its two triangles look outwards."""
    lines = [line.split() for line in mesh(DIMS).splitlines()]
    points, uv, normals = (
        np.array([line[1:] for line in lines if line[0] == kind], float) for kind in ("v", "vt", "vn")
    )
    assert (points.shape, uv.shape, normals.shape) == ((24, 3), (24, 2), (6, 3))
    np.testing.assert_allclose(np.abs(points), np.tile(DIMS / 2, (24, 1)), atol=1e-9)
    assert ((uv > 0) & (uv < 1)).all()
    triangles = [[tuple(map(int, corner.split("/"))) for corner in line[1:]] for line in lines if line[0] == "f"]
    assert len(triangles) == 12
    for triangle in triangles:
        a, b, c = (points[vertex - 1] for vertex, _, _ in triangle)
        normal = np.cross(b - a, c - a)
        np.testing.assert_allclose(normal / np.linalg.norm(normal), normals[triangle[0][2] - 1], atol=1e-9)


def test_detections_are_drawn() -> None:
    image = np.full((100, 200), 255, np.uint8)
    corners = np.array([[20.0, 20], [60, 20], [60, 60], [20, 60]])
    picture = drawn(image, [Detection(0, 0, corners)], ("thing",))
    assert picture.shape == (100, 200, 3)
    assert tuple(picture[20, 40]) == (0, 160, 0)
    assert (picture[:, 120:] == 255).all()
