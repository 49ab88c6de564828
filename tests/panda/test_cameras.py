import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from pydantic import ValidationError

from apf.panda.layout import Layout
from apf.panda.vision.cameras import STATIC, Camera, Cameras, WristCamera, looking, projected
from apf.panda.vision.legibility import LEAST, marker_widths, too_small
from apf.towers import BlockSet

Point = tuple[float, float, float]
POINTS = st.tuples(*[st.floats(-1, 1)] * 3)


def test_what_a_camera_looks_at_is_in_the_middle_of_its_image() -> None:
    for name, camera in Cameras().named().items():
        middle = projected(np.array(camera.target), camera.mounting, camera.intrinsics)
        np.testing.assert_allclose(middle, [(camera.width - 1) / 2, (camera.height - 1) / 2], atol=1e-9, err_msg=name)


def test_a_projection_by_hand() -> None:
    """A camera 2 m above the table looks down, its image's right to the robot's right (-y), focal length 100."""
    camera = Camera(position=(0.5, 0, 2), target=(0.5, 0, 0), width=201, height=101, focal=100)
    place = looking(np.array([0.5, 0, 2.0]), np.array([0.5, 0, 0.0]), np.array([1.0, 0, 0]))
    np.testing.assert_allclose(place[:3, 2], [0, 0, -1])
    np.testing.assert_allclose(np.linalg.det(place[:3, :3]), 1)
    seen = projected(np.array([[0.5, 0.0, 0.0], [0.5, -0.2, 0.0], [0.7, 0.0, 1.0]]), place, camera.intrinsics)
    np.testing.assert_allclose(seen, [[100, 50], [110, 50], [100, 30]], atol=1e-9)
    assert np.isnan(projected(np.array([0.5, 0.0, 3.0]), place, camera.intrinsics)).all(), "behind the camera"


@given(st.tuples(POINTS, POINTS))
@example(((0.5, 0.0, 2.0), (0.5, 0.0, 0.0)))
def test_an_optical_frame_is_right_handed_and_looks_at_its_target(ends: tuple[Point, Point]) -> None:
    """Also straight down."""
    position, target = np.array(ends)
    assume(np.linalg.norm(target - position) > 0.01)
    place = looking(position, target, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(place[:3, :3] @ place[:3, :3].T, np.eye(3), atol=1e-9)
    assert np.linalg.det(place[:3, :3]) == pytest.approx(1)
    np.testing.assert_allclose(place[:3, 2] * np.linalg.norm(target - position), target - position, atol=1e-9)
    assert place[2, 1] <= 1e-9, "the image is not upside down"


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"focal": 0}, ("focal", "20")),
        ({"focal": float("nan")}, ("focal",)),
        ({"width": 10}, ("width", "64")),
        ({"height": 64.5}, ("height",)),
        ({"blur": -1}, ("blur", "0")),
        ({"noise": 1000}, ("noise", "128")),
        ({"supersampling": 0}, ("supersampling", "1")),
        ({"target": (0, 0, 0)}, ("another point",)),
        ({"position": (0, 0)}, ("position",)),
    ],
)
def test_an_impossible_camera_is_refused(wrong: dict, words: tuple[str, ...]) -> None:
    for cls in (Camera, WristCamera):
        with pytest.raises(ValidationError) as error:
            cls(**{"position": (0, 0, 0), "target": (1, 0, 0)} | wrong)
        for word in words:
            assert word in str(error.value)
    with pytest.raises(ValidationError, match="size"):
        WristCamera(size=0)


def test_base_pedestal_and_homes_are_in_view_of_the_cameras() -> None:
    """Of both: the base, a tower of five blocks on it, the pedestal; of one at least: each home."""
    layout, cameras = Layout(), Cameras().named()
    points = [(*layout.base, z) for z in np.linspace(0, 0.35, 8)] + [(*layout.pedestal, z) for z in (0.1, 0.2)]
    seen = {}
    for name in STATIC:
        camera = cameras[name]
        for where, points_there in ((name, np.array(points)), (f"{name} homes", layout.homes[:, :3, 3])):
            pixels = projected(points_there, camera.mounting, camera.intrinsics)
            seen[where] = ((pixels > 0) & (pixels < [camera.width - 1, camera.height - 1])).all(1)
    assert seen["left"].all()
    assert seen["right"].all()
    assert (seen["left homes"] | seen["right homes"]).all()


# -- markers that are too small ----------------------------------------------------------------------------------


def test_the_width_of_a_marker_by_hand() -> None:
    """A cube of 8 cm, seen from 1 m before its face +x: a marker of 6 cm; its other faces look away or sideways."""
    camera = Camera(position=(1.04, 0, 0), target=(0, 0, 0), width=640, height=480, focal=500)
    widths = marker_widths(np.full(3, 0.08), np.eye(4), camera, camera.mounting)
    np.testing.assert_allclose(widths[0], 500 * 0.06, rtol=1e-9)
    assert (widths[1:] == 0).all()


def test_a_marker_that_is_cut_off_has_no_width() -> None:
    camera = Camera(position=(1.04, 0, 0), target=(0, 0.66, 0), width=640, height=480, focal=500)
    assert (marker_widths(np.full(3, 0.08), np.eye(4), camera, camera.mounting) == 0).all()


def named_blocks(*sides: float) -> BlockSet:
    n = len(sides)
    names = tuple(f"b{i}" for i in range(n))
    return BlockSet(names, np.tile(np.array(sides)[:, None], 3), np.zeros((n, 3)), np.ones(n))


def test_too_small_names_block_camera_and_pixels() -> None:
    """Of cubes 1 m before a camera, one of 8 cm has markers of 30 pixels, one of 2 cm of 7.5."""
    camera = Camera(position=(1.0, 0, 0), target=(0, 0, 0), width=640, height=480, focal=500)
    blocks = named_blocks(0.08, 0.02, 0.08)
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = [-0.04, -0.01, 3.0]  # the last is behind the camera
    found = too_small(blocks, poses, {"front": camera}, {"front": camera.mounting}, least=12)
    assert [(each.block, each.camera, round(each.pixels, 6)) for each in found] == [
        ("b1", "front", 7.5),
        ("b2", "front", 0),
    ]
    assert str(found[0]) == (
        "camera front: the best marker of block b1 would be 7.5 pixels wide; it must be at least 12"
    )
    assert str(found[1]) == "camera front: block b2 would not be in view"
    assert too_small(blocks, poses, {"front": camera}, {}, least=12) == [], "cameras that do not count"


def test_blocks_at_home_are_large_enough_by_default(graspable: BlockSet) -> None:
    cameras, poses = Cameras().named(), Layout().home_poses(graspable.dims)
    places = {name: cameras[name].mounting for name in STATIC}
    assert too_small(graspable, poses, cameras, places) == []
    small = BlockSet(graspable.name, graspable.dims / 4, graspable.com / 4, graspable.mass)
    found = too_small(small, poses, cameras, places)
    assert len(found) == 2 * len(small)
    assert all(0 < each.pixels < LEAST for each in found)
