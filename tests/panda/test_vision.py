"""What the robot sees of blocks, in images of scenes whose true poses are known."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from apf.errors import InputError
from apf.panda.geometry import about_z, angle, distance, inverse, moved, pose
from apf.panda.grasps import Gripper, grasps_of
from apf.panda.kinematics import REST, forward, inverse_kinematics
from apf.panda.layout import Layout
from apf.panda.scene import OPEN, WOOD
from apf.panda.stations import Reach, posture, tilts
from apf.panda.vision import Camera, Cameras, Eyes, Sighting
from apf.panda.vision.cameras import LEFT, RIGHT, STATIC, WRIST, projected
from apf.panda.vision.detection import detect
from apf.panda.vision.markers import marker_corners, marker_image
from apf.panda.vision.studio import BACKGROUND, TABLE, Studio
from apf.towers import ROTATIONS, BlockSet

BASE = np.array([0.45, 0.0])


@dataclass
class Stage:
    """Four blocks, what photographs them, and what looks at the images. `poses` are where the blocks are."""

    blocks: BlockSet
    studio: Studio
    cameras: dict[str, Camera]
    eyes: Eyes

    def home(self) -> np.ndarray:
        return Layout().home_poses(self.blocks.dims)

    def images(
        self, poses: np.ndarray, names: Sequence[str] = STATIC, q: np.ndarray = REST, fingers: float = OPEN
    ) -> dict[str, np.ndarray]:
        self.studio.prepare(self.blocks)
        self.studio.set(poses, q, (fingers, fingers))
        rng, places = np.random.default_rng(0), self.places(q)
        return {name: self.studio.photograph(self.cameras[name], places[name], rng) for name in names}

    def places(self, q: np.ndarray = REST) -> dict[str, np.ndarray]:
        hand = forward(q)
        return {name: hand @ each.mounting if name == WRIST else each.mounting for name, each in self.cameras.items()}

    def sighting(self, poses: np.ndarray, names: Sequence[str] = STATIC, q: np.ndarray = REST) -> Sighting:
        return self.eyes.estimate(self.images(poses, names, q), self.places(q))

    def pixels(self, name: str, where: np.ndarray, block: int) -> np.ndarray:
        """[6, 4, 2] of the corners of a block's markers in the image of a camera."""
        points = marker_corners(self.blocks.dims[block]) @ where[:3, :3].T + where[:3, 3]
        return projected(points, self.places()[name], self.cameras[name].intrinsics)


@pytest.fixture(scope="module")
def stage(graspable: BlockSet) -> Iterator[Stage]:
    cameras = Cameras().named()
    studio = Studio(Layout())
    yield Stage(graspable, studio, cameras, Eyes(cameras, graspable))
    studio.close()


def on_table(stage: Stage, block: int, xy: np.ndarray, turn: np.ndarray) -> np.ndarray:
    return pose((*xy, np.abs(turn[2]) @ stage.blocks.dims[block] / 2), turn)


def nothing_seen(found: Sighting) -> bool:
    return not found.seen.any() and bool(np.isnan(found.poses).all()) and not found.markers.any()


def wall(stage: Stage, block: np.ndarray, name: str, before: float = 0.12) -> np.ndarray:
    """[4, 4] of a block in the air right before another, in the way of a camera."""
    towards = stage.places()[name][:3, 3] - block[:3, 3]
    return pose(block[:3, 3] + before * towards / np.linalg.norm(towards), stage.places()[name][:3, :3])


