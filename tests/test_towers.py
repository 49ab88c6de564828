import itertools
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from apf.errors import InputError
from apf.towers import (
    BlockSet,
    BlockSource,
    Offset,
    TowerDomain,
    Towers,
    features,
    random_extensions,
    random_towers,
    rotation_index,
)

HALF = np.sqrt(0.5)
seeds = st.integers(0, 2**32 - 1)
lengths = st.integers(1, 7)


def rng_of(seed):
    return np.random.default_rng(seed)


def relative_offsets(towers):
    """[N, K - 1, 2] offsets from the block below, in units of half the summed sides."""
    sides = towers.dims[..., :2]
    return np.diff(towers.xy, axis=1) / ((sides[:, 1:] + sides[:, :-1]) / 2)


def assert_identical(one, other):
    for field in ("block", "rotation", "xy"):
        assert getattr(one, field).tobytes() == getattr(other, field).tobytes()


class TestTowers:
    def test_heights_follow_from_the_blocks(self, build):
        # heights 0.10, then 0.12 (its x up after a quarter turn about y), then 0.10 again
        blocks = BlockSet(
            ("p", "q", "r"), np.array([[0.06, 0.08, 0.10], [0.12, 0.05, 0.07], [0.1] * 3]), np.zeros((3, 3)), np.ones(3)
        )
        about_y = int(rotation_index(np.array([0, HALF, 0, HALF])))
        tower = build(blocks, [(0, 0, 0, 0), (1, about_y, 0, 0), (2, 0, 0, 0)])
        np.testing.assert_allclose(tower.dims[0, 1], [0.07, 0.05, 0.12])
        np.testing.assert_allclose(tower.z, [[0.05, 0.10 + 0.06, 0.10 + 0.12 + 0.05]])

    def test_parameters_are_those_of_each_block(self, blocks):
        towers = random_towers(blocks, 4, 30, rng_of(0))
        for n, k in itertools.product(range(30), range(4)):
            b, r = towers.block[n, k], towers.rotation[n, k]
            assert towers.mass[n, k] == blocks.mass[b]
            np.testing.assert_array_equal(towers.dims[n, k], blocks.rotated_dims[b, r])
            np.testing.assert_array_equal(towers.com[n, k], blocks.rotated_com[b, r])

    def test_rows_and_prefixes(self, blocks):
        towers = random_towers(blocks, 4, 10, rng_of(0))
        assert len(towers) == 10
        assert towers.length == 4
        mask = np.arange(10) % 3 == 0
        assert_identical(towers[mask], towers[np.array([0, 3, 6, 9])])
        assert_identical(Towers.concatenate([towers[:4], towers[4:]]), towers)
        prefix = towers[2:5].prefix(3)
        assert (len(prefix), prefix.length) == (3, 3)
        np.testing.assert_array_equal(prefix.xy, towers.xy[2:5, :3])
        np.testing.assert_array_equal(prefix.z, towers.z[2:5, :3])

    def test_a_quarter_turn_by_hand(self, build, blocks):
        # counter-clockwise: (x, y) to (-y, x); sides swap, and so does the centre of mass
        tower = build(blocks, [(0, 0, 0.1, 0.2), (1, 0, 0.3, -0.4)])
        turned = tower.turned(1)
        np.testing.assert_array_equal(turned.xy, [[[-0.2, 0.1], [0.4, 0.3]]])
        np.testing.assert_array_equal(turned.dims, tower.dims[..., [1, 0, 2]])
        np.testing.assert_array_equal(turned.com, tower.com[..., [1, 0, 2]] * [-1, 1, 1])

    @given(seed=seeds, quarters=st.integers(-4, 8))
    def test_four_quarter_turns_are_none(self, blocks, seed, quarters):
        towers = random_towers(blocks, 3, 5, rng_of(seed))
        there_and_back = towers.turned(quarters).turned(-quarters)
        np.testing.assert_array_equal(there_and_back.rotation, towers.rotation)
        np.testing.assert_array_equal(there_and_back.xy, towers.xy)
        step_by_step = towers
        for _ in range(quarters % 4):
            step_by_step = step_by_step.turned(1)
        np.testing.assert_array_equal(step_by_step.rotation, towers.turned(quarters).rotation)
        np.testing.assert_array_equal(step_by_step.xy, towers.turned(quarters).xy)


