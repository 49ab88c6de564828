import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from apf.towers import BlockSet, Overhang, Tallest, Towers, Unsupported, random_towers, rotation_index

HALF = np.sqrt(0.5)
UPRIGHT = 0
ABOUT_X = int(rotation_index(np.array([HALF, 0, 0, HALF])))  # sides (x, z, y)
ABOUT_Z = int(rotation_index(np.array([0, 0, HALF, HALF])))  # sides (y, x, z)

seeds = st.integers(0, 2**32 - 1)
tasks = pytest.mark.parametrize("task", [Tallest(), Overhang(), Unsupported()], ids=lambda t: type(t).__name__)


@pytest.fixture(scope="module")
def bricks():
    """a: 6 x 8 x 10 cm, b: 12 x 5 x 7 cm, c: 4 x 4 x 4 cm, with odd masses and centres."""
    return BlockSet(
        ("a", "b", "c"),
        np.array([[0.06, 0.08, 0.10], [0.12, 0.05, 0.07], [0.04, 0.04, 0.04]]),
        np.array([[0.02, 0.03, -0.04], [0.05, 0.0, 0.0], [0.0, 0.01, 0.0]]),
        np.array([0.9, 0.1, 0.5]),
    )


@pytest.mark.parametrize(
    ("rotations", "height"),
    [
        ((UPRIGHT, UPRIGHT), 0.10 + 0.07),
        ((ABOUT_X, UPRIGHT), 0.08 + 0.07),
        ((ABOUT_X, ABOUT_X), 0.08 + 0.05),
        ((ABOUT_Z, ABOUT_Z), 0.10 + 0.07),
    ],
)
def test_tallest_is_the_sum_of_heights(build, bricks, rotations, height):
    tower = build(bricks, [(0, rotations[0], 0.2, 0.1), (1, rotations[1], 0.21, 0.1)])
    assert Tallest().value(tower) == pytest.approx([height])


@pytest.mark.parametrize(
    ("top", "reach"),
    [
        ((1, UPRIGHT, 0.05, -0.02), 0.11),  # x: 0.05 + 0.06, y: 0.02 + 0.025
        ((1, UPRIGHT, -0.05, 0.02), 0.11),  # the same on the other side
        ((1, UPRIGHT, 0.0, -0.05), 0.075),  # x: 0.06, y: 0.05 + 0.025
        ((1, ABOUT_Z, -0.01, 0.03), 0.09),  # turned, 0.05 x 0.12: x: 0.01 + 0.025, y: 0.03 + 0.06
        ((1, UPRIGHT, -0.01, 0.03), 0.07),  # not turned: x: 0.01 + 0.06, y: 0.03 + 0.025
        ((1, UPRIGHT, 0.0, 0.0), 0.06),
    ],
)
def test_overhang_reaches_to_the_furthest_side_of_the_top_block(build, bricks, top, reach):
    assert Overhang().value(build(bricks, [(0, UPRIGHT, 0, 0), top])) == pytest.approx([reach])


def test_overhang_counts_from_the_bottom_block_and_ignores_those_between(build, bricks):
    # c lies 0.02 from a's centre, with a side 0.04 from it; b between reaches further, and does not count
    tower = build(bricks, [(0, UPRIGHT, 1.0, 2.0), (1, UPRIGHT, 1.08, 2.0), (2, UPRIGHT, 1.02, 2.01)])
    assert Overhang().value(tower) == pytest.approx([0.04])


@pytest.mark.parametrize(
    ("top", "area"),
    [
        # a covers 6 x 8 cm around the origin; b, 12 x 5 cm, has an underside of 60 cm2
        ((1, UPRIGHT, 0.05, 0.0), 40e-4),  # b from -1 to 11 cm in x: 4 x 5 cm on a
        ((1, UPRIGHT, 0.0, 0.0), 30e-4),  # 6 x 5 cm on a
        ((1, UPRIGHT, 0.0, 0.04), 45e-4),  # b from 1.5 to 6.5 cm in y: 6 x 2.5 cm on a
        ((1, ABOUT_Z, 0.0, 0.0), 20e-4),  # 5 x 12 cm: 5 x 8 cm on a
        ((1, UPRIGHT, 0.2, 0.2), 60e-4),  # beside a in both axes: nothing on it
        ((1, UPRIGHT, 0.2, 0.0), 60e-4),  # beside it in x
        ((2, UPRIGHT, 0.0, 0.0), 0.0),  # c, 4 x 4 cm, lies on a with all of it
    ],
)
def test_unsupported_area_of_the_upper_block(build, bricks, top, area):
    assert Unsupported().value(build(bricks, [(0, UPRIGHT, 0, 0), top])) == pytest.approx([area], abs=1e-12)


def test_unsupported_areas_add_up_over_all_blocks(build, bricks):
    # b on a as above: 40 cm2; a third, c, with its centre on b's end at x = 11 cm: 2 x 4 of 4 x 4 cm hang over
    tower = build(bricks, [(0, UPRIGHT, 0, 0), (1, UPRIGHT, 0.05, 0), (2, UPRIGHT, 0.11, 0)])
    assert Unsupported().value(tower) == pytest.approx([48e-4])


@tasks
@given(seed=seeds, length=st.integers(2, 6), quarters=st.integers(0, 3))
def test_values_do_not_depend_on_place_or_side(task, blocks, seed, length, quarters):
    towers = random_towers(blocks, length, 10, np.random.default_rng(seed))
    moved = Towers(blocks, towers.block, towers.rotation, towers.xy + np.array([0.7, -0.4])).turned(quarters)
    values = task.value(towers)
    assert values.shape == (10,)
    assert (values >= -1e-15).all()
    np.testing.assert_allclose(task.value(moved), values, atol=1e-12)


@tasks
def test_each_tower_has_its_own_value(task, blocks):
    towers = random_towers(blocks, 4, 50, np.random.default_rng(0))
    one_by_one = [task.value(towers[n : n + 1])[0] for n in range(50)]
    np.testing.assert_array_equal(task.value(towers), one_by_one)


def test_units():
    assert (Tallest().unit, Overhang().unit, Unsupported().unit) == ("m", "m", "m²")
