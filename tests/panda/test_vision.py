"""Markers, cameras, and where blocks are seen, on rendered scenes whose poses are known."""

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from apf.errors import InputError
from apf.panda.geometry import about_z, angle, distance, inverse, moved, pose
from apf.panda.grasps import Gripper, grasps_of
from apf.panda.kinematics import REST, forward, inverse_kinematics
from apf.panda.layout import Layout
from apf.panda.stations import posture
from apf.panda.vision import Camera, Cameras, Eyes, Sighting, WristCamera
from apf.panda.vision.cameras import STATIC, WRIST, looking, projected
from apf.panda.vision.detection import detect
from apf.panda.vision.markers import (
    FACES,
    MOST,
    check_number,
    face_axes,
    marker_corners,
    marker_poses,
    marker_sides,
    texture,
)
from apf.panda.vision.studio import Studio
from apf.towers import BlockSet

CAMERAS = Cameras().named()
OPEN = (0.04, 0.04)
sides = st.floats(0.03, 0.15)


@pytest.fixture(scope="module")
def studio(graspable: BlockSet) -> Iterator[Studio]:
    studio = Studio(Layout())
    studio.prepare(graspable)
    yield studio
    studio.close()


def at_home(blocks: BlockSet) -> np.ndarray:
    return Layout().home_poses(blocks.dims)


def seen(
    studio: Studio,
    poses: np.ndarray,
    names: tuple[str, ...] = STATIC,
    q: np.ndarray = REST,
    expected: np.ndarray | None = None,
    seed: int = 0,
) -> Sighting:
    """What the cameras of these names tell of blocks at these poses."""
    assert studio.blocks is not None
    places = {name: CAMERAS[name].mounting for name in STATIC} | {WRIST: forward(q) @ CAMERAS[WRIST].mounting}
    studio.set(poses, q, OPEN)
    rng = np.random.default_rng(seed)
    images = {name: studio.photograph(CAMERAS[name], places[name], rng) for name in names}
    return Eyes(CAMERAS, studio.blocks).estimate(images, places, expected)


class TestMarkers:
    def test_corners_of_a_block_by_hand(self) -> None:
        """Sides 4, 6 and 8 cm: the face towards x is 6 by 8 cm, so its marker has 6/8 of 6 cm, from -2.25 to 2.25."""
        corners = marker_corners(np.array([0.04, 0.06, 0.08]))
        expected = [[2, -2.25, 2.25], [2, 2.25, 2.25], [2, 2.25, -2.25], [2, -2.25, -2.25]]
        np.testing.assert_allclose(corners[0] * 100, expected, atol=1e-12)
        np.testing.assert_allclose(corners[1, :, 0] * 100, -2)
        np.testing.assert_allclose(
            marker_sides(np.array([0.04, 0.06, 0.08])), 0.75 * np.array([6, 6, 4, 4, 4, 4]) / 100
        )

    @given(sides, sides, sides)
    def test_markers_lie_on_the_surface_and_look_outwards(self, x: float, y: float, z: float) -> None:
        dims = np.array([x, y, z])
        corners, poses = marker_corners(dims), marker_poses(dims)
        for face in range(FACES):
            right, up, out = face_axes(face)
            np.testing.assert_allclose(np.cross(right, up), out)
            np.testing.assert_allclose(corners[face] @ out, np.abs(out) @ dims / 2)
            assert (np.abs(corners[face]) <= dims / 2 + 1e-12).all()
            clockwise = np.cross(corners[face, 1] - corners[face, 0], corners[face, 2] - corners[face, 1])
            assert clockwise @ out < 0, "clockwise from outside"
            np.testing.assert_allclose(poses[face, :3, 3], corners[face].mean(0), atol=1e-12)

    def test_every_face_has_a_number_of_its_own(self) -> None:
        dims = np.array([0.05, 0.05, 0.05])
        found = [
            (each.block, each.face)
            for block in range(3)
            for each in detect(np.pad(texture(block, dims, (0.5, 0.5, 0.5))[..., 0], 20, constant_values=128), 3)
        ]
        assert sorted(found) == [(block, face) for block in range(3) for face in range(FACES)]

    def test_too_many_blocks_are_refused(self) -> None:
        check_number(MOST)
        with pytest.raises(InputError, match=rf"there are {MOST + 1} blocks; there are markers for {MOST}"):
            check_number(MOST + 1)