class TestRandomTowers:
    @given(seed=seeds, length=lengths)
    def test_no_block_twice_bottom_at_origin_neighbours_touch(self, blocks, seed, length):
        towers = random_towers(blocks, length, 20, rng_of(seed))
        assert towers.block.shape == towers.rotation.shape == (20, length)
        assert towers.xy.shape == (20, length, 2)
        assert all(len(set(row)) == length for row in towers.block.tolist())
        assert np.isin(towers.block, range(7)).all()
        assert np.isin(towers.rotation, range(24)).all()
        assert (towers.xy[:, 0] == 0).all()
        assert np.abs(relative_offsets(towers)).max(initial=0) <= 0.95 + 1e-12

    @given(seed=seeds, length=lengths)
    def test_a_seed_gives_the_same_towers(self, blocks, seed, length):
        first, again = (random_towers(blocks, length, 5, rng_of(seed)) for _ in range(2))
        assert_identical(first, again)

    def test_other_seeds_give_other_towers(self, blocks):
        first, other = (random_towers(blocks, 3, 5, rng_of(seed)) for seed in (0, 1))
        assert not np.array_equal(first.xy, other.xy)

    def test_orders_of_blocks_are_uniform(self, blocks):
        five = blocks.subset(np.arange(5))
        towers = random_towers(five, 3, 24_000, rng_of(0))
        orders, counts = np.unique(towers.block, axis=0, return_counts=True)
        # 5 * 4 * 3 = 60 orders, 400 towers each; sd sqrt(400 * 59 / 60) = 19.8
        assert len(orders) == 60
        assert np.abs(counts - 400).max() < 5 * 19.8

    def test_rotations_are_uniform_at_every_position(self, blocks):
        towers = random_towers(blocks, 3, 24_000, rng_of(1))
        for position in range(3):
            counts = np.bincount(towers.rotation[:, position], minlength=24)
            # 1000 each; sd sqrt(1000 * 23 / 24) = 31
            assert np.abs(counts - 1000).max() < 5 * 31

    def test_offsets_are_clipped_normal(self, blocks):
        relative = relative_offsets(random_towers(blocks, 2, 40_000, rng_of(2)))[:, 0]
        # sd 0.5: 68.27 % within one sd; beyond the limit of 1.9 sd 5.74 %, and those lie on it
        assert (np.abs(relative) < 0.5).mean(0) == pytest.approx([0.6827] * 2, abs=0.012)
        assert (np.abs(relative) > 0.95 - 1e-9).mean(0) == pytest.approx([0.0574] * 2, abs=0.006)
        assert relative.mean(0) == pytest.approx([0, 0], abs=0.013)
        assert abs(np.corrcoef(relative, rowvar=False)[0, 1]) < 0.025

    def test_offset_settings_are_used(self, blocks):
        towers = random_towers(blocks, 4, 2000, rng_of(3), Offset(sd=10.0, limit=0.25))
        relative = np.abs(relative_offsets(towers))
        assert relative.max() == pytest.approx(0.25)
        assert np.median(relative) == pytest.approx(0.25)

    @pytest.mark.parametrize("wrong", [{"sd": 0.0}, {"limit": 1.0}, {"limit": 0.0}, {"sd": float("inf")}])
    def test_offset_that_lets_neighbours_miss_is_refused(self, wrong):
        with pytest.raises(ValidationError):
            Offset(**wrong)

    def test_more_blocks_than_there_are_is_refused(self, blocks):
        with pytest.raises(ValueError, match=r"8 blocks.*the set has 7"):
            random_towers(blocks, 8, 1, rng_of(0))

    def test_large_block_sets(self):
        many = BlockSource(blocks=300).load()
        towers = random_towers(many, 3, 3000, rng_of(0))
        assert towers.block.min() >= 0
        assert towers.block.max() > 280


