import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from apf.towers import QUATERNIONS, BlockSet, Offset, Towers, random_towers, stability, standing_prefixes, stands

seeds = st.integers(0, 2**32 - 1)
lengths = st.integers(2, 6)


def labels(towers, xy=None):
    return standing_prefixes(towers, xy).tolist()


def cubes_of(masses):
    """Cubes of 0.1 m with the given masses [kg] and the centre of mass in the middle."""
    n = len(masses)
    return BlockSet(tuple("abcdefgh"[:n]), np.full((n, 3), 0.1), np.zeros((n, 3)), np.array(masses, float))


# --- an implementation of its own: one tower, objects, loops -------------------------------------------------------


@dataclass
class Brick:
    x: float
    y: float
    width: float
    depth: float
    mass: float
    com_x: float
    com_y: float


def turned(q, v):
    """v turned by the unit quaternion q = (x, y, z, w): v + 2 u x (u x v + w v)."""

    def cross(a, b):
        return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])

    u, w = q[:3], q[3]
    inner = tuple(c + w * e for c, e in zip(cross(u, v), v, strict=True))
    return tuple(e + 2 * c for e, c in zip(v, cross(u, inner), strict=True))


def bricks_of(towers, n, xy):
    bricks = []
    for k in range(towers.length):
        block = int(towers.block[n, k])
        q = tuple(float(c) for c in QUATERNIONS[towers.rotation[n, k]])
        width, depth, _ = (abs(side) for side in turned(q, tuple(towers.blocks.dims[block])))
        com_x, com_y, _ = turned(q, tuple(towers.blocks.com[block]))
        x, y = (float(c) for c in xy[n, k])
        bricks.append(Brick(x, y, width, depth, float(towers.blocks.mass[block]), x + com_x, y + com_y))
    return bricks


def slow_margin(bricks):
    """How far inside its contact patch [m] the worst joint centre of mass of this one tower lies; < 0: outside."""
    worst = math.inf
    for i in range(len(bricks) - 1):
        lower, upper = bricks[i], bricks[i + 1]
        above = bricks[i + 1 :]
        mass = sum(b.mass for b in above)
        x = sum(b.mass * b.com_x for b in above) / mass
        y = sum(b.mass * b.com_y for b in above) / mass
        worst = min(
            worst,
            x - max(lower.x - lower.width / 2, upper.x - upper.width / 2),
            min(lower.x + lower.width / 2, upper.x + upper.width / 2) - x,
            y - max(lower.y - lower.depth / 2, upper.y - upper.depth / 2),
            min(lower.y + lower.depth / 2, upper.y + upper.depth / 2) - y,
        )
    return worst


def slow_labels(towers, xy=None):
    """[N][K] labels, and how close the closest of all decisions was [m]."""
    xy = towers.xy if xy is None else xy
    table, closest = [], math.inf
    for n in range(len(towers)):
        bricks = bricks_of(towers, n, xy)
        row = []
        for k in range(1, len(bricks) + 1):
            margin = slow_margin(bricks[:k])
            closest = min(closest, abs(margin))
            row.append(margin > 0 and all(row))
        table.append(row)
    return table, closest


# --- by hand -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("x", "y"), [(1, 0), (-1, 0), (0, 1), (0, -1)])
@pytest.mark.parametrize(("distance", "stood"), [(0.0624, True), (0.0626, False)])
def test_two_cubes_stand_while_the_upper_centre_is_over_the_lower_cube(build, cubes, x, y, distance, stood):
    # half a side is 0.0625 m
    tower = build(cubes, [(0, 0, 0, 0), (1, 0, x * distance, y * distance)])
    assert labels(tower) == [[True, stood]]


