"""Grasps hold the block between the fingers, and nothing else is in their way."""

import numpy as np
import pytest

from apf.errors import InputError
from apf.panda import PandaWorld
from apf.panda.grasps import FINGERTIP, Gripper, grasps_of
from apf.panda.layout import Layout
from apf.panda.stations import tilts
from apf.towers import BlockSet, TowerDomain, Towers


def domain_of(blocks: BlockSet) -> TowerDomain:
    """Towers of these blocks."""
    domain = TowerDomain()
    domain.__dict__["training_blocks"] = blocks
    return domain


GRIPPER = Gripper()


def block_of(*dims: float, mass: float = 0.1) -> BlockSet:
    return BlockSet(("thing",), np.array([dims]), np.zeros((1, 3)), np.array([mass]))


@pytest.mark.parametrize("dims", [(0.05, 0.06, 0.07), (0.04, 0.04, 0.04), (0.05, 0.145, 0.06), (0.075, 0.075, 0.075)])
def test_fingers_close_on_two_faces(dims: tuple[float, float, float]) -> None:
    sides = np.array(dims)
    for grasp in grasps_of(sides, GRIPPER):
        turn, place = grasp.pose[:3, :3], grasp.pose[:3, 3]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1)
        closing = np.abs(turn[:, 1])
        assert closing.max() == pytest.approx(1), "along an axis of the block"
        axis = int(closing.argmax())
        assert grasp.width == sides[axis] <= GRIPPER.widest
        assert place[axis] == 0, "half way between the faces"
        others = [other for other in range(3) if other != axis]
        assert (np.abs(place[others]) <= sides[others] / 2 - FINGERTIP + 1e-12).all(), "the pads are on the faces"
        behind = np.abs(turn[:, 2]) @ sides / 2 + turn[:, 2] @ place
        assert behind <= GRIPPER.depth + 1e-9, "the block stays clear of the palm"


def test_a_long_side_is_not_closed_on() -> None:
    widths = {grasp.width for grasp in grasps_of(np.array([0.05, 0.145, 0.06]), GRIPPER)}
    assert widths == {0.05, 0.06}


def test_a_block_that_is_too_thick_has_no_grasp() -> None:
    assert grasps_of(np.array([0.08, 0.08, 0.08]), GRIPPER) == []


def test_from_straight_above_is_not_tilted() -> None:
    found = grasps_of(np.array([0.05, 0.06, 0.07]), GRIPPER)
    tilt = tilts(np.eye(4), found)
    assert tilt.min() == pytest.approx(0, abs=1e-6)
    assert tilt.max() == pytest.approx(np.pi, abs=1e-6)


@pytest.mark.parametrize(
    ("blocks", "words"),
    [
        (block_of(0.09, 0.08, 0.10), ("block thing", "0.080 m", "0.075 m")),
        (block_of(0.05, 0.05, 0.2), ("block thing", "0.200 m", "0.15 m")),
        (block_of(0.05, 0.05, 0.05, mass=5), ("block thing", "5 kg", "2 kg")),
        (block_of(0.001, 0.1, 0.1), ("block thing",)),
    ],
)
def test_what_cannot_be_held_is_refused(blocks: BlockSet, words: tuple[str, ...]) -> None:
    world = PandaWorld()
    tower = Towers(blocks, np.zeros((1, 1), int), np.zeros((1, 1), int), np.zeros((1, 1, 2)))
    if blocks.dims.min() > 0.01:
        with pytest.raises(InputError) as error:
            world.execute(tower, np.random.default_rng(0))
        for word in words:
            assert word in str(error.value)
    assert not world._open, "nothing was started"


def test_too_many_blocks_are_refused() -> None:
    names = tuple(f"b{i}" for i in range(11))
    blocks = BlockSet(names, np.full((11, 3), 0.05), np.zeros((11, 3)), np.full(11, 0.1))
    with pytest.raises(InputError, match="11 blocks; the table has places for 10"):
        PandaWorld().check(domain_of(blocks), 2)


def test_a_tower_that_is_too_high_is_refused() -> None:
    names = tuple(f"b{i}" for i in range(10))
    blocks = BlockSet(names, np.tile([0.05, 0.05, 0.14], (10, 1)), np.zeros((10, 3)), np.full(10, 0.1))
    world = PandaWorld()
    world.check(domain_of(blocks), 4)
    with pytest.raises(InputError, match=r"0\.700 m high; over its base the arm reaches up to 0\.\d\d m"):
        world.check(domain_of(blocks), 5)


def test_a_place_off_the_table_is_refused() -> None:
    blocks = block_of(0.05, 0.05, 0.05)
    tower = Towers(blocks, np.zeros((1, 1), int), np.zeros((1, 1), int), np.array([[[2.0, 0.0]]]))
    with pytest.raises(InputError, match=r"block thing: its place.*off the table"):
        PandaWorld().execute(tower, np.random.default_rng(0))


@pytest.mark.parametrize("wrong", [{"base": (1.5, 0.0)}, {"pedestal": (0.4, -0.94)}, {"homes_radius": 1.2}])
def test_a_layout_off_the_table_is_refused(wrong: dict) -> None:
    with pytest.raises(ValueError, match="on this table it must be"):
        Layout(**wrong)
