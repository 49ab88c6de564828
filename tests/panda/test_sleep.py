"""Blocks at rest sleep in PyBullet, and wake as soon as anything happens to them."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from apf.panda.geometry import distance, moved, pose
from apf.panda.layout import Layout
from apf.panda.reality import Bullet
from apf.panda.reality.base import Hold
from apf.panda.reality.bullet import BulletReality
from apf.towers import BlockSet
from panda.scripted import go_above, go_straight, reality_of, take

ASLEEP = 5.0
"""After so long [s] what rests sleeps."""
BASE = (0.45, 0.0)
DOWN = np.diag([1.0, -1.0, -1.0])
"""How the hand points straight down, with its fingers beside each other in y."""
Begin = Callable[..., BulletReality]


@pytest.fixture
def begin() -> Iterator[Begin]:
    """`begin(dims, poses, hold)`: a reality with blocks of these sides [B, 3] at these poses [B, 4, 4], asleep."""
    made = []

    def begin(dims: np.ndarray, poses: np.ndarray, hold: Hold = "friction") -> BulletReality:
        n = len(dims)
        blocks = BlockSet(tuple(f"b{i}" for i in range(n)), dims, np.zeros((n, 3)), np.full(n, 0.1))
        reality = reality_of(Bullet(), hold=hold)
        assert isinstance(reality, BulletReality)
        made.append(reality)
        reality.begin(blocks, poses, np.random.default_rng(0))
        reality.wait(ASLEEP)
        return reality

    yield begin
    for reality in made:
        reality.close()


def cubes(n: int, side: float = 0.05) -> np.ndarray:
    return np.full((n, 3), side)


def tower(n: int, side: float = 0.05) -> np.ndarray:
    """[n, 4, 4] of cubes on each other, each 2 mm beside the one below it."""
    return np.array([pose((BASE[0] + 0.002 * (i % 2), BASE[1], (i + 0.5) * side)) for i in range(n)])


def awake(reality: BulletReality) -> bool:
    """Does anything move, by however little? What is awake never comes to rest to the last bit."""
    before = reality.poses()
    reality.wait(0.5)
    return not np.array_equal(reality.poses(), before)


def push(reality: BulletReality) -> None:
    """The hand passes through the upper half of the tower."""
    target = pose((*BASE, 0.16), DOWN)
    target[1, 3] += 0.2
    go_above(reality, target)
    go_straight(reality, target)
    go_straight(reality, moved(target, (0, -0.3, 0)))


def test_what_rests_sleeps(begin: Begin, graspable: BlockSet) -> None:
    """Blocks at home, and a tower of five; until they sleep, they lie where they were put."""
    reality = begin(cubes(5), tower(5))
    assert not awake(reality)
    assert max(map(distance, reality.poses(), tower(5))) < 1e-3
    homes = Layout().home_poses(graspable.dims)
    reality.begin(graspable, homes, np.random.default_rng(0))
    assert awake(reality)
    reality.wait(ASLEEP)
    assert not awake(reality)


def test_what_is_put_away_takes_the_support_with_it(begin: Begin) -> None:
    reality = begin(cubes(3), tower(3))
    reality.put(0, pose((0.3, 0.4, 0.025)))
    reality.wait(1.0)
    np.testing.assert_allclose(reality.poses()[1:, 2, 3], [0.025, 0.075], atol=0.001)
    reality.wait(ASLEEP)
    assert not awake(reality), "and they sleep again"


def test_what_is_put_in_the_air_falls(begin: Begin) -> None:
    """Also if it slept, and nothing is near it."""
    reality = begin(cubes(2), tower(2))
    reality.put(1, pose((0.3, 0.4, 0.2)))
    reality.wait(1.0)
    np.testing.assert_allclose(reality.pose_of(1)[2, 3], 0.025, atol=0.001)


def test_what_the_gripper_takes_away_takes_the_support_with_it(begin: Begin) -> None:
    """A bridge from a cube to a long block: the long block is gripped at its far end, and dragged away."""
    dims = np.array([[0.05, 0.05, 0.05], [0.14, 0.05, 0.05], [0.10, 0.05, 0.05]])
    edge = 0.40
    poses = np.array(
        [pose((edge - 0.025, 0, 0.025)), pose((edge + 0.08, 0, 0.025)), pose((edge + 0.008, 0, 0.075))],
    )
    reality = begin(dims, poses)
    assert not awake(reality)
    grasp = pose((edge + 0.12, 0, 0.025), DOWN)
    go_above(reality, grasp)
    go_straight(reality, grasp)
    reality.grip()
    assert distance(reality.pose_of(2), poses[2]) < 0.002, "it still lies on both"
    go_straight(reality, moved(grasp, (0.1, 0, 0)))
    reality.wait(0.5)
    assert distance(reality.pose_of(1), poses[1]) > 0.08, "the long block was dragged away"
    assert abs(reality.pose_of(2)[2, 0]) > 0.3, "the bridge has tipped"


def test_a_tower_that_is_pushed_falls(begin: Begin) -> None:
    reality = begin(cubes(5), tower(5))
    assert not awake(reality)
    push(reality)
    reality.wait(1.0)
    np.testing.assert_allclose(reality.poses()[:, 2, 3], 0.025, atol=0.002)


@pytest.mark.parametrize("hold", ["friction", "constraint"])
def test_what_is_held_does_not_sleep_in_the_air(hold: Hold, begin: Begin) -> None:
    reality = begin(cubes(1), tower(1), hold)
    take(reality, 0, np.full(3, 0.05))
    reality.wait(ASLEEP)
    assert reality.pose_of(0)[2, 3] > 0.1
    reality.release()
    reality.wait(1.0)
    np.testing.assert_allclose(reality.pose_of(0)[2, 3], 0.025, atol=0.001)


def test_one_seed_one_result(begin: Begin) -> None:
    """To the last bit, through sleeping and waking, also in a reality in which blocks slept before."""
    one, other = begin(cubes(5), tower(5)), begin(cubes(5, 0.04), tower(5, 0.04))
    other.begin(one.known, tower(5), np.random.default_rng(0))
    other.wait(ASLEEP)
    for reality in (one, other):
        push(reality)
        reality.wait(ASLEEP)
    np.testing.assert_array_equal(one.poses(), other.poses())
    np.testing.assert_array_equal(one.joints(), other.joints())