# -- images ------------------------------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_image_bit_for_bit(stage: Stage) -> None:
    """Again, and in another studio; another seed gives other noise alone."""
    first = stage.images(stage.home(), [LEFT, WRIST])
    stage.images(stage.home()[::-1], [RIGHT])
    again = stage.images(stage.home(), [LEFT, WRIST])
    other = Studio(Layout())
    other.prepare(stage.blocks)
    other.set(stage.home(), REST, (OPEN, OPEN))
    elsewhere = other.photograph(stage.cameras[LEFT], stage.places()[LEFT], np.random.default_rng(0))
    noisy = other.photograph(stage.cameras[LEFT], stage.places()[LEFT], np.random.default_rng(1))
    other.close()
    for name in (LEFT, WRIST):
        assert first[name].dtype == np.uint8
        assert first[name].shape == (stage.cameras[name].height, stage.cameras[name].width)
        assert (first[name] == again[name]).all()
    assert (first[LEFT] == elsewhere).all()
    difference = (noisy.astype(float) - elsewhere)[100:-100, 100:-100]
    assert difference.std() == pytest.approx(4 * np.sqrt(2), rel=0.1)
    assert abs(difference.mean()) < 0.1


@pytest.mark.parametrize("many", [1, 2])
def test_images_are_as_the_intrinsics_say(stage: Stage, many: int) -> None:
    """Corners are where they should be, on average to a tenth of a pixel, also if an image is rendered finer."""
    camera = Camera(position=(0.95, 0.75, 0.75), target=(0.2, 0.0, 0.1), noise=0, supersampling=many)
    places = BASE + 0.12 * np.array([[-1.5, 1.5], [-0.5, 0.5], [0.5, -0.5], [1.5, -1.5]])
    poses = np.array([on_table(stage, i, places[i], about_z(0.4 * i)) for i in range(4)])
    stage.studio.prepare(stage.blocks)
    stage.studio.set(poses, REST, (OPEN, OPEN))
    image = stage.studio.photograph(camera, camera.mounting, np.random.default_rng(0))
    found = detect(image, 4)
    assert len(found) >= 8
    true = np.array([stage.pixels(LEFT, poses[each.block], each.block)[each.face] for each in found])
    off = np.array([each.corners for each in found]) - true
    assert np.abs(off.mean((0, 1))).max() < 0.1
    outwards = true - true.mean(1, keepdims=True)
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    assert abs((off * outwards).sum(-1).mean()) < 0.08, "markers are neither larger nor smaller"
    assert np.sqrt((off**2).sum(-1).mean()) < 0.4


class Plain(Studio):
    """The renderer draws the table, too."""

    def prepare(self, blocks: BlockSet) -> None:
        super().prepare(blocks)
        self.client.changeVisualShape(self.table, -1, rgbaColor=WOOD)

    def _table_seen(self, camera: Camera, where: np.ndarray, depth: np.ndarray) -> np.ndarray:
        return np.zeros_like(depth, bool)


@pytest.mark.parametrize(("view", "many"), [("edge", 1), ("corner", 2), ("left", 2), ("wrist", 1)])
def test_the_table_is_drawn_as_the_renderer_draws_it(stage: Stage, view: str, many: int) -> None:
    """Its edges in view, and blocks that lie on it, hang over an edge, and lie beside it, lower down."""
    (_, far), (right, _) = Layout().table_x, Layout().table_y
    places = stage.places()
    sight = {"noise": 0.0, "supersampling": many}
    camera, where = {
        "edge": (Camera(position=(0.4, 0.1, 0.5), target=(far, 0, 0), **sight), None),
        "corner": (Camera(position=(0.5, -0.5, 0.6), target=(far, right, 0), **sight), None),
        "left": (replace(stage.cameras[LEFT], **sight), places[LEFT]),
        "wrist": (replace(stage.cameras[WRIST], **sight), places[WRIST]),
    }[view]
    poses = stage.home()
    poses[0] = on_table(stage, 0, np.array([far, 0.0]), about_z(0.3))
    poses[1] = on_table(stage, 1, np.array([far - 0.1, right + 0.01]), about_z(0.7))
    poses[2] = moved(on_table(stage, 2, np.array([far + 0.05, -0.1]), about_z(0.2)), (0, 0, -0.03))
    pictures = []
    for cls in (Studio, Plain):
        studio = cls(Layout())
        studio.prepare(stage.blocks)
        studio.set(poses, REST, (OPEN, OPEN))
        pictures.append(
            studio.photograph(camera, camera.mounting if where is None else where, np.random.default_rng(0)).astype(int)
        )
        studio.close()
    off = np.abs(pictures[0] - pictures[1])
    assert (off > 3).mean() < 2e-5
    if view in ("edge", "corner"):
        assert {TABLE, BACKGROUND} <= set(pictures[0].ravel()), "both sides of an edge are in view"


