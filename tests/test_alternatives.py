"""Plans to choose from: which ones differ, the best of these, and a least chance."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from apf.domain import Domain, Predictor, Task
from apf.errors import InputError
from apf.packing import BoxSource, PackingDomain
from apf.packing.packings import Packings
from apf.planning import MonteCarloPlanner, Planner, Problem, SearchPlanner, alternatives
from apf.rng import stream
from apf.towers import AnalyticPredictor, BlockSet, BlockSource, Tallest, TowerDomain, Towers

PLANNERS: list[Planner] = [
    SearchPlanner(candidates=500, start=200, generations=5),
    MonteCarloPlanner(candidates=500, first=64),
]


class Graded(Predictor):
    """The chance falls with the largest offset between neighbours: 1 at 0 m."""

    def feasibility(self, plans: Towers, rng: np.random.Generator) -> np.ndarray:
        return np.exp(-np.abs(np.diff(plans.xy, axis=1)).max((1, 2)) / 0.05)


class Reach(Task):
    """Plans are worth how far they reach along x."""

    unit = "m"

    def value(self, plans: Towers) -> np.ndarray:
        return np.ptp(plans.xy[..., 0], axis=1)


@pytest.fixture(scope="module")
def domain() -> TowerDomain:
    return TowerDomain(training=BlockSource(blocks=6, seed=3))


@pytest.fixture(scope="module")
def candidates(domain: TowerDomain) -> Towers:
    return domain.random_plans(3, 500, stream(0, "candidates"))


class TestTowersThatDiffer:
    """Cubes of 1/8 m: half the summed sides are 1/8 m, so a joint is another one beyond 1/32 m."""

    @pytest.mark.parametrize(
        ("tower", "differs"),
        [
            ([(0, 0, 0.0, 0.0), (1, 0, 0.03, 0.0)], False),  # itself
            ([(0, 0, 0.5, 0.25), (1, 0, 0.53, 0.25)], False),  # moved as a whole
            ([(0, 0, 0.0, 0.0), (1, 0, 0.06, 0.0)], False),
            ([(0, 0, 0.0, 0.0), (1, 0, 0.0625, 0.0)], True),
            ([(0, 0, 0.0, 0.0), (1, 0, 0.03, -0.0625)], True),
            ([(0, 0, 0.0, 0.0), (2, 0, 0.03, 0.0)], True),  # another block
            ([(1, 0, 0.0, 0.0), (0, 0, 0.03, 0.0)], True),  # another order
        ],
    )
    def test_joints_and_blocks(self, cubes: BlockSet, build: Callable, tower: list, differs: bool) -> None:
        this = build(cubes, [(0, 0, 0.0, 0.0), (1, 0, 0.03, 0.0)])
        assert TowerDomain().differ(build(cubes, tower), this).tolist() == [differs]

    def test_turned_as_a_whole_or_a_block_alone(self, blocks: BlockSet, build: Callable) -> None:
        this = build(blocks, [(0, 0, 0.0, 0.0), (1, 0, 0.04, 0.02), (2, 0, 0.0, 0.0)])
        assert [TowerDomain().differ(this.turned(q), this).tolist() for q in range(4)] == [[False]] * 4
        on_its_side = [build(blocks, [(0, 0, 0.0, 0.0), (1, r, 0.04, 0.02), (2, 0, 0.0, 0.0)]) for r in range(24)]
        others = [tower for tower in on_its_side if (tower.dims != this.dims).any()]
        assert len(others) == 20
        assert all(TowerDomain().differ(tower, this).all() for tower in others)


def test_packings_that_differ() -> None:
    domain = PackingDomain(training=BoxSource(boxes=4, seed=0))
    boxes = domain.training_boxes
    side = boxes.dims[0, 0]

    def packing(box: tuple[int, int], turn: int = 0, x: float = 0.0) -> Packings:
        xy = np.array([[[x, 0.0], [0.0, 0.05]]])
        return Packings(domain.cell, boxes, np.array([box]), np.array([[turn, 0]]), xy)

    others = [packing((0, 1)), packing((0, 1), x=0.24 * side), packing((0, 1), x=0.26 * side), packing((1, 0))]
    others += [packing((0, 2)), packing((0, 1), turn=2)]
    found = [bool(domain.differ(other, packing((0, 1)))[0]) for other in others]
    assert found == [False, False, True, True, True, True]


def test_by_default_all_but_the_same_plan_differ(candidates: Towers, domain: TowerDomain) -> None:
    found = Domain.differ(domain, candidates, candidates[[7]])
    assert np.flatnonzero(~found).tolist() == [7]


@pytest.mark.parametrize("planner", PLANNERS, ids=lambda planner: type(planner).__name__)
class TestAlternatives:
    def test_each_differs_and_the_best_comes_first(self, planner: Planner, candidates: Any, domain: Any) -> None:
        found = alternatives(planner, candidates, Tallest(), AnalyticPredictor(), domain, 4)
        assert len(found) == 4
        for i, one in enumerate(found):
            assert one.chance == 1
            assert all(domain.differ(one.plan, other.plan)[0] for other in found[:i])
        expected = [choice.expected for choice in found]
        assert expected == sorted(expected, reverse=True)

    def test_one_is_what_the_planner_chooses(self, planner: Planner, candidates: Any, domain: Any) -> None:
        (found,) = alternatives(planner, candidates, Tallest(), AnalyticPredictor(), domain, seed=5)
        problem = Problem(candidates, stream(5, "search", 0))
        ((chosen,),) = (e.values() for e in planner.choose([problem], {"task": Tallest()}, AnalyticPredictor(), domain))
        np.testing.assert_array_equal(found.plan.xy, chosen.plan.xy)
        assert (found.value, found.chance) == (chosen.value, chosen.chance)

    def test_a_least_chance_costs_value(self, planner: Planner, candidates: Any, domain: Any) -> None:
        (free,) = alternatives(planner, candidates, Reach(), Graded(), domain)
        sure = alternatives(planner, candidates, Reach(), Graded(), domain, 2, least=0.7)
        assert free.chance < 0.7
        assert all(choice.chance >= 0.7 - 1e-4 for choice in sure)
        assert all(choice.chance == pytest.approx(Graded().feasibility(choice.plan, None)[0]) for choice in sure)
        assert sure[0].expected < free.expected

    def test_a_chance_that_nothing_has(self, planner: Planner, candidates: Any, domain: Any) -> None:
        likeliest = Graded().feasibility(candidates, None).max()  # type: ignore[arg-type]
        with pytest.raises(
            InputError, match=r"of at least 0\.9999; the best chance that was found is 0\.\d\d$"
        ) as error:
            alternatives(planner, candidates, Reach(), Graded(), domain, least=0.9999)
        assert float(str(error.value)[-4:]) >= round(likeliest, 2) - 0.1

    def test_fewer_if_no_more_are_worth_anything(self, planner: Planner, domain: Any) -> None:
        """Towers of one block each, all of them the same but for the block."""
        few = TowerDomain(training=BlockSource(blocks=2, seed=0, side=(0.1, 0.1)))
        plans = few.random_plans(2, 40, stream(0, "few"))

        class InOrder(Task):
            unit = ""

            def value(self, plans: Towers) -> np.ndarray:
                near = np.abs(np.diff(plans.xy, axis=1)).max((1, 2)) < 0.01
                return ((plans.block == [0, 1]).all(1) & near).astype(float)

        near = plans.prefix(2)
        same = Towers(near.blocks, near.block, near.rotation, np.zeros_like(near.xy))
        assert len(alternatives(planner, same, InOrder(), AnalyticPredictor(), few, 5)) == 1