@pytest.mark.parametrize(("x", "y"), [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_balance_on_the_edge_is_not_standing(build, cubes, x, y):
    # 0.0625 m is half a side, exactly, also in binary
    tower = build(cubes, [(0, 0, 0, 0), (1, 0, x * 0.0625, y * 0.0625)])
    assert labels(tower) == [[True, False]]


@pytest.mark.parametrize(
    ("x", "stood"),
    [
        (0.009, True),  # centre of mass at 0.049, inside 0.05
        (0.011, False),  # at 0.051
        (-0.089, True),  # at -0.049, although most of the block hangs over
        (-0.091, False),
    ],
)
def test_the_centre_of_mass_counts_not_the_centre_of_geometry(line, x, stood):
    blocks = BlockSet(("a", "b"), np.full((2, 3), 0.1), np.array([[0, 0, 0], [0.04, 0, 0]]), np.ones(2))
    assert labels(line(blocks, [0, x])) == [[True, stood]]


def test_a_rotation_moves_the_centre_of_mass(build):
    blocks = BlockSet(("a", "b"), np.full((2, 3), 0.1), np.array([[0, 0, 0], [0.04, 0, 0]]), np.ones(2))
    half_turn = int(np.flatnonzero((QUATERNIONS == [0, 0, 1, 0]).all(1))[0])
    assert labels(build(blocks, [(0, 0, 0, 0), (1, 0, 0.02, 0)])) == [[True, False]]  # at 0.02 + 0.04
    assert labels(build(blocks, [(0, 0, 0, 0), (1, half_turn, 0.02, 0)])) == [[True, True]]  # at 0.02 - 0.04


def test_mass_and_centre_of_the_bottom_block_do_not_matter(line):
    dims = np.full((2, 3), 0.1)
    plain = BlockSet(("a", "b"), dims, np.zeros((2, 3)), np.ones(2))
    odd = BlockSet(("a", "b"), dims, np.array([[-0.045, 0.045, 0.04], [0, 0, 0]]), np.array([0.1, 1.0]))
    for x in (0.049, 0.051):
        assert labels(line(plain, [0, x])) == labels(line(odd, [0, x]))


def test_the_third_block_topples_the_joint_below(line):
    # each rests safely on the next (0.04 < 0.05), but the joint centre of the upper two is at (0.04 + 0.08) / 2 = 0.06
    tower = line(cubes_of([1, 1, 1]), [0, 0.04, 0.08])
    assert labels(tower) == [[True, True, False]]


@pytest.mark.parametrize(
    ("mass", "stood"),
    [
        (0.5, True),  # joint centre of the upper two: (0.04 + 0.5 * 0.06) / 1.5 = 0.0467 < 0.05
        (3.0, False),  # (0.04 + 3 * 0.06) / 4 = 0.055 > 0.05
    ],
)
def test_masses_weigh_the_joint_centre(line, mass, stood):
    assert labels(line(cubes_of([1, 1, mass]), [0, 0.04, 0.06])) == [[True, True, stood]]


def test_a_counterweight_comes_too_late_for_a_prefix_that_fell(line):
    # the second falls: 0.06 > 0.05; had all three been put at once, they would balance: (0.06 + 0.02) / 2 = 0.04
    tower = line(cubes_of([1, 1, 1]), [0, 0.06, 0.02])
    assert slow_margin(bricks_of(tower, 0, tower.xy)) == pytest.approx(0.01)
    assert labels(tower) == [[True, False, False]]


def test_a_prefix_of_three_that_fell_is_not_saved_by_the_fourth(line):
    # three: (0.04 + 0.08) / 2 = 0.06 falls. A fourth of 2 kg at 0.035 would have balanced all of them:
    # on the bottom (0.04 + 0.08 + 2 * 0.035) / 4 = 0.0475, on the second (0.08 + 0.07) / 3 = 0.05 in 0.03..0.09
    tower = line(cubes_of([1, 1, 1, 2]), [0, 0.04, 0.08, 0.035])
    assert slow_margin(bricks_of(tower, 0, tower.xy)) > 0.002
    assert labels(tower) == [[True, True, False, False]]


def test_a_counterweight_in_time_lets_the_tower_reach_further(line):
    # 3 kg at 0 hold the second (at 0.04) down, so a fourth at 0.045 stands:
    # on the bottom (0.04 + 0.045) / 5 = 0.017, on the second 0.045 / 4 = 0.011, on the third 0.045 < 0.05
    assert labels(line(cubes_of([1, 1, 3, 1]), [0, 0.04, 0, 0.045])) == [[True, True, True, True]]
    # without it the fourth would hang too far out: 0.045 + 0.04 on the second, both on the bottom at 0.0625 > 0.05
    assert labels(line(cubes_of([1, 1, 1]), [0, 0.04, 0.085])) == [[True, True, False]]


def test_each_axis_is_judged(build, cubes):
    # inside in x, outside in y, at the upper joint only
    tower = build(cubes, [(0, 0, 0, 0), (1, 0, 0.05, 0), (2, 0, 0.05, 0.07)])
    assert labels(tower) == [[True, True, False]]


def test_a_single_block_stands(blocks):
    towers = random_towers(blocks, 1, 5, np.random.default_rng(0))
    assert stands(towers).tolist() == [True] * 5


def test_stands_is_the_last_prefix(blocks):
    towers = random_towers(blocks, 3, 500, np.random.default_rng(0))
    assert stands(towers).tolist() == [row[-1] for row in labels(towers)]
    assert 0 < stands(towers).sum() < 500


def test_no_towers_no_labels(blocks):
    assert standing_prefixes(random_towers(blocks, 3, 0, np.random.default_rng(0))).shape == (0, 3)


def test_many_towers_are_judged_as_few_are(blocks, monkeypatch):
    rng = np.random.default_rng(0)
    towers = random_towers(blocks, 4, 50, rng, Offset(sd=0.25))
    noisy = towers.xy + rng.normal(0, 0.02, (3, 50, 4, 2))
    at_once = standing_prefixes(towers), standing_prefixes(towers, noisy)
    assert at_once[0].any(0).all()
    monkeypatch.setattr(stability, "CHUNK", 7)
    for whole, parts in zip(at_once, (standing_prefixes(towers), standing_prefixes(towers, noisy)), strict=True):
        np.testing.assert_array_equal(parts, whole)


# --- properties ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("length", range(2, 7))
def test_agrees_with_the_slow_implementation(blocks, length):
    rng = np.random.default_rng(length)
    towers = Towers.concatenate(
        [
            random_towers(blocks, length, 150, rng),
            random_towers(blocks, length, 150, rng, Offset(sd=0.2)),  # of which more stand
        ]
    )
    expected, closest = slow_labels(towers)
    assert closest > 1e-12
    assert labels(towers) == expected
    assert 3 <= sum(row[-1] for row in expected) <= 297


@given(seed=seeds, length=lengths)
def test_agrees_with_the_slow_implementation_on_any_tower(blocks, seed, length):
    towers = random_towers(blocks, length, 5, np.random.default_rng(seed), Offset(sd=0.3))
    expected, closest = slow_labels(towers)
    assert labels(towers) == expected or closest < 1e-12


@given(seed=seeds, length=lengths)
def test_turning_a_tower_changes_nothing(blocks, seed, length):
    towers = random_towers(blocks, length, 50, np.random.default_rng(seed), Offset(sd=0.25))
    for quarters in (1, 2, 3):
        assert labels(towers.turned(quarters)) == labels(towers)


@given(seed=seeds, length=lengths, shift=st.tuples(st.floats(-3, 3), st.floats(-3, 3)))
def test_moving_a_tower_changes_nothing(blocks, seed, length, shift):
    towers = random_towers(blocks, length, 10, np.random.default_rng(seed), Offset(sd=0.25))
    moved = Towers(blocks, towers.block, towers.rotation, towers.xy + shift)
    assert labels(moved) == labels(towers) or slow_labels(towers)[1] < 1e-12


@given(seed=seeds, length=lengths)
def test_what_fell_stays_fallen(blocks, seed, length):
    towers = random_towers(blocks, length, 50, np.random.default_rng(seed))
    stood = standing_prefixes(towers).astype(int)
    assert (stood[:, 0] == 1).all()
    assert (np.diff(stood, axis=1) <= 0).all()


@given(seed=seeds, length=lengths)
def test_labels_of_a_prefix_do_not_depend_on_what_follows(blocks, seed, length):
    towers = random_towers(blocks, length, 30, np.random.default_rng(seed), Offset(sd=0.25))
    for k in range(1, length):
        np.testing.assert_array_equal(standing_prefixes(towers.prefix(k)), standing_prefixes(towers)[:, :k])


@given(seed=seeds, length=lengths)
def test_positions_may_be_given_with_leading_axes(blocks, seed, length):
    rng = np.random.default_rng(seed)
    towers = random_towers(blocks, length, 6, rng, Offset(sd=0.25))
    xy = towers.xy + rng.normal(0, 0.02, (4, 3, 6, length, 2))
    stood = standing_prefixes(towers, xy)
    assert stood.shape == (4, 3, 6, length)
    for a in range(4):
        for b in range(3):
            np.testing.assert_array_equal(stood[a, b], standing_prefixes(towers, xy[a, b]))


def test_given_positions_are_judged_instead_of_the_towers_own(blocks):
    rng = np.random.default_rng(0)
    towers = random_towers(blocks, 3, 100, rng, Offset(sd=0.25))
    noisy = towers.xy + rng.normal(0, 0.02, (3, 100, 3, 2))
    expected = [slow_labels(towers, xy)[0] for xy in noisy]
    assert standing_prefixes(towers, noisy).tolist() == expected
    assert expected[0] != labels(towers)