def test_other_blocks_are_built_anew(stage: Stage) -> None:
    images = stage.images(stage.home(), [LEFT])
    fewer = stage.blocks.subset(np.array([1, 0]))
    stage.studio.prepare(fewer)
    stage.studio.set(Layout().home_poses(fewer.dims), REST, (OPEN, OPEN))
    image = stage.studio.photograph(stage.cameras[LEFT], stage.places()[LEFT], np.random.default_rng(0))
    assert {each.block for each in detect(image, 4)} == {0, 1}
    assert (stage.images(stage.home(), [LEFT])[LEFT] == images[LEFT]).all()


def test_too_many_blocks_are_refused_before_anything_is_built() -> None:
    many = BlockSet(tuple(f"b{i}" for i in range(42)), np.full((42, 3), 0.05), np.zeros((42, 3)), np.ones(42))
    studio = Studio(Layout())
    with pytest.raises(InputError, match="there are 42 blocks; there are markers for 41"):
        studio.prepare(many)
    assert studio.bodies == []
    studio.close()


# -- poses -------------------------------------------------------------------------------------------------------


def test_blocks_on_the_table_are_seen_by_both_cameras_together(stage: Stage) -> None:
    """Random scenes: every block is seen, to half a millimetre and a degree in the middle."""
    rng = np.random.default_rng(5)
    away, turned = [], []
    for _ in range(5):
        poses = stage.home()
        for block in range(4):
            turn = about_z(rng.uniform(-np.pi, np.pi)) @ ROTATIONS[rng.integers(24)]
            poses[block] = on_table(stage, block, poses[block, :2, 3], turn)
        found = stage.sighting(poses)
        assert found.seen.all()
        assert (found.residual < 2).all()
        assert (found.markers >= 2).all()
        away += [distance(*pair) for pair in zip(found.poses, poses)]
        turned += [angle(*pair) for pair in zip(found.poses, poses)]
    assert np.median(away) < 0.001
    assert np.quantile(away, 0.9) < 0.002
    assert np.rad2deg(np.median(turned)) < 1


def test_a_tower_is_seen(stage: Stage) -> None:
    """Four blocks one upon the other, each turned: all of them."""
    heights = stage.blocks.dims[:, 2]
    below = np.cumsum(heights) - heights
    poses = np.array([pose((*BASE, below[i] + heights[i] / 2), about_z(0.3 * i)) for i in range(4)])
    found = stage.sighting(poses)
    assert found.seen.all()
    assert max(distance(*pair) for pair in zip(found.poses, poses)) < 0.003


def test_the_camera_on_the_hand_sees_the_block_before_the_grasp_and_after_the_retreat(stage: Stage) -> None:
    """From where the approach begins, for grasps of all kinds; it is the place where the retreat ends."""
    rng = np.random.default_rng(6)
    away, turned = [], []
    while len(away) < 12:
        block = len(away) % 4
        poses = stage.home()
        turn = about_z(rng.uniform(-np.pi, np.pi)) @ ROTATIONS[rng.integers(24)]
        poses[block] = on_table(stage, block, BASE, turn)
        grasps = grasps_of(stage.blocks.dims[block], Gripper())
        grasp = int(rng.integers(len(grasps)))
        if tilts(poses[block], grasps)[grasp] > np.deg2rad(50):
            continue
        target = poses[block] @ grasps[grasp].pose
        joints = inverse_kinematics(moved(target, -Reach().approach * target[:3, 2]), posture(target))
        if not len(joints):
            continue
        found = stage.sighting(poses, [WRIST], joints[0])
        assert found.seen[block]
        away.append(distance(found.poses[block], poses[block]))
        turned.append(angle(found.poses[block], poses[block]))
    assert np.median(away) < 0.0015
    assert np.max(away) < 0.004
    assert np.rad2deg(np.median(turned)) < 0.5


