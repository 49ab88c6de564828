import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from apf.domain import labels_from
from apf.towers import AnalyticWorld, NoisyWorld, Offset, Towers, random_towers

seeds = st.integers(0, 2**32 - 1)


def rng_of(seed):
    return np.random.default_rng(seed)


def test_labels_after_the_first_fall_are_unobserved():
    stood = np.array([[1, 1, 1, 1], [1, 1, 1, 0], [1, 1, 0, 0], [1, 0, 0, 0], [1, 0, 1, 1], [0, 0, 0, 0]], bool)
    labels = labels_from(stood)
    assert labels.dtype == np.int8
    assert labels.tolist() == [
        [1, 1, 1, 1],
        [1, 1, 1, 0],
        [1, 1, 0, -1],
        [1, 0, -1, -1],
        [1, 0, -1, -1],  # what stands again later was never tried
        [0, -1, -1, -1],
    ]


def test_analytic_labels_by_hand(build, cubes):
    # cubes of 0.125: half a side is 0.0625
    towers = build(
        cubes,
        [(0, 0, 0, 0), (1, 0, 0.05, 0), (2, 0, 0.06, 0), (3, 0, 0.05, 0)],  # above: 0.0533, 0.055, 0.05 < 0.0625
        [(0, 0, 0, 0), (1, 0, 0.05, 0), (2, 0, 0.1, 0), (3, 0, 0, 0)],  # upper two at 0.075: the third falls
        [(0, 0, 0, 0), (1, 0, 0.07, 0), (2, 0, 0, 0), (3, 0, 0, 0)],  # the second falls
        [(0, 0, 0, 0), (1, 0, 0, 0), (2, 0, 0, 0), (3, 0, 0, 0.07)],  # the fourth falls, in y
    )
    labels = AnalyticWorld().execute(towers, rng_of(0))
    assert labels.tolist() == [[1, 1, 1, 1], [1, 1, 0, -1], [1, 0, -1, -1], [1, 1, 1, 0]]


def test_the_analytic_world_draws_nothing(blocks):
    rng = rng_of(0)
    AnalyticWorld().execute(random_towers(blocks, 3, 5, rng_of(1)), rng)
    assert rng.bit_generator.state == rng_of(0).bit_generator.state


@given(seed=seeds, length=st.integers(1, 6))
def test_without_noise_the_noisy_world_is_the_analytic_one(blocks, seed, length):
    towers = random_towers(blocks, length, 30, rng_of(seed), Offset(sd=0.3))
    noisy = NoisyWorld(noise=0.0).execute(towers, rng_of(seed))
    np.testing.assert_array_equal(noisy, AnalyticWorld().execute(towers, rng_of(0)))


@given(seed=seeds, length=st.integers(1, 6))
def test_noisy_labels_end_at_the_first_fall(blocks, seed, length):
    towers = random_towers(blocks, length, 30, rng_of(seed), Offset(sd=0.3))
    labels = NoisyWorld(noise=0.01).execute(towers, rng_of(seed))
    assert labels.shape == (30, length)
    for row in labels.tolist():
        attempted = [label for label in row if label != -1]
        assert row == attempted + [-1] * (length - len(attempted))
        assert attempted[:-1] == [1] * (len(attempted) - 1)
        assert len(attempted) == length or attempted[-1] == 0


def test_a_seed_fixes_what_happens(blocks):
    towers = random_towers(blocks, 4, 300, rng_of(0), Offset(sd=0.25))
    world = NoisyWorld(noise=0.01)
    first, again, other = (world.execute(towers, rng_of(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


@pytest.mark.parametrize(
    ("x", "y", "stands"),
    [
        # noise of 3 mm on both blocks moves them apart by sd 3 sqrt(2); 3 mm from the edge is 0.7071 sd of that:
        # the normal distribution function there is 0.7602
        (0.0595, 0, 0.7602),
        (0, -0.0595, 0.7602),
        (-0.0595, 0.0595, 0.7602**2),  # the axes are independent
        (0.0655, 0, 1 - 0.7602),
        (0.0625, 0, 0.5),
    ],
)
def test_noise_is_normal_and_on_every_block(build, cubes, x, y, stands):
    tower = build(cubes, [(0, 0, 0, 0), (1, 0, x, y)])
    labels = NoisyWorld(noise=0.003).execute(tower[np.zeros(40_000, int)], rng_of(0))
    assert (labels[:, 1] == 1).mean() == pytest.approx(stands, abs=0.011)  # sd at most 0.0025


def test_labels_belong_to_the_towers_as_given(blocks):
    towers = random_towers(blocks, 3, 20, rng_of(0))
    xy = towers.xy.copy()
    NoisyWorld(noise=0.1).execute(towers, rng_of(0))
    np.testing.assert_array_equal(towers.xy, xy)


def test_worlds_take_a_single_tower(blocks):
    towers = random_towers(blocks, 3, 4, rng_of(0))
    one_by_one = [AnalyticWorld().execute(towers[n : n + 1], rng_of(0))[0].tolist() for n in range(4)]
    assert one_by_one == AnalyticWorld().execute(towers, rng_of(0)).tolist()


@pytest.mark.parametrize("wrong", [{"noise": -0.001}, {"noise": float("nan")}, {"sd": 0.003}, {}])
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ValidationError):
        NoisyWorld(**wrong)


def test_where_the_tower_stands_does_not_matter(blocks):
    towers = random_towers(blocks, 3, 200, rng_of(0), Offset(sd=0.25))
    moved = Towers(blocks, towers.block, towers.rotation, towers.xy + np.array([0.4, -0.3]))
    world = NoisyWorld(noise=0.01)
    np.testing.assert_array_equal(world.execute(moved, rng_of(1)), world.execute(towers, rng_of(1)))
