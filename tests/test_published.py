"""The candidates of the published code, which `sweeps/published.py` draws with its faults."""

import numpy as np
import pytest

from apf.acquisition import Bald, Random, Scorer
from apf.domain import Labelled
from apf.towers import BlockSet, TowerDomain, Towers
from apf.towers.rotations import ROTATIONS
from sweeps.published import SharedBlockExtensions, TurnedTowerExtensions, shared_block_extensions, turned_every_way

DOMAIN = TowerDomain()


def rng_of(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def a_tower(length: int = 2) -> Towers:
    return DOMAIN.random_plans(length, 1, rng_of(1))


def placements(towers: Towers) -> np.ndarray:
    """[N, 4] block, rotation and offset of the last placement."""
    return np.column_stack([towers.block[:, -1], towers.rotation[:, -1], towers.xy[:, -1]])


class Height:
    """A model that finds plans the more doubtful, the larger the number of their last block is."""

    def predict(self, plans: Towers) -> np.ndarray:
        doubt = 0.04 * plans.block[:, -1] + 0.05
        return np.stack([0.5 - doubt, 0.5 + doubt])[..., None]


def test_of_a_thousand_candidates_ten_are_distinct() -> None:
    extended = shared_block_extensions(a_tower(), 1000, DOMAIN, rng_of())
    assert len(extended) == 1000
    assert len(np.unique(placements(extended), axis=0)) == 10
    assert set(extended.block[:, -1].tolist()) == set(range(10))
    np.testing.assert_array_equal(extended.prefix(2).block, a_tower().block.repeat(1000, 0))
    np.testing.assert_array_equal(extended.prefix(2).xy, a_tower().xy.repeat(1000, 0))


def test_a_block_lies_where_it_was_drawn_last() -> None:
    """With one block, all candidates have the pose of the last draw: draws of the same stream, repeated by hand."""
    one = BlockSet(("a",), np.array([[0.06, 0.1, 0.14]]), np.zeros((1, 3)), np.array([0.5]))
    tower = Towers(one, np.zeros((1, 1), np.int16), np.zeros((1, 1), np.int8), np.zeros((1, 1, 2)))
    by_hand = rng_of()
    by_hand.integers(1, size=5)
    rotation = by_hand.integers(24, size=5)
    relative = by_hand.normal(0.0, 0.5, (5, 2)).clip(-0.95, 0.95)
    sides = np.abs(ROTATIONS[rotation[-1]] @ one.dims[0])[:2]
    extended = shared_block_extensions(tower, 5, DOMAIN, rng_of())
    np.testing.assert_allclose(extended.xy[:, 1], np.tile((one.dims[0, :2] + sides) / 2 * relative[-1], (5, 1)))


def test_a_fifth_of_the_towers_of_three_use_a_block_twice() -> None:
    extended = shared_block_extensions(a_tower(), 10_000, DOMAIN, rng_of())
    twice = [len(set(row)) < 3 for row in extended.block.tolist()]
    assert np.mean(twice) == pytest.approx(0.2, abs=0.02)


def test_the_new_block_keeps_its_sides_and_may_lie_beside_the_one_below() -> None:
    extended = shared_block_extensions(a_tower(), 1000, DOMAIN, rng_of())
    assert (extended.rotation[:, -1] == 0).all()
    np.testing.assert_array_equal(ROTATIONS[0], np.eye(3))
    np.testing.assert_array_equal(extended.dims[:, -1], DOMAIN.training_blocks.dims[extended.block[:, -1]])
    apart = [
        (np.abs(np.diff(t.xy[:, -2:], axis=1))[:, 0] > t.dims[:, -2:, :2].sum(1) / 2).any()
        for t in (shared_block_extensions(a_tower(), 100, DOMAIN, rng_of(seed)) for seed in range(50))
    ]
    assert 0 < sum(apart) < 50


def test_greedy_finds_copies_of_one_tower() -> None:
    """Each length begins with the best placements of all, and the best one was drawn about a hundred times."""
    source = SharedBlockExtensions(n=10_000, longest=5)
    found = source.best(10, Scorer(Bald(), Height(), rng_of()), DOMAIN, [], rng_of())
    assert [scored.plan.length for scored in found] == [5] * 10
    assert {scored.plan.block[0, -1] for scored in found} == {9}
    assert len({scored.plan.xy.tobytes() for scored in found}) == 1


def test_a_blind_choice_among_the_same_candidates() -> None:
    found = SharedBlockExtensions(n=1000, longest=5).best(
        10, Scorer(Random(), Height(), rng_of()), DOMAIN, [], rng_of()
    )
    assert len({scored.plan.xy.tobytes() for scored in found}) > 5


def test_a_tower_that_stood_is_a_base_in_each_of_its_four_turns() -> None:
    """240 bases of one block, and four of one tower: it is the base of 4 / 244 of the candidates."""
    plans = DOMAIN.random_plans(3, 2, rng_of(3))
    data = [Labelled(plans, np.array([[1, 1, 1], [1, 1, 0]], np.int8))]
    drawn: list[Towers] = []

    def score(towers: Towers) -> np.ndarray:
        drawn.append(towers)
        return np.zeros(len(towers))

    found = TurnedTowerExtensions(n=24_400, longest=5).best(10, score, DOMAIN, data, rng_of())  # type: ignore[arg-type]
    assert len(found) == 10
    pairs, fours = drawn
    assert (pairs.length, fours.length) == (2, 4)
    assert len(pairs) + len(fours) == 24_400
    assert len(fours) == pytest.approx(400, abs=60)
    turns = {turned_every_way(plans[:1]).xy[quarters].tobytes() for quarters in range(4)}
    assert {xy.tobytes() for xy in fours.prefix(3).xy} == turns


def test_what_has_the_longest_length_is_no_base() -> None:
    plans = DOMAIN.random_plans(5, 3, rng_of())
    data = [Labelled(plans, np.ones((3, 5), np.int8))]
    found = TurnedTowerExtensions(n=500, longest=5).best(
        500, Scorer(Random(), Height(), rng_of()), DOMAIN, data, rng_of()
    )
    assert {scored.plan.length for scored in found} == {2}
