"""Plans in, labels and a report out; one seed, one result."""

import json

import numpy as np
import pytest

from apf.domain import are_labels
from apf.panda import PandaWorld
from apf.panda.accounting import COLUMNS
from apf.towers import BlockSet, NoisyWorld, Towers


def rng_of(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.fixture(scope="session")
def good(graspable: BlockSet) -> Towers:
    """Two blocks, one turned, that stand by far."""
    return Towers(graspable, np.array([[2, 0]]), np.array([[0, 9]]), np.zeros((1, 2, 2)))


@pytest.fixture(scope="session")
def bad(graspable: BlockSet) -> Towers:
    """The second block has its middle far outside the first one."""
    return Towers(graspable, np.array([[2, 0, 1]]), np.zeros((1, 3), int), np.array([[[0, 0], [0.045, 0], [0.05, 0]]]))


def test_what_stands_and_what_falls(exact_world: PandaWorld, good: Towers, bad: Towers) -> None:
    first = exact_world.attempt(good, rng_of(0))
    assert first.labels.tolist() == [1, 1]
    assert first.report is not None
    assert first.report["outcome"] == "stood"
    second = exact_world.attempt(bad, rng_of(0), first.report)
    assert second.labels.tolist() == [1, 0, -1]
    assert second.report is not None
    assert second.report["outcome"] == "fell"
    table = exact_world.table({7: first.report, 8: second.report})
    assert list(table) == list(COLUMNS)
    assert table["tower"].tolist() == [7] * 4 + [8] * (len(table) - 4)
    assert table["purpose"].tolist()[:4] == ["build", "build", "tidy", "tidy"]
    placed = table[table["purpose"] == "build"]["error"].dropna()
    assert len(placed) == 3, "what fell was not placed"
    assert placed.max() < 0.005
    figures = exact_world.summary([first.report, second.report])
    assert figures["pick_and_places"] == len(table)
    assert figures["interventions"] == 0
    assert 3 < figures["simulated"] < 30


def test_a_seed_fixes_all_that_happens(graspable: BlockSet, bad: Towers) -> None:
    """Two worlds, one of which has built before; and a world that goes on from a report that went through a file."""
    one, other = PandaWorld(), PandaWorld()
    start = other.attempt(bad, rng_of(5)).report
    results = [world.attempt(bad, rng_of(3), json.loads(json.dumps(start))) for world in (one, other)]
    assert results[0].labels.tolist() == results[1].labels.tolist()
    reports = [result.report for result in results]
    assert reports[0] is not None
    assert reports[1] is not None
    assert reports[0]["blocks"] == reports[1]["blocks"], "to the last bit"
    simulated = [[entry.get("simulated") for entry in report["entries"]] for report in reports if report]
    assert simulated[0] == simulated[1]
    one.close()
    other.close()


def test_a_world_begins_where_the_last_plan_ended(world: PandaWorld, graspable: BlockSet, good: Towers) -> None:
    poses = {name: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] for name in graspable.name}
    home = world.layout.home_poses(graspable.dims)
    for name, where in zip(graspable.name, home):
        poses[name][:3] = (where[:3, 3] + [0.004, 0, 0]).tolist()
    started = world._poses(graspable, {"blocks": poses}, "blocks")
    np.testing.assert_allclose(started[:, :3, 3], home[:, :3, 3] + [0.004, 0, 0])
    other = BlockSet(tuple("wxyz"), graspable.dims, graspable.com, graspable.mass)
    np.testing.assert_array_equal(world._poses(other, {"blocks": poses}, "blocks"), home)


def test_many_towers_at_once(exact_world: PandaWorld, good: Towers) -> None:
    labels = exact_world.execute(good[np.array([0, 0])], rng_of(0))
    assert labels.dtype == np.int8
    assert labels.tolist() == [[1, 1], [1, 1]]


def test_what_cannot_be_planned_is_told_apart_from_a_fall(
    exact_world: PandaWorld, graspable: BlockSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    tower = Towers(graspable, np.array([[0, 1]]), np.zeros((1, 2), int), np.array([[[0, 0], [0, 0]]]))
    planner = exact_world.builder.robot.planner
    find = planner.plan

    def not_for_the_second(block: int, *rest: object) -> object:
        from apf.panda.planner import NoPlan

        if block == 1:
            raise NoPlan("no grasp")
        return find(block, *rest)

    monkeypatch.setattr(planner, "plan", not_for_the_second)
    outcome = exact_world.attempt(tower, rng_of(0))
    assert outcome.labels.tolist() == [1, 0]
    assert outcome.report is not None
    assert outcome.report["outcome"] == "no plan"
    assert exact_world.summary([outcome.report])["no_plan"] == 1


def test_the_first_towers_are_labelled_elsewhere() -> None:
    noisy = NoisyWorld(noise=0.003)
    assert PandaWorld(initial=noisy).initial_world is noisy
    world = PandaWorld()
    assert world.initial_world is world


def test_a_report_of_nothing_is_an_empty_table(world: PandaWorld) -> None:
    table = world.table({})
    assert list(table) == list(COLUMNS)
    assert len(table) == 0
    assert world.summary([]) == {}


@pytest.mark.robot
def test_random_towers_all_get_labels(world: PandaWorld, graspable: BlockSet) -> None:
    from apf.towers import random_towers

    report = None
    for number in range(5):
        tower = random_towers(graspable, 4, 1, rng_of(number))
        outcome = world.attempt(tower, rng_of(number), report)
        assert are_labels(outcome.labels)
        report = outcome.report
