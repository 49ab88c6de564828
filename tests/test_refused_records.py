"""What the store refuses to read, and to write: records that are whole but cannot be."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from apf.domain import Scored
from apf.errors import InputError
from apf.rundir.columns import ACCURACY_COLUMNS, REGRET_COLUMNS
from apf.rundir.journal import Journal
from apf.rundir.store import Store
from apf.towers import TowerDomain

PLAN = {"block": [0, 1], "rotation": [0, 23], "xy": [[0.0, 0.0], [0.1, 0.0]]}
"""Of two blocks."""


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """Towers 0 and 1 have three blocks and no labels; tower 2 has two blocks and labels."""
    domain = TowerDomain()
    rng = np.random.default_rng(0)
    store = Store(tmp_path, domain)
    store.plan(0, [Scored(domain.random_plans(k, 1, rng), 0.5) for k in (3, 3, 2)], ["train"] * 3)
    store.record(2, np.array([1, 0]))
    return store


def plans(**changes: Any) -> dict[str, Any]:
    """The content of a record of one plan."""
    return {"step": 1, "plans": [{"split": "train", "score": None, "plan": PLAN} | changes]}


EVALUATION = {
    "step": 1,
    "regret": [[0] * len(REGRET_COLUMNS)],
    "accuracy": [[0] * len(ACCURACY_COLUMNS)],
    "chosen": [],
}


def chosen(**changes: Any) -> dict[str, Any]:
    """The content of an evaluation that chose one plan of two placements."""
    outcomes = {"noisy": {"labels": "10"}}
    plan = {"task": "tallest", "problem": 0, "plan": PLAN, "value": 0.5, "chances": [1, 0.9], "outcomes": outcomes}
    return EVALUATION | {"weights": None, "chosen": [plan | changes]}


WRONG = {
    "an unknown kind": ("dream", {"plan": 0}, "records of kind 'dream' are unknown"),
    "labels too few": ("label", {"plan": 0, "labels": "11"}, "labels are '11'; plan 0 takes 3 characters"),
    "labels too many": ("label", {"plan": 0, "labels": "1111"}, "plan 0 takes 3 characters"),
    "labels that rise again": ("label", {"plan": 0, "labels": "101"}, "labels are '101'"),
    "labels unobserved, and none fell": ("label", {"plan": 0, "labels": "11-"}, "labels are '11-'"),
    "labels after the fall": ("label", {"plan": 0, "labels": "100"}, "labels are '100'"),
    "labels of another sort": ("label", {"plan": 0, "labels": "1x1"}, "labels are '1x1'"),
    "labels no text": ("label", {"plan": 0, "labels": [1, 1, 1]}, "labels are [1, 1, 1]"),
    "labels of the wrong digits": ("label", {"plan": 0, "labels": "1\u06611"}, "plan 0 takes 3"),
    "no labels": ("label", {"plan": 0}, "labels is missing"),
    "a tower that was never proposed": ("label", {"plan": 3, "labels": "11"}, "plan 3 was not proposed before"),
    "a tower counted from the end": ("label", {"plan": -1, "labels": "11"}, "plan is -1"),
    "a tower that is no number": ("label", {"plan": True, "labels": "111"}, "plan is True"),
    "a second label": ("label", {"plan": 2, "labels": "11"}, "plan 2 has labels already"),
    "a report that is none": ("label", {"plan": 0, "labels": "111", "report": "fine"}, "report is no mapping"),
    "a correction of nothing": (
        "correction",
        {"plan": 0, "old": None, "labels": "111", "reason": ""},
        "plan 0 has labels None before",
    ),
    "a correction of something else": (
        "correction",
        {"plan": 2, "old": "11", "labels": "0-", "reason": ""},
        "plan 2 has labels 10 before, and not 11",
    ),
    "a correction of the wrong length": (
        "correction",
        {"plan": 2, "old": "10", "labels": "111", "reason": ""},
        "plan 2 takes 2 characters",
    ),
    "plans that are none": ("plans", {"step": 1, "plans": {"plan": PLAN}}, "plans are no list"),
    "a plan with more in it": ("plans", plans(colour="red"), "a plan is not split, score and plan"),
    "a plan of no blocks": ("plans", plans(plan={"block": [], "rotation": [], "xy": []}), "a plan is not block"),
    "a plan of uneven length": ("plans", plans(plan=PLAN | {"block": [0]}), "a plan is not block"),
    "a plan with a block that is not there": ("plans", plans(plan=PLAN | {"block": [0, 10]}), "block (0 to 9)"),
    "a plan of something else": ("plans", plans(plan={"pack": [1]}), "a plan is not block"),
    "a step that is none": ("plans", plans() | {"step": "first"}, "step is 'first'"),
    "losses that are none": ("training", {"step": 0, "losses": [0.5]}, "losses are no numbers by name"),
    "an evaluation without weights": ("evaluation", EVALUATION, "weights is missing"),
    "an evaluation of other columns": (
        "evaluation",
        EVALUATION | {"weights": None, "regret": [[1, 2]]},
        f"regret is no rows of {len(REGRET_COLUMNS)} values",
    ),
    "a reward of other labels": (
        "reward",
        {"step": 0, "task": "tallest", "problem": 0, "world": "panda", "plan": PLAN, "labels": "110", "report": {}},
        "labels are not those of 2 prefixes",
    ),
    "a reward of no problem": (
        "reward",
        {"step": 0, "task": "tallest", "problem": "x", "world": "panda", "plan": PLAN, "labels": "11", "report": {}},
        "problem is 'x'",
    ),
    "chosen plans that are none": ("evaluation", chosen() | {"chosen": {}}, "chosen is no list of plans"),
    "a chosen plan with more in it": ("evaluation", chosen(colour="red"), "a chosen plan is not chances, outcomes"),
    "a chosen plan of something else": ("evaluation", chosen(plan={"pack": [1]}), "a plan is not block"),
    "chances too few": ("evaluation", chosen(chances=[1.0]), "chances are not those of 2 prefixes"),
    "an outcome without labels": ("evaluation", chosen(outcomes={"noisy": {}}), "labels are None"),
    "an outcome of other labels": (
        "evaluation",
        chosen(outcomes={"noisy": {"labels": "111"}}),
        "an outcome has no labels of 2 prefixes",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_record_that_cannot_be_is_refused_by_its_line(store: Store, case: str) -> None:
    kind, content, words = WRONG[case]
    path = store.journal.path
    store.journal.append(kind, **content)
    store.close()
    with pytest.raises(InputError) as error:
        Store(path.parent, store.domain)
    assert f"is damaged: line 4 ({kind}) cannot be used: " in str(error.value)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("case", WRONG)
def test_no_such_record_is_ever_written(store: Store, case: str) -> None:
    kind, content, words = WRONG[case]
    before = store.journal.path.read_bytes()
    with pytest.raises(ValueError) as error:
        store._append(kind, **content)
    assert words in str(error.value)
    assert store.journal.path.read_bytes() == before


def test_what_can_be_is_read_back(store: Store) -> None:
    for number, labels in ((0, "111"), (1, "0--")):
        store._append("label", plan=number, labels=labels, report={"seconds": 3})
    store._append("correction", plan=1, old="0--", labels="10-", reason="")
    store._append("plans", **plans())
    store._append("training", step=0, losses={"loss/train": 0.5})
    store._append("evaluation", **EVALUATION, weights=None)
    store.close()
    again = Store(store.directory, store.domain)
    assert [again.proposal(number).labels for number in range(3)] == ["111", "10-", "10"]
    assert again.training(0) == {"loss/train": 0.5}
    assert again.evaluated(1)
    assert len(Journal(store.journal.path).records) == len(store.journal.path.read_text().splitlines()) - 1 == 8
    assert json.loads(store.journal.path.read_text().splitlines()[0])["kind"] == "journal"
