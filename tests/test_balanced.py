import numpy as np
import pytest

from apf.towers import Offset, balanced_towers, random_towers, stands
from apf.towers.balanced import random_fallen, random_standing

PUBLISHED = Offset()


def rng_of(seed):
    return np.random.default_rng(seed)


def rejected(blocks, length, wanted, rng, offset=PUBLISHED, n=100_000):
    """Random towers of which only those that stand (or do not) are kept: slow, and surely right."""
    towers = random_towers(blocks, length, n, rng, offset)
    return towers[stands(towers) == wanted]


def traits(towers):
    """[N, ...] a few numbers that tell how a tower is made."""
    sides = towers.dims[..., :2]
    reach = np.abs(np.diff(towers.xy, axis=1)) / ((sides[:, 1:] + sides[:, :-1]) / 2)
    return np.hstack([towers.mass, towers.dims[..., 2], towers.dims[:, 0, :2], reach.reshape(len(towers), -1)])


@pytest.mark.parametrize("length", range(2, 7))
def test_half_stand_and_none_repeats_a_block(blocks, length):
    towers, labels = balanced_towers(blocks, length, 60, rng_of(length))
    assert towers.block.shape == (60, length)
    assert labels.dtype == bool
    assert labels.sum() == 30
    np.testing.assert_array_equal(labels, stands(towers))
    assert all(len(set(row)) == length for row in towers.block.tolist())


def test_no_tower_comes_twice(blocks):
    towers, _ = balanced_towers(blocks, 4, 200, rng_of(0))
    assert len({xy.tobytes() for xy in towers.xy}) == 200


def test_standing_towers_share_no_prefix(blocks):
    towers = random_standing(blocks, 5, 200, rng_of(0), PUBLISHED)
    assert len({xy.tobytes() for xy in towers.prefix(2).xy}) == 200


def test_a_seed_gives_the_same_set(blocks):
    (first, _), (again, _), (other, _) = (balanced_towers(blocks, 3, 20, rng_of(seed)) for seed in (1, 1, 2))
    assert first.block.tobytes() == again.block.tobytes()
    assert first.rotation.tobytes() == again.rotation.tobytes()
    assert first.xy.tobytes() == again.xy.tobytes()
    assert not np.array_equal(first.xy, other.xy)


@pytest.mark.parametrize("length", [2, 3])
def test_grown_towers_are_distributed_as_random_ones_that_stand(blocks, length):
    grown = random_standing(blocks, length, 6000, rng_of(0), PUBLISHED)
    kept = rejected(blocks, length, True, rng_of(1))
    assert len(kept) > 4000
    one, other = traits(grown), traits(kept)
    error = np.sqrt(one.var(0) / len(one) + other.var(0) / len(other))
    assert (np.abs(one.mean(0) - other.mean(0)) < 4.5 * error).all()
    for position in range(length):
        share, expected = (np.bincount(t.block[:, position], minlength=7) / len(t) for t in (grown, kept))
        error = np.sqrt(expected * (1 - expected) * (1 / len(grown) + 1 / len(kept)))
        assert (np.abs(share - expected) < 4.5 * error).all()


def test_the_distribution_check_would_see_a_bias(blocks):
    biased = random_standing(blocks, 3, 6000, rng_of(0), Offset(sd=0.4))
    kept = rejected(blocks, 3, True, rng_of(1))
    one, other = traits(biased), traits(kept)
    error = np.sqrt(one.var(0) / len(one) + other.var(0) / len(other))
    assert (np.abs(one.mean(0) - other.mean(0)) > 4.5 * error).any()


def test_fallen_towers_are_distributed_as_random_ones_that_do_not_stand(blocks):
    drawn = random_fallen(blocks, 2, 6000, rng_of(0), PUBLISHED)
    kept = rejected(blocks, 2, False, rng_of(1))
    one, other = traits(drawn), traits(kept)
    error = np.sqrt(one.var(0) / len(one) + other.var(0) / len(other))
    assert (np.abs(one.mean(0) - other.mean(0)) < 4.5 * error).all()


def test_offset_settings_are_used(blocks):
    towers, _ = balanced_towers(blocks, 2, 100, rng_of(0), Offset(sd=5.0, limit=0.5))
    sides = towers.dims[..., :2]
    relative = np.abs(np.diff(towers.xy, axis=1)) / ((sides[:, 1:] + sides[:, :-1]) / 2)
    assert relative.max() == pytest.approx(0.5)


@pytest.mark.parametrize("n", [1, 7])
def test_an_odd_number_is_refused(blocks, n):
    with pytest.raises(ValueError, match=f"even number of towers, not {n}"):
        balanced_towers(blocks, 2, n, rng_of(0))


def test_an_empty_set_is_empty(blocks):
    towers, labels = balanced_towers(blocks, 3, 0, rng_of(0))
    assert len(towers) == len(labels) == 0


def test_domain_draws_from_the_evaluation_blocks(domain):
    towers, labels = domain.balanced(3, 10, rng_of(0))
    assert towers.blocks is domain.evaluation_blocks
    assert labels.sum() == 5