class TestCameras:
    def test_a_point_straight_ahead_is_seen_in_the_middle(self) -> None:
        camera = CAMERAS["left"]
        where = projected(np.array(camera.target), camera.mounting, camera.intrinsics)
        np.testing.assert_allclose(where, [(camera.width - 1) / 2, (camera.height - 1) / 2], atol=1e-9)

    def test_by_hand(self) -> None:
        """From 1 m, 10 cm are a tenth of the focal length; up is towards the top of the image."""
        camera = Camera(position=(1.0, 0.0, 0.0), target=(0.0, 0.0, 0.0), width=101, height=101, focal=500.0)
        points = np.array([[0.0, 0.0, 0.1], [0.0, 0.1, 0.0], [2.0, 0.0, 0.0]])
        where = projected(points, camera.mounting, camera.intrinsics)
        np.testing.assert_allclose(where[:2], [[50, 0], [100, 50]], atol=1e-9)
        assert np.isnan(where[2]).all(), "behind the camera"

    @given(st.lists(st.floats(-1, 1), min_size=6, max_size=6))
    def test_an_optical_frame_is_a_rotation(self, numbers: list[float]) -> None:
        position, target = np.array(numbers[:3]), np.array(numbers[3:])
        if np.linalg.norm(target - position) < 0.01:
            return
        frame = looking(position, target, np.array([0.0, 0.0, 1.0]))[:3, :3]
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(frame) == pytest.approx(1)

    @pytest.mark.parametrize(
        ("wrong", "words"),
        [
            ({"focal": 0}, "focal"),
            ({"width": 10}, "width"),
            ({"blur": -1}, "blur"),
            ({"target": (1, 0, 1)}, "another point"),
        ],
    )
    def test_impossible_cameras_are_refused(self, wrong: dict, words: str) -> None:
        with pytest.raises(ValidationError, match=words):
            Camera(**{"position": (1.0, 0.0, 1.0), "target": (0.0, 0.0, 0.0), **wrong})
        with pytest.raises(ValidationError, match="size"):
            WristCamera(size=0)


class TestImages:
    def test_the_same_draws_give_the_same_image(self, studio: Studio, graspable: BlockSet) -> None:
        camera = CAMERAS["left"]
        studio.set(at_home(graspable), REST, OPEN)
        one, again, other = (
            studio.photograph(camera, camera.mounting, np.random.default_rng(seed)) for seed in (0, 0, 1)
        )
        assert (one.shape, one.dtype) == ((camera.height, camera.width), np.uint8)
        np.testing.assert_array_equal(one, again)
        assert (one != other).mean() > 0.5, "noise"

    @pytest.mark.parametrize("many", [1, 2])
    def test_corners_are_seen_where_the_intrinsics_say(self, studio: Studio, graspable: BlockSet, many: int) -> None:
        camera = Camera(position=(0.95, 0.75, 0.75), target=(0.2, 0.0, 0.1), noise=0.0, supersampling=many)
        poses = at_home(graspable)
        studio.set(poses, REST, OPEN)
        errors = []
        for each in detect(studio.photograph(camera, camera.mounting, np.random.default_rng(0)), len(graspable)):
            corners = marker_corners(graspable.dims[each.block])[each.face]
            points = corners @ poses[each.block][:3, :3].T + poses[each.block][:3, 3]
            errors.append(each.corners - projected(points, camera.mounting, camera.intrinsics))
        assert len(errors) > 6
        assert np.abs(np.mean(errors, axis=(0, 1))).max() < 0.15
        assert np.median(np.abs(errors)) < 0.5