def test_all_cameras_together_make_one_estimate(stage: Stage) -> None:
    """More markers, and not worse than the better of the two parts."""
    block = stage.blocks.dims[0]
    poses = stage.home()
    poses[0] = pose((*BASE, block[2] / 2))
    target = pose((*BASE, block[2] / 2 + 0.09), np.diag([1.0, -1.0, -1.0]))
    q = inverse_kinematics(target, posture(target))[0]
    images, places = stage.images(poses, [*STATIC, WRIST], q), stage.places(q)
    parts = [stage.eyes.estimate({name: images[name] for name in names}, places) for names in (STATIC, [WRIST])]
    joint = stage.eyes.estimate(images, places)
    assert joint.markers[0] == sum(part.markers[0] for part in parts) >= 3
    assert distance(joint.poses[0], poses[0]) < 0.001


def test_a_block_in_the_hand_is_seen(stage: Stage) -> None:
    """A block held from above, 20 cm over the table."""
    grasps = grasps_of(stage.blocks.dims[0], Gripper())
    upright = [i for i in range(len(grasps)) if tilts(np.eye(4), grasps)[i] < 0.01]
    where = pose((*BASE, 0.2))
    poses = stage.home()
    poses[0] = where
    seen = 0
    for i in upright:
        target = where @ grasps[i].pose
        for q in inverse_kinematics(target, posture(target))[:1]:
            images = stage.images(poses, [WRIST], q, fingers=grasps[i].width / 2)
            found = stage.eyes.estimate(images, stage.places(q))
            seen += int(found.seen[0])
            if found.seen[0]:
                assert distance(found.poses[0], where) < 0.003
    assert seen >= len(upright) / 2


# -- what disturbs -----------------------------------------------------------------------------------------------


def test_a_block_that_one_camera_does_not_see_is_seen_by_the_other(stage: Stage) -> None:
    poses = stage.home()
    poses[1] = on_table(stage, 1, BASE, np.eye(3))
    free = stage.sighting(poses)
    poses[3] = wall(stage, poses[1], LEFT)
    half = stage.eyes.estimate(stage.images(poses, [LEFT]), stage.places())
    assert not half.seen[1], "it is hidden from the left"
    found = stage.sighting(poses)
    assert found.seen[1]
    assert found.markers[1] < free.markers[1]
    assert distance(found.poses[1], poses[1]) < 0.03
    assert np.rad2deg(angle(found.poses[1], poses[1])) < 6


def test_a_block_that_no_camera_sees_is_not_seen(stage: Stage) -> None:
    poses = stage.home()
    poses[1] = on_table(stage, 1, BASE, np.eye(3))
    poses[2], poses[3] = wall(stage, poses[1], RIGHT), wall(stage, poses[1], LEFT)
    found = stage.sighting(poses)
    assert not found.seen[1]
    assert np.isnan(found.poses[1]).all()
    assert found.markers[1] == 0
    assert found.seen[[0, 2, 3]].all(), "the others are"


