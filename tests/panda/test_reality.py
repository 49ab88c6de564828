"""Every physics behind the hardware boundary: the arm goes where it is told, the gripper holds, what stands stands."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from pydantic import ValidationError

from apf.errors import InputError
from apf.panda.flaws import Flaws
from apf.panda.geometry import angle, distance, inverse, pose
from apf.panda.kinematics import REST, forward
from apf.panda.layout import Layout
from apf.panda.reality import Bullet, Physics, Reality
from apf.panda.reality.base import Hold
from apf.panda.reality.bullet import BulletReality
from apf.panda.reality.mujoco import Mujoco, MujocoReality
from apf.panda.vision.cameras import LEFT, WRIST
from apf.towers import BlockSet
from panda.scripted import go_above, place, reality_of, stack, take

PHYSICS = [Bullet(), Mujoco()]
Make = Callable[..., Reality]
SOMEWHERE = REST + np.array([0.4, 0.3, -0.2, 0.1, 0.2, 0.3, -0.5])


def homes_of(graspable: BlockSet) -> np.ndarray:
    return Layout().home_poses(graspable.dims)


@pytest.fixture(params=PHYSICS, ids=lambda physics: type(physics).__name__)
def physics(request: pytest.FixtureRequest) -> Physics:
    chosen: Physics = request.param
    return chosen


@pytest.fixture
def make(physics: Physics, graspable: BlockSet) -> Iterator[Make]:
    """`make(flaws, hold=..., poses=...)`: a reality of this physics that has begun; by default blocks are at home."""
    made = []

    def make(flaws: Flaws | None = None, hold: Hold = "friction", poses: np.ndarray | None = None) -> Reality:
        reality = reality_of(physics, flaws, hold)
        made.append(reality)
        reality.begin(graspable, homes_of(graspable) if poses is None else poses, np.random.default_rng(0))
        return reality

    yield make
    for reality in made:
        reality.close()


def test_a_tower_is_built_and_stands(make: Make, graspable: BlockSet) -> None:
    reality = make()
    tower = (2, 0, 1)
    goals = stack(reality, tower, graspable.dims)
    placed = [reality.pose_of(block) for block in tower]
    for where, goal in zip(placed, goals):
        assert distance(where, goal) < 0.003
        assert angle(where, goal) < np.deg2rad(3)
    reality.wait(10.0)
    assert max(distance(reality.pose_of(block), where) for block, where in zip(tower, placed)) < 0.001


def test_one_seed_one_result(make: Make, graspable: BlockSet) -> None:
    """In a new reality, and in one that has moved things before."""
    one, other = make(Flaws(release=0.002)), make(Flaws(release=0.002))
    take(other, 1, graspable.dims[1])
    other.begin(graspable, homes_of(graspable), np.random.default_rng(0))
    for reality in (one, other):
        stack(reality, (2,), graspable.dims)
    np.testing.assert_array_equal(one.poses(), other.poses())
    np.testing.assert_array_equal(one.joints(), other.joints())
    assert one.steps == other.steps


def test_the_arm_goes_where_it_is_told(make: Make) -> None:
    reality, speed = make(), 1.0
    places = []
    reality.on_step.append(lambda reality: places.append(reality.state().joints))
    reality.follow(np.array([(REST + SOMEWHERE) / 2, SOMEWHERE]), speed)
    np.testing.assert_allclose(reality.joints(), SOMEWHERE, atol=5e-4)
    np.testing.assert_allclose(reality.state().hand, forward(SOMEWHERE), atol=1e-3)
    fastest = np.abs(np.diff(places, axis=0)).max() * reality.rate
    assert fastest == pytest.approx(speed, rel=0.05)
    line = np.array(places) - REST
    along = line @ (SOMEWHERE - REST) / np.linalg.norm(SOMEWHERE - REST) ** 2
    assert np.abs(line - along[:, None] * (SOMEWHERE - REST)).max() < 0.004, "on a straight line between the joints"
    ideal = 0.5 / speed + speed / 6.0  # length over speed, and speed over acceleration
    assert ideal - 0.01 < reality.seconds() < ideal + 0.25


def test_time_passes_as_it_is_told(make: Make) -> None:
    reality = make()
    reality.wait(0.5)
    assert reality.seconds() == pytest.approx(0.5)
    assert reality.steps == 0.5 * reality.rate


def test_what_lies_does_not_move_and_what_is_put_lies_there(make: Make, graspable: BlockSet) -> None:
    reality, homes = make(), homes_of(graspable)
    reality.wait(1.0)
    assert max(map(distance, reality.poses(), homes)) < 5e-4
    where = pose((0.3, 0.3, graspable.dims[3, 2] / 2))
    reality.put(3, where)
    np.testing.assert_allclose(reality.pose_of(3), where, atol=1e-9)
    reality.wait(1.0)
    assert distance(reality.pose_of(3), where) < 5e-4


def test_the_gripper_measures_what_it_holds(make: Make, graspable: BlockSet) -> None:
    reality = make()
    assert reality.width() == pytest.approx(0.08, abs=1e-3)
    reality.grip()
    assert reality.width() < 0.002, "nothing is between the fingers"
    reality.release()
    assert reality.width() == pytest.approx(0.08, abs=2e-3)
    grasp = take(reality, 2, graspable.dims[2])
    assert reality.width() == pytest.approx(grasp.width, abs=1e-3)
    assert reality.pose_of(2)[2, 3] > 0.1, "it was lifted"


@pytest.mark.parametrize(("hold", "slip"), [("friction", 0.003), ("constraint", 0.0005)])
def test_a_block_stays_in_the_hand(hold: str, slip: float, make: Make, graspable: BlockSet) -> None:
    reality = make(hold=hold)
    grasp = take(reality, 2, graspable.dims[2])
    before = inverse(reality.state().hand) @ reality.pose_of(2)
    go_above(reality, pose((0.45, 0.0, 0.05)) @ grasp.pose)
    after = inverse(reality.state().hand) @ reality.pose_of(2)
    assert distance(before, after) < slip
    place(reality, 2, pose((0.45, 0.0, graspable.dims[2, 2] / 2)), grasp)
    assert distance(reality.pose_of(2), pose((0.45, 0.0, graspable.dims[2, 2] / 2))) < 0.003, "and lets go of it"


@pytest.mark.parametrize(("beyond", "falls"), [(-0.002, False), (0.002, True)])
def test_what_leans_too_far_falls(beyond: float, falls: bool, make: Make, graspable: BlockSet) -> None:
    """The centre of mass of the upper block is so far beyond the edge of the lower one."""
    below, above = 2, 0
    dims, com = graspable.dims, graspable.com
    poses = homes_of(graspable)
    poses[below] = pose((0.45, 0.0, dims[below, 2] / 2))
    x = 0.45 + dims[below, 0] / 2 + beyond - com[above, 0]
    poses[above] = pose((x, -com[above, 1], dims[below, 2] + dims[above, 2] / 2))
    reality = make(poses=poses)
    reality.wait(2.0)
    assert (distance(reality.pose_of(above), poses[above]) > 0.02) == falls


def slide(reality: Reality, block: int, speed: float) -> float:
    """How far a block slides in x that has this speed."""
    if isinstance(reality, MujocoReality):
        reality.data.joint(f"block_{block}").qvel[0] = speed
    else:
        assert isinstance(reality, BulletReality)
        reality.client.resetBaseVelocity(reality.scene.bodies[block], (speed, 0, 0))
    before = reality.pose_of(block)
    reality.wait(1.0)
    return distance(before, reality.pose_of(block))


@pytest.mark.parametrize("factor", [1.0, 0.6])
def test_friction_is_the_product_of_both_coefficients(factor: float, make: Make) -> None:
    """Sliding ends after v^2 / (2 mu g), if the block is too flat to tip."""
    flat = BlockSet(("flat",), np.array([[0.075, 0.075, 0.03]]), np.zeros((1, 3)), np.array([0.1]))
    reality = make(Flaws(friction=factor))
    reality.begin(flat, pose((0.3, 0.3, 0.015))[None], np.random.default_rng(0))
    reality.wait(0.5)
    assert slide(reality, 0, 0.6) == pytest.approx(0.6**2 / (2 * 0.6 * 0.6 * factor * 9.81), rel=0.03)


def test_joints_are_said_as_they_are_measured(make: Make) -> None:
    flaws = Flaws(joints=1.0)
    reality = make(flaws)
    zeros = reality.photographer.drawn.zeros
    assert np.abs(zeros).max() > np.deg2rad(0.5)
    reality.follow(SOMEWHERE[None], 1.0)
    np.testing.assert_allclose(reality.joints(), SOMEWHERE, atol=5e-4)
    np.testing.assert_allclose(reality.state().joints, SOMEWHERE + zeros, atol=5e-4)


def test_the_gripper_drags_what_it_lets_go(make: Make, graspable: BlockSet) -> None:
    """By as much as the flaws say, along the line on which the fingers close: y here."""
    drag, moved = 0.004, []
    for flaws in (Flaws(), Flaws(drag=drag)):
        reality = make(flaws)
        goal = stack(reality, (2,), graspable.dims)[0]
        moved.append((reality.pose_of(2) - goal)[:2, 3])
    np.testing.assert_allclose(np.abs(moved[1] - moved[0]), [0.0, drag], atol=2e-4)


def test_masses_are_as_drawn(make: Make, graspable: BlockSet) -> None:
    """A block whose centre of mass really lies beyond the edge falls, though its file says that it stands."""
    below, above = 2, 0
    dims = graspable.dims
    drawn = make(Flaws(com=0.01)).photographer.drawn.blocks(graspable)
    shift = drawn.com[above, :2] - graspable.com[above, :2]
    axis = int(np.abs(shift).argmax())
    away = np.sign(shift[axis])
    poses = homes_of(graspable)
    poses[below] = pose((0.45, 0.0, dims[below, 2] / 2))
    place = np.array([0.45, 0.0]) - graspable.com[above, :2]
    place[axis] += away * (dims[below, axis] / 2 - np.abs(shift[axis]) / 2)
    poses[above] = pose((*place, dims[below, 2] + dims[above, 2] / 2))
    for flaws, falls in ((Flaws(), False), (Flaws(com=0.01), True)):
        reality = make(flaws, poses=poses)
        reality.wait(2.0)
        assert (distance(reality.pose_of(above), poses[above]) > 0.02) == falls


def test_cameras_see_reality(make: Make, graspable: BlockSet) -> None:
    reality = make()
    images = reality.images([LEFT, WRIST])
    assert {name: image.shape for name, image in images.items()} == {LEFT: (720, 1280), WRIST: (480, 640)}
    reality.put(0, pose((0.45, 0.0, graspable.dims[0, 2] / 2)))
    assert np.abs(reality.images([LEFT])[LEFT].astype(int) - images[LEFT]).max() > 60


def test_what_mujoco_refuses() -> None:
    with pytest.raises(InputError, match="no window"):
        reality_of(Mujoco(), gui=True)
    with pytest.raises(ValidationError, match="two steps of 1/250 s"):
        Mujoco(rate=250)
