"""Variations of plans: each is a plan of the same objects, and changes what it says that it changes."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from apf.domain.variation import another, exchanged, step_sizes, swapped
from apf.packing import BoxSource, PackingDomain, Packings
from apf.packing import variations as of_packings
from apf.towers import BlockSource, TowerDomain, Towers
from apf.towers import variations as of_towers
from apf.towers.variations import relative_offsets

seeds = st.integers(0, 10**6)
lengths = st.integers(1, 6)
TOWERS = TowerDomain(training=BlockSource(blocks=6, seed=0))
PACKING = PackingDomain(training=BoxSource(boxes=8, seed=0))


def rng_of(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def shares_of(kind: int, n: int) -> tuple[float, ...]:
    return tuple(float(each == kind) for each in range(n))


@given(seed=seeds, n=st.integers(1, 30), k=lengths, more=st.integers(0, 3))
def test_another_object_comes_where_it_was_asked_for(seed: int, n: int, k: int, more: int) -> None:
    rng = rng_of(seed)
    objects = np.array([rng.permutation(k + more)[:k] for _ in range(n)], np.int16)
    place = rng.integers(k, size=n)
    found = exchanged(objects, place, k + more, rng)
    assert found.dtype == objects.dtype
    for before, after, where in zip(objects, found, place, strict=True):
        assert len(set(after.tolist())) == k, "no object twice"
        assert 0 <= after.min() <= after.max() < k + more
        changed = np.flatnonzero(before != after)
        if k + more == 1:
            assert not len(changed)
        elif after[where] in before:
            other = int(np.flatnonzero(before == after[where])[0])
            assert sorted(changed.tolist()) == sorted([where, other])
            assert after[other] == before[where]
        else:
            assert changed.tolist() == [where]


@given(seed=seeds, n=st.integers(1, 30), k=st.integers(2, 6))
def test_two_placements_change_places(seed: int, n: int, k: int) -> None:
    order = swapped(n, k, rng_of(seed))
    assert (np.sort(order) == np.arange(k)).all()
    assert ((order != np.arange(k)).sum(1) == 2).all()


def test_another_number_is_any_other_one() -> None:
    numbers = np.repeat(np.arange(3, dtype=np.int8), 200)
    found = another(numbers, 3, rng_of(0))
    assert found.dtype == np.int8
    assert {(int(a), int(b)) for a, b in zip(numbers, found, strict=True)} == {
        (a, b) for a in range(3) for b in range(3) if a != b
    }


def test_steps_are_as_often_between_1_and_10_as_between_10_and_100() -> None:
    sizes = step_sizes(4000, (1.0, 100.0), rng_of(0))
    assert 1 <= sizes.min() < 1.1 < 90 < sizes.max() <= 100
    assert (sizes < 10).mean() == pytest.approx(0.5, abs=0.03)


@given(seed=seeds, k=lengths)
def test_a_tower_stays_a_tower(seed: int, k: int) -> None:
    towers = TOWERS.random_plans(k, 50, rng_of(seed))
    found = TOWERS.vary(towers, rng_of(seed + 1))
    assert (len(found), found.length, found.blocks) == (50, k, towers.blocks)
    assert all(len(set(row)) == k for row in found.block.tolist())
    assert found.block.min() >= 0
    assert found.block.max() < 6
    assert found.rotation.min() >= 0
    assert found.rotation.max() < 24
    assert (found.block.dtype, found.rotation.dtype) == (towers.block.dtype, towers.rotation.dtype)
    np.testing.assert_array_equal(found.xy[:, 0], towers.xy[:, 0])
    assert (np.abs(relative_offsets(found)) <= TOWERS.offset.limit + 1e-9).all()
    again = TOWERS.vary(towers, rng_of(seed + 1))
    assert TOWERS.encode(again) == TOWERS.encode(found), "it follows the stream"


@given(seed=seeds)
def test_a_problems_towers_hold_the_same_blocks(seed: int) -> None:
    """A problem has as many blocks as a tower: they only change places."""
    towers = TOWERS.problem(4, 30, rng_of(seed))
    assert (np.sort(TOWERS.vary(towers, rng_of(seed)).block) == np.arange(4)).all()


def varied(domain: Any, module: Any, kind: int, monkeypatch: pytest.MonkeyPatch) -> tuple[Any, Any]:
    """200 plans of five placements, and a variation of each that changes this alone."""
    monkeypatch.setattr(module, "SHARES", shares_of(kind, len(module.SHARES)))
    plans = domain.random_plans(5, 200, rng_of(0))
    return plans, domain.vary(plans, rng_of(1))


class TestTowers:
    @pytest.fixture(params=["JOINT", "ALL", "ROTATION", "EXCHANGE", "SWAP"])
    def pair(self, request: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[str, Towers, Towers]]:
        yield request.param, *varied(TOWERS, of_towers, getattr(of_towers, request.param), monkeypatch)

    def test_each_kind_changes_one_thing(self, pair: tuple[str, Towers, Towers]) -> None:
        kind, before, after = pair
        blocks, turns = ((getattr(before, x) != getattr(after, x)).sum(1) for x in ("block", "rotation"))
        offsets = ~np.isclose(relative_offsets(before), relative_offsets(after), rtol=0, atol=1e-12).all(-1)
        assert (offsets.sum(1) == {"JOINT": 1, "ALL": 4}.get(kind, 0)).mean() > 0.97, "all but offsets at their limit"
        assert (turns == 1).all() if kind == "ROTATION" else (turns <= (2 if kind == "SWAP" else 0)).all()
        assert (blocks > 0).all() if kind in ("EXCHANGE", "SWAP") else (blocks == 0).all()
        if kind == "SWAP":
            assert (blocks == 2).all()
            pairs = [sorted(zip(b, r, strict=True)) for b, r in zip(before.block.tolist(), before.rotation.tolist())]
            assert pairs == [
                sorted(zip(b, r, strict=True)) for b, r in zip(after.block.tolist(), after.rotation.tolist())
            ]

    def test_what_lies_above_moves_along(self, monkeypatch: pytest.MonkeyPatch) -> None:
        before, after = varied(TOWERS, of_towers, of_towers.JOINT, monkeypatch)
        shift = after.xy - before.xy
        joint = (np.abs(np.diff(shift, axis=1)) > 1e-12).any(-1).argmax(1) + 1
        for row, first in enumerate(joint):
            np.testing.assert_allclose(shift[row, :first], 0, atol=1e-12)
            np.testing.assert_allclose(shift[row, first:], np.tile(shift[row, first], (5 - first, 1)), atol=1e-12)


@given(seed=seeds, k=lengths)
def test_a_packing_stays_a_packing(seed: int, k: int) -> None:
    packings = PACKING.random_plans(k, 50, rng_of(seed))
    found = PACKING.vary(packings, rng_of(seed + 1))
    assert (len(found), found.length, found.boxes, found.cell) == (50, k, packings.boxes, packings.cell)
    assert all(len(set(row)) == k for row in found.box.tolist())
    assert found.box.min() >= 0
    assert found.box.max() < 8
    assert found.orientation.min() >= 0
    assert found.orientation.max() < 6
    assert (found.box.dtype, found.orientation.dtype) == (packings.box.dtype, packings.orientation.dtype)
    assert PACKING.encode(PACKING.vary(packings, rng_of(seed + 1))) == PACKING.encode(found), "it follows the stream"
    room = PACKING.cell.container.half - found.dims[..., :2] / 2
    outside = (np.abs(found.xy) > np.maximum(room, 0) + 1e-12).any(-1)
    kept = (found.xy == packings.xy).all(-1) & (found.box == packings.box)
    assert kept[outside].all(), "what changes is between the walls"
    assert PACKING.feasible(found.prefix(1)).all(), "models are not asked about a first placement"


class TestPackings:
    @pytest.fixture(params=["SHIFT", "ALL", "MOVE", "TURN", "EXCHANGE", "SWAP"])
    def pair(self, request: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[str, Packings, Packings]]:
        yield request.param, *varied(PACKING, of_packings, getattr(of_packings, request.param), monkeypatch)

    def test_each_kind_changes_one_thing(self, pair: tuple[str, Packings, Packings]) -> None:
        kind, before, after = pair
        boxes, turns = ((getattr(before, x) != getattr(after, x)).sum(1) for x in ("box", "orientation"))
        assert (boxes > 0).all() if kind in ("EXCHANGE", "SWAP") else (boxes == 0).all()
        assert (turns == 1).all() if kind == "TURN" else (turns <= (2 if kind == "SWAP" else 0)).all()
        moved = (before.xy != after.xy).any(-1)
        if kind in ("SHIFT", "MOVE", "ALL"):
            assert (moved.sum(1) == (5 if kind == "ALL" else 1)).mean() > 0.9, "all but boxes at a wall"
        else:
            changed = (before.box != after.box) | (before.orientation != after.orientation)
            assert not (moved & ~changed).any(), "a box that no longer fits is moved off the wall; no other box is"