class TestRandomExtensions:
    @given(seed=seeds, length=st.integers(1, 6))
    def test_prefix_is_kept_and_the_new_block_is_new(self, blocks, seed, length):
        towers = random_towers(blocks, length, 20, rng_of(seed))
        extended = random_extensions(towers, rng_of(seed + 1))
        assert extended.length == length + 1
        for field in ("block", "rotation", "xy"):
            np.testing.assert_array_equal(getattr(extended.prefix(length), field), getattr(towers, field))
        assert all(len(set(row)) == length + 1 for row in extended.block.tolist())
        assert np.abs(relative_offsets(extended)).max() <= 0.95 + 1e-12

    @given(seed=seeds)
    def test_a_seed_gives_the_same_extensions(self, blocks, seed):
        towers = random_towers(blocks, 3, 5, rng_of(0))
        assert_identical(*(random_extensions(towers, rng_of(seed)) for _ in range(2)))

    def test_new_block_rotation_and_offset_are_drawn_as_for_random_towers(self, blocks, build):
        base = build(blocks, [(2, 5, 0.3, 0.1), (5, 11, 0.31, 0.11)])
        extended = random_extensions(base[np.zeros(24_000, int)], rng_of(0))
        blocks_used, counts = np.unique(extended.block[:, 2], return_counts=True)
        assert blocks_used.tolist() == [0, 1, 3, 4, 6]
        assert np.abs(counts - 4800).max() < 5 * 62  # sd sqrt(24,000 * 0.2 * 0.8) = 62
        assert np.abs(np.bincount(extended.rotation[:, 2], minlength=24) - 1000).max() < 5 * 31
        relative = relative_offsets(extended)[:, 1]
        assert (np.abs(relative) < 0.5).mean(0) == pytest.approx([0.6827] * 2, abs=0.015)
        assert (np.abs(relative) > 0.95 - 1e-9).mean(0) == pytest.approx([0.0574] * 2, abs=0.008)

    def test_offset_settings_are_used(self, blocks):
        towers = random_towers(blocks, 1, 2000, rng_of(3))
        extended = random_extensions(towers, rng_of(4), Offset(sd=10.0, limit=0.25))
        assert np.abs(relative_offsets(extended)).max() == pytest.approx(0.25)

    def test_towers_that_hold_every_block_are_refused(self, blocks):
        with pytest.raises(ValueError, match="no block is left"):
            random_extensions(random_towers(blocks, 7, 1, rng_of(0)), rng_of(0))

    def test_large_block_sets(self):
        many = BlockSource(blocks=300).load()
        extended = random_extensions(random_towers(many, 1, 3000, rng_of(0)), rng_of(1))
        assert extended.block.min() >= 0
        assert extended.block[:, 1].max() > 280
        assert (extended.block[:, 0] != extended.block[:, 1]).all()


class TestFeatures:
    def test_each_is_one_quantity_shifted_and_scaled_to_about_unit_range(self, blocks):
        towers = random_towers(blocks, 4, 500, rng_of(0))
        position = np.concatenate([towers.xy, towers.z[..., None]], axis=-1)
        position = position - position[:, :1]
        quantities = np.concatenate([towers.mass[..., None], towers.com, towers.dims, position], axis=-1)
        x = features(towers)
        assert (x.shape, x.dtype) == ((500, 4, 10), np.float32)
        for feature, quantity in zip(x.reshape(-1, 10).T, quantities.reshape(-1, 10).T, strict=True):
            scale, shift = np.polyfit(quantity, feature, 1)
            assert scale > 0
            np.testing.assert_allclose(feature, scale * quantity + shift, atol=1e-5)
            assert 0.1 < feature.std() < 10

    @given(seed=seeds, shift=st.tuples(st.floats(-2, 2), st.floats(-2, 2)))
    def test_where_the_tower_stands_does_not_matter(self, blocks, seed, shift):
        towers = random_towers(blocks, 4, 5, rng_of(seed))
        moved = Towers(blocks, towers.block, towers.rotation, towers.xy + shift)
        np.testing.assert_allclose(features(moved), features(towers), atol=1e-5)

    def test_a_prefix_has_the_first_rows_of_its_tower(self, blocks):
        towers = random_towers(blocks, 5, 20, rng_of(0))
        np.testing.assert_array_equal(features(towers.prefix(3)), features(towers)[:, :3])


