"""The task level: which actions in which order."""

import gc
import logging
import subprocess
import sys

import pytest
from unified_planning.model import FNode, Object

from apf.panda.tasks import Action, Fact, solve

NOW, PEDESTAL, GOAL = "now", "pedestal3", "goal"


def names(actions: list[Action] | None) -> list[str]:
    assert actions is not None
    return [action.name for action in actions]


def test_one_grasp_that_serves_both_places() -> None:
    actions = solve(4, NOW, GOAL, [], [Fact(4, NOW, 7), Fact(4, GOAL, 7)])
    assert names(actions) == ["move-free", "pick", "move-holding", "place"]
    assert actions is not None
    assert [action.station for action in actions] == [Fact(4, NOW, 7)] * 2 + [Fact(4, GOAL, 7)] * 2
    assert [action.where for action in actions] == ["before", "above", "above", "before"]


def test_two_grasps_need_the_pedestal() -> None:
    facts = [Fact(4, NOW, 7), Fact(4, PEDESTAL, 7), Fact(4, PEDESTAL, 9), Fact(4, GOAL, 9)]
    actions = solve(4, NOW, GOAL, [PEDESTAL], facts)
    again = ["move-free", "pick", "move-holding"]
    assert names(actions) == [*again, "regrasp", *again, "place"]


def test_the_pedestal_is_not_used_in_vain() -> None:
    facts = [Fact(0, NOW, 7), Fact(0, GOAL, 7), Fact(0, PEDESTAL, 7), Fact(0, PEDESTAL, 9), Fact(0, GOAL, 9)]
    assert "regrasp" not in names(solve(0, NOW, GOAL, [PEDESTAL], facts))


@pytest.mark.parametrize(
    "facts",
    [
        [Fact(0, NOW, 7)],
        [Fact(0, NOW, 7), Fact(0, GOAL, 9)],
        [Fact(0, NOW, 7), Fact(0, PEDESTAL, 7), Fact(0, GOAL, 9)],
    ],
)
def test_without_the_stations_there_is_no_plan(facts: list[Fact]) -> None:
    assert solve(0, NOW, GOAL, [PEDESTAL], facts) is None


def test_the_terminal_stays_quiet(capfd: pytest.CaptureFixture) -> None:
    before = list(logging.getLogger().handlers)
    solve(0, NOW, GOAL, [], [Fact(0, NOW, 7), Fact(0, GOAL, 7)])
    assert logging.getLogger().handlers == before
    assert capfd.readouterr() == ("", "")


def test_nothing_is_left_of_a_problem() -> None:
    """unified-planning's common environment would keep every expression: a robot that works for days would run out."""
    for grasp in range(3):
        solve(0, NOW, GOAL, [], [Fact(0, NOW, grasp), Fact(0, GOAL, grasp)])
    gc.collect()
    assert not [left for left in gc.get_objects() if type(left) in (Object, FNode)]


def test_every_process_finds_the_same_plan() -> None:
    code = (
        "from apf.panda.tasks import *;"
        "f=[Fact(0,'now',7),Fact(0,'pedestal3',7),Fact(0,'pedestal3',9),Fact(0,'goal',9)];"
        "print(solve(0,'now','goal',['pedestal3'],f))"
    )
    found = {
        subprocess.run(
            [sys.executable, "-c", code], check=True, capture_output=True, text=True, env={"PYTHONHASHSEED": seed}
        ).stdout
        for seed in ("1", "2")
    }
    assert len(found) == 1