class TestEyes:
    def test_both_cameras_together(self, studio: Studio, graspable: BlockSet) -> None:
        """Three scenes of blocks that are turned, on the table and on each other."""
        errors, turns = [], []
        for seed in range(3):
            rng = np.random.default_rng(seed)
            poses = at_home(graspable)
            for where in poses[:2]:
                where[:3, :3] = about_z(rng.uniform(-np.pi, np.pi))
            poses[2] = pose((0.45, 0.0, graspable.dims[2, 2] / 2), about_z(rng.uniform(-np.pi, np.pi)))
            poses[3] = pose((0.45, 0.01, graspable.dims[2, 2] + graspable.dims[3, 2] / 2))
            found = seen(studio, poses, seed=seed)
            assert found.seen.all()
            well = np.flatnonzero(found.markers >= 3)
            assert len(well) >= 3
            errors += [distance(found.poses[i], poses[i]) for i in well]
            turns += [angle(found.poses[i], poses[i]) for i in well]
        assert np.median(errors) < 0.0015
        assert max(errors) < 0.006
        assert np.rad2deg(np.median(turns)) < 1.5

    def test_the_camera_on_the_hand_sees_before_a_grasp_and_in_the_hand(
        self, studio: Studio, graspable: BlockSet
    ) -> None:
        for block in range(len(graspable)):
            poses = at_home(graspable)
            poses[block] = pose((0.45, 0.05, graspable.dims[block, 2] / 2 + 0.1), about_z(0.4))
            grasp = next(g for g in grasps_of(graspable.dims[block], Gripper()) if g.pose[2, 2] < -0.9)
            target = poses[block] @ grasp.pose
            before = moved(target, -0.07 * target[:3, 2])
            q = inverse_kinematics(before, posture(before))[0]
            found = seen(studio, poses, (WRIST,), q, expected=poses)
            assert distance(found.poses[block], poses[block]) < 0.0015
            assert found.surprise[block] < 2
            lifted = moved(target, (0, 0, 0.1))
            q = inverse_kinematics(lifted, posture(lifted))[0]
            poses[block] = lifted @ inverse(grasp.pose)
            found = seen(studio, poses, (WRIST,), q, expected=poses)
            assert distance(found.poses[block], poses[block]) < 0.003

    def test_hidden_from_one_and_then_from_both(self, studio: Studio, graspable: BlockSet) -> None:
        """A block in the middle of three others that stand between it and the cameras."""
        poses = at_home(graspable)
        poses[0] = pose((0.45, 0.0, graspable.dims[0, 2] / 2))
        assert seen(studio, poses).markers[0] >= 3
        left = pose((0.49, 0.045, graspable.dims[1, 2] / 2), about_z(np.pi / 4))
        poses[1] = left
        one_side = seen(studio, poses)
        assert one_side.seen[0]
        assert distance(one_side.poses[0], poses[0]) < 0.03
        poses[0] = pose((0.0, 0.0, -0.5))
        nobody = seen(studio, poses)
        assert not nobody.seen[0]
        assert np.isnan(nobody.poses[0]).all()
        assert (nobody.markers[0], nobody.residual[0]) == (0, np.inf)
        assert nobody.seen[1:].all()

    def test_a_block_that_moved_surprises(self, studio: Studio, graspable: BlockSet) -> None:
        expected = at_home(graspable)
        poses = expected.copy()
        poses[1, 0, 3] += 0.04
        found = seen(studio, poses, expected=expected)
        assert found.surprise[1] > 15
        assert (found.surprise[[0, 2, 3]] < 2).all()
        assert np.isnan(seen(studio, poses).surprise).all(), "nothing was expected"

    def test_glare_hides_what_it_covers(self, studio: Studio, graspable: BlockSet) -> None:
        """A white spot over the markers of a block in one image: the other camera alone tells of that block."""
        poses = at_home(graspable)
        studio.set(poses, REST, OPEN)
        places = {name: CAMERAS[name].mounting for name in STATIC}
        images = {name: studio.photograph(CAMERAS[name], places[name], np.random.default_rng(0)) for name in STATIC}
        camera = CAMERAS["left"]
        x, y = projected(poses[0][:3, 3], camera.mounting, camera.intrinsics).round().astype(int)
        images["left"] = images["left"].copy()
        images["left"][y - 60 : y + 60, x - 60 : x + 60] = 255
        found = Eyes(CAMERAS, graspable).estimate(images, places)
        assert found.seen.all()
        assert distance(found.poses[0], poses[0]) < 0.03
        assert max(distance(a, b) for a, b in zip(found.poses[1:], poses[1:])) < 0.01

    def test_a_misread_marker_does_not_move_a_block(self, graspable: BlockSet, monkeypatch: pytest.MonkeyPatch) -> None:
        """Corners by projection, of which those of one face belong to another block."""
        from apf.panda.vision import eyes
        from apf.panda.vision.detection import Detection

        poses, places = at_home(graspable), {name: CAMERAS[name].mounting for name in STATIC}

        def corners(name: str, block: int, face: int) -> np.ndarray:
            points = marker_corners(graspable.dims[block])[face] @ poses[block][:3, :3].T + poses[block][:3, 3]
            return np.ascontiguousarray(projected(points, places[name], CAMERAS[name].intrinsics))

        def misread(image: np.ndarray, blocks: int) -> list[Detection]:
            name = "left" if image[0, 0] == 0 else "right"
            found = [Detection(0, face, corners(name, 0, face)) for face in (0, 4)]
            return found + ([Detection(0, 2, corners(name, 1, 2))] if name == "left" else [])

        monkeypatch.setattr(eyes, "detect", misread)
        shape = (CAMERAS["left"].height, CAMERAS["left"].width)
        images = {name: np.full(shape, value, np.uint8) for name, value in (("left", 0), ("right", 1))}
        found = Eyes(CAMERAS, graspable).estimate(images, places)
        assert found.markers[0] == 4, "the fifth is left out"
        assert distance(found.poses[0], poses[0]) < 1e-5

    def test_without_markers_nothing_is_seen(self, graspable: BlockSet) -> None:
        places = {name: CAMERAS[name].mounting for name in STATIC}
        empty = np.full((CAMERAS["left"].height, CAMERAS["left"].width), 127, np.uint8)
        for images in ({}, {"left": empty}, {"left": empty, "right": empty}):
            found = Eyes(CAMERAS, graspable).estimate(images, places, at_home(graspable))
            assert not found.seen.any()
            assert np.isnan(found.surprise).all()

    @pytest.mark.parametrize("image", [np.zeros((480, 640), np.uint8), np.zeros((720, 1280), np.float32)])
    def test_images_of_another_camera_are_refused(self, graspable: BlockSet, image: np.ndarray) -> None:
        with pytest.raises(ValueError, match=r"camera left: its image is .*; it must be \(720, 1280\) uint8"):
            Eyes(CAMERAS, graspable).estimate({"left": image}, {"left": CAMERAS["left"].mounting})