class TestTowerDomain:
    def test_plans_use_the_training_blocks(self, domain):
        plans = domain.random_plans(3, 4, rng_of(0))
        assert plans.blocks is domain.training_blocks
        assert domain.extend(plans, rng_of(0)).length == 4
        assert not np.array_equal(domain.training_blocks.dims, domain.evaluation_blocks.dims)

    def test_a_problem_uses_its_blocks_and_no_others(self, domain):
        problem = domain.problem(4, 200, rng_of(0))
        assert (len(problem), problem.length, len(problem.blocks)) == (200, 4, 4)
        assert set(problem.blocks.name) < set(domain.evaluation_blocks.name)
        assert all(len(set(row)) == 4 for row in problem.block.tolist())
        rows = [domain.evaluation_blocks.name.index(name) for name in problem.blocks.name]
        np.testing.assert_array_equal(problem.blocks.dims, domain.evaluation_blocks.dims[rows])

    def test_views_are_the_four_sides_each_followed_by_its_mirror_image(self):
        domain = TowerDomain(mass_scales=0, stretch=False)
        plans = domain.random_plans(3, 4, rng_of(0))
        views = list(domain.views(plans))
        assert len(views) == 8
        np.testing.assert_array_equal(views[0], domain.features(plans))
        for axes in (slice(1, 3), slice(4, 6), slice(7, 9)):  # centres of mass, sides, positions
            x, y = np.moveaxis(views[0][..., axes], -1, 0)
            flip = 1 if axes.start == 4 else -1  # sides have no sign
            sides = [(x, y), (flip * y, x), (flip * x, flip * y), (y, flip * x)]
            for number, (vx, vy) in enumerate(sides):
                np.testing.assert_allclose(views[2 * number][..., axes], np.stack([vx, vy], -1), atol=1e-6)
                np.testing.assert_allclose(views[2 * number + 1][..., axes], np.stack([flip * vx, vy], -1), atol=1e-6)
        for view in views:
            np.testing.assert_array_equal(view[..., [0, 3, 6, 9]], views[0][..., [0, 3, 6, 9]])

    def test_without_mirror_there_are_four(self):
        domain = TowerDomain(mirror=False, mass_scales=0)
        views = list(domain.views(domain.random_plans(2, 3, rng_of(0))))
        assert len(views) == 4

    @given(seed=seeds, length=st.integers(1, 5))
    def test_masses_are_scaled_alike_from_the_lightest_to_the_heaviest_of_the_set(self, domain, seed, length):
        plans = domain.random_plans(length, 3, rng_of(seed))
        lightest, heaviest = domain.training_blocks.mass.min(), domain.training_blocks.mass.max()
        plain, scaled = (list(TowerDomain(mirror=False, mass_scales=n, stretch=False).views(plans)) for n in (0, 3))
        assert len(scaled) == 3 * len(plain)
        masses = np.array([view[..., 0] / 2 + 0.55 for view in scaled[:3]])
        np.testing.assert_allclose(masses[0].min(1), lightest, rtol=1e-5)
        np.testing.assert_allclose(masses[2].max(1), heaviest, rtol=1e-5)
        np.testing.assert_allclose(masses[1] ** 2, masses[0] * masses[2], rtol=1e-4)
        np.testing.assert_allclose(masses[0] / masses[0][:, :1], plans.mass / plans.mass[:, :1], rtol=1e-4)
        for number, view in enumerate(scaled):
            np.testing.assert_array_equal(view[..., 1:], plain[number // 3][..., 1:])

    @given(seed=seeds, length=st.integers(1, 6))
    def test_decode_gives_back_what_encode_was_given(self, domain, seed, length):
        plans = domain.random_plans(length, 3, rng_of(seed))
        encoded = domain.encode(plans)
        assert_identical(domain.decode(json.loads(json.dumps(encoded))), plans)

    def test_too_long_plans_are_refused_by_key(self, domain):
        domain.check_length(6, "sampler")
        with pytest.raises(InputError, match=r"^sampler: .*7 blocks.*domain\.training has 6"):
            domain.check_length(7, "sampler")
        with pytest.raises(InputError, match=r"^evaluation\.length: .*domain\.evaluation has 6"):
            domain.check_length(7, "evaluation.length", evaluation=True)