def test_glare_on_a_marker(stage: Stage) -> None:
    """Patches that are nothing but white: the other markers tell the pose. All of a block white: it is not seen."""
    poses = stage.home()
    poses[1] = on_table(stage, 1, BASE, about_z(0.2))
    images = stage.images(poses)
    free = stage.eyes.estimate(images, stage.places())
    for name in STATIC:
        top = stage.pixels(name, poses[1], 1)[4]
        (x0, y0), (x1, y1) = top.min(0).astype(int), top.max(0).astype(int)
        images[name][y0 : (y0 + y1) // 2, x0:x1] = 255
    found = stage.eyes.estimate(images, stage.places())
    assert found.seen.all()
    assert found.markers[1] <= free.markers[1] - 2
    assert distance(found.poses[1], poses[1]) < 0.005
    for name in STATIC:
        corners = stage.pixels(name, poses[1], 1).reshape(-1, 2)
        (x0, y0), (x1, y1) = corners.min(0).astype(int) - 5, corners.max(0).astype(int) + 5
        images[name][y0:y1, x0:x1] = 255
    found = stage.eyes.estimate(images, stage.places())
    assert list(found.seen) == [True, False, True, True]


def test_a_block_at_the_edge_of_an_image(stage: Stage) -> None:
    """A marker that is cut off does not count; what is left of the block does not mislead."""
    camera = stage.cameras[LEFT]
    poses = stage.home()
    poses[0] = on_table(stage, 0, BASE, about_z(0.3))
    centre = stage.pixels(LEFT, poses[0], 0)[4].mean(0)
    images = stage.images(poses)
    for cut in range(-40, 41, 8):
        part = images[LEFT].copy()
        part[:, : int(centre[0]) + cut] = 200
        found = stage.eyes.estimate({LEFT: part, RIGHT: images[RIGHT]}, stage.places())
        assert found.seen[0]
        assert distance(found.poses[0], poses[0]) < 0.03
    assert camera.width > centre[0] + 40


def test_an_image_without_markers(stage: Stage) -> None:
    camera = stage.cameras[LEFT]
    shape = (camera.height, camera.width)
    noise = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    for image in (np.zeros(shape, np.uint8), np.full(shape, 255, np.uint8), noise):
        found = stage.eyes.estimate({LEFT: image}, stage.places())
        assert nothing_seen(found)
        assert found.poses.shape == (4, 4, 4)
    assert nothing_seen(stage.eyes.estimate({}, stage.places())), "no camera answered"


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.zeros((480, 640), np.uint8), r"camera left: its image is \(480, 640\) uint8; it must be \(720, 1280\)"),
        (np.zeros((720, 1280)), "float64; it must be"),
        (np.zeros((720, 1280, 3), np.uint8), r"\(720, 1280, 3\)"),
        (np.zeros((0, 0), np.uint8), r"\(0, 0\)"),
    ],
)
def test_an_image_of_another_kind_is_refused(stage: Stage, image: np.ndarray, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        stage.eyes.estimate({LEFT: image}, stage.places())


def test_a_misread_marker_does_not_ruin_a_pose(stage: Stage) -> None:
    """The marker of a face that looks away seems to lie elsewhere: it is left out, and no other block is touched."""
    poses = stage.home()
    poses[1] = on_table(stage, 1, BASE, about_z(0.2))
    images = stage.images(poses)
    free = stage.eyes.estimate(images, stage.places())
    away = next(face for face in range(6) if face not in {d.face for d in detect(images[LEFT], 4) if d.block == 1})
    images[LEFT][40:80, 40:80] = marker_image(6 + away, 5)
    assert any((d.block, d.face) == (1, away) for d in detect(images[LEFT], 4)), "it is read"
    found = stage.eyes.estimate(images, stage.places())
    assert found.seen.all()
    assert (found.markers == free.markers).all()
    np.testing.assert_allclose(found.poses, free.poses, atol=1e-5)


def test_a_marker_that_is_there_twice_does_not_ruin_a_pose(stage: Stage) -> None:
    poses = stage.home()
    poses[1] = on_table(stage, 1, BASE, about_z(0.2))
    images = stage.images(poses)
    free = stage.eyes.estimate(images, stage.places())
    one = next(each for each in detect(images[LEFT], 4) if each.block == 1)
    images[LEFT][40:80, 40:80] = marker_image(6 + one.face, 5)
    found = stage.eyes.estimate(images, stage.places())
    assert found.markers[1] == free.markers[1] - 1
    assert distance(found.poses[1], poses[1]) < 0.003


# -- one block alone ---------------------------------------------------------------------------------------------


def test_one_block_is_estimated_as_it_is_among_all(stage: Stage) -> None:
    """To the last bit, and of the others nothing is said."""
    poses = stage.home()
    poses[1] = on_table(stage, 1, BASE, about_z(0.2))
    images, expected = stage.images(poses), stage.home()
    whole = stage.eyes.estimate(images, stage.places(), expected)
    assert whole.seen.all()
    for block in range(4):
        alone = stage.eyes.estimate(images, stage.places(), expected, only=block)
        others = np.arange(4) != block
        for name, values in vars(alone).items():
            if name == "doubled":
                assert values == ()
                continue
            np.testing.assert_array_equal(values[block], vars(whole)[name][block], err_msg=name)
        assert not alone.seen[others].any()
        assert np.isnan(alone.poses[others]).all()
        assert np.isnan(alone.surprise[others]).all()


# -- what was expected -------------------------------------------------------------------------------------------


def test_what_moved_surprises(stage: Stage) -> None:
    """Of four blocks one was moved by 5 cm; of one that is not seen, nothing is said."""
    expected = stage.home()
    poses = expected.copy()
    poses[2] = moved(poses[2], (0.05, 0, 0))
    poses[3, 2, 3] += 9  # out of view
    found = stage.eyes.estimate(stage.images(poses), stage.places(), expected)
    assert (found.surprise[:2] < 2).all()
    assert found.surprise[2] > 15
    assert np.isnan(found.surprise[3])
    assert not found.seen[3]
    assert np.isnan(stage.eyes.estimate({}, stage.places()).surprise).all()


def test_the_camera_on_the_hand_is_where_the_hand_is(stage: Stage) -> None:
    """Joints that are off by half a degree move what it sees as they move the hand."""
    block = stage.blocks.dims[0]
    poses = stage.home()
    poses[0] = pose((*BASE, block[2] / 2))
    target = pose((*BASE, block[2] / 2 + 0.09), np.diag([1.0, -1.0, -1.0]))
    q = inverse_kinematics(target, posture(target))[0]
    images = stage.images(poses, [WRIST], q)
    told = q + np.deg2rad(0.5)
    found = stage.eyes.estimate(images, stage.places(told))
    expected = forward(told) @ inverse(forward(q)) @ poses[0]
    assert distance(expected, poses[0]) > 0.003
    assert distance(found.poses[0], expected) < 0.0015


class Finely(Studio):
    """A studio whose arm is drawn by the meshes of its maker."""

    plain = False


def arm_seen(studio: Studio, q: np.ndarray) -> np.ndarray:
    """[240, 320] bool: in which pixels is the arm?"""
    client = studio.client
    studio.pose_arm(q)
    view = client.computeViewMatrix((1.5, 1.0, 0.9), (0.1, 0.0, 0.4), (0, 0, 1))
    picture = client.getCameraImage(
        *(320, 240), view, client.computeProjectionMatrixFOV(50, 4 / 3, 0.1, 4.0), renderer=client.ER_TINY_RENDERER
    )
    return np.reshape(picture[4], (240, 320)) == studio.robot


@pytest.mark.parametrize("turn", [0.0, 0.9])
def test_the_arm_hides_what_the_finer_one_hides_and_little_more(stage: Stage, turn: float) -> None:
    """It is drawn by the convex meshes that it collides with."""
    stage.studio.prepare(stage.blocks)
    finely = Finely(Layout())
    finely.prepare(stage.blocks)
    q = REST + turn * np.eye(len(REST))[0]
    plain, fine = arm_seen(stage.studio, q), arm_seen(finely, q)
    finely.close()
    assert fine.sum() > 2000
    assert (fine & ~plain).sum() < 0.02 * fine.sum()
    assert (plain & ~fine).sum() < 0.12 * fine.sum()
