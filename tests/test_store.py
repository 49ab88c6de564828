"""The store: every method of it, against values worked out by hand, before and after it is opened again."""

import json
import shutil
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from apf.domain import Domain, Outcome, Scored
from apf.errors import InputError, Stopped
from apf.rundir.chosen import ChosenPlan
from apf.rundir.columns import ACCURACY_COLUMNS, REGRET_COLUMNS
from apf.rundir.evaluations import Execution
from apf.rundir.store import Store
from apf.towers import TowerDomain, read_towers

NAN = float("nan")
TABLES = ("plans", "regret", "accuracy", "evaluation_plans")


@pytest.fixture
def open_store(tmp_path: Path, domain: TowerDomain) -> Iterator[Callable[[], Store]]:
    """Opens the store of one run directory, as often as it is called; what was opened before is closed."""
    opened: list[Store] = []

    def open_store() -> Store:
        while opened:
            opened.pop().close()
        (tmp_path / "run").mkdir(exist_ok=True)
        opened.append(Store(tmp_path / "run", domain))
        return opened[0]

    yield open_store
    for store in opened:
        store.close()


@pytest.fixture
def store(open_store: Callable[[], Store]) -> Store:
    """An empty one."""
    return open_store()


def scored(domain: TowerDomain, length: int, score: float, seed: int) -> Scored:
    return Scored(domain.random_plans(length, 1, np.random.default_rng(seed)), score)


@pytest.fixture
def plans(domain: TowerDomain) -> list[Scored]:
    """Two initial plans, and three that a model chose."""
    lengths, scores = (2, 3, 3, 2, 3), (NAN, NAN, 0.5, 0.25, 0.125)
    return [scored(domain, k, score, seed) for seed, (k, score) in enumerate(zip(lengths, scores))]


LABELS = ([1, 0], [1, 1, 1], [1, 0, -1], [1, 1])
"""Of the first four plans; the fifth stays pending."""
REPORT = {"left": [1, 2], "tries": 3}


@pytest.fixture
def filled(store: Store, plans: list[Scored]) -> Store:
    """Step 0 with towers 0 and 1, step 1 with towers 2 to 4, the last of which is not executed yet."""
    store.plan(0, plans[:2], ["train", "validation"])
    for number in (0, 1):
        store.record(number, np.array(LABELS[number]))
    store.plan(1, plans[2:], ["validation", "train", "train"])
    store.record(2, np.array(LABELS[2]), REPORT)
    store.record(3, np.array(LABELS[3]))
    return store


def kinds(store: Store) -> list[str]:
    return [record["kind"] for record in store.journal.records]


def same_plan(mine: Any, theirs: Any) -> bool:
    return all(np.array_equal(getattr(mine, name), getattr(theirs, name)) for name in ("block", "rotation", "xy"))


def regret_table(step: int, regret: float) -> pd.DataFrame:
    rows = [
        (step, 2, "tallest", 0, "analytic", 0.5, 0.9, 0.75, regret, True, 1.0, 0.5),
        (step, 2, "overhang", 0, "noisy", 0.5, 0.8, 0.0, NAN, False, NAN, NAN),
    ]
    return pd.DataFrame(rows, columns=REGRET_COLUMNS)


def accuracy_table(step: int, accuracy: float) -> pd.DataFrame:
    return pd.DataFrame([(step, 2, 3, accuracy, 0.875, 0.5, 0.125, 40)], columns=ACCURACY_COLUMNS)


def chosen_plans(domain: Domain) -> list[ChosenPlan]:
    """Two plans of three and two placements, the first executed in two worlds."""
    one, other = (domain.problem(length, 1, np.random.default_rng(length)) for length in (3, 2))
    noisy = Outcome(np.array([1, 0, -1], np.int8), {"outcome": "fell", "entries": []})
    outcomes = {"analytic": Outcome(np.array([1, 1, 1], np.int8)), "noisy": noisy}
    return [
        ChosenPlan("tallest", 0, one, 0.5, np.array([1.0, 0.95, 0.9]), 0.75, 1.0, outcomes),
        ChosenPlan(
            "overhang", 1, other, 0.25, np.array([1.0, 0.8]), 0.5, NAN, {"noisy": Outcome(np.array([0, -1], np.int8))}
        ),
    ]


def save(path: Path) -> None:
    path.write_bytes(b"weights")


def evaluate(store: Store, step: int, regret: float = 0.25, save: Callable[[Path], None] | None = save) -> None:
    accuracy = accuracy_table(step, regret + 0.5)
    store.record_evaluation(step, regret_table(step, regret), accuracy, chosen_plans(store.domain), save)


def state(store: Store) -> dict[str, Any]:
    """All that a store answers, as plain values."""

    def labelled(split: str | None, until: int | None) -> list[Any]:
        return [
            (group.plans.block.tolist(), group.plans.xy.tolist(), group.labels.tolist())
            for group in store.labelled(split, until)
        ]

    return {
        "corrections": store.corrections,
        "planned": [store.planned(step) for step in range(3)],
        "pending": [[(number, store.domain.encode(plan)) for number, plan in store.pending(step)] for step in range(3)],
        "labelled": [labelled(split, until) for split in (None, "train", "validation") for until in (None, 0, 1)],
        "executed": [[str(values.tolist()) for values in store.executed(step)] for step in range(3)],
        "count": [store.count(step) for step in range(3)],
        "reports": [store.reports(), store.last_report],
        "training": [store.training(step) for step in range(3)],
        "evaluated": [store.evaluated(step) for step in range(3)],
        "tables": [
            table.to_csv() for table in (store.plans(), store.regret(), store.accuracy(), store.evaluation_plans())
        ],
        "types": [table.dtypes.astype(str).tolist() for table in (store.plans(), store.regret(), store.accuracy())],
    }


class TestPlans:
    def test_a_step_is_planned_once_its_plans_are_recorded(self, store: Store, plans: list[Scored]) -> None:
        assert not store.planned(0)
        store.plan(0, plans[:2], ["train", "validation"])
        assert store.planned(0)
        assert not store.planned(1)

    def test_plans_are_pending_until_their_labels_are_there(self, store: Store, plans: list[Scored]) -> None:
        assert store.pending(0) == []
        store.plan(0, plans[:2], ["train", "validation"])
        store.plan(1, plans[2:], ["train"] * 3)
        assert [number for number, _ in store.pending(0)] == [0, 1]
        pending = store.pending(1)
        assert [number for number, _ in pending] == [2, 3, 4]
        assert all(same_plan(plan, given.plan) for (_, plan), given in zip(pending, plans[2:], strict=True))
        store.record(3, np.array([1, 1]))
        assert [number for number, _ in store.pending(1)] == [2, 4]

    def test_the_plans_of_a_step_are_one_record(self, filled: Store) -> None:
        assert kinds(filled) == ["plans", "label", "label", "plans", "label", "label"]
        _, _, _, second, *_ = filled.journal.records
        assert second["step"] == 1
        assert [(plan["split"], plan["score"]) for plan in second["plans"]] == [
            ("validation", 0.5),
            ("train", 0.25),
            ("train", 0.125),
        ]
        assert [plan["score"] for plan in filled.journal.records[0]["plans"]] == [None, None]

    def test_a_split_for_every_plan(self, store: Store, plans: list[Scored]) -> None:
        with pytest.raises(ValueError, match="shorter"):
            store.plan(0, plans, ["train"])
        assert kinds(store) == []
        assert not store.planned(0)


class TestLabels:
    def test_labelled_plans_come_by_length_oldest_first(self, filled: Store, plans: list[Scored]) -> None:
        pairs, triples = filled.labelled()
        assert pairs.labels.tolist() == [[1, 0], [1, 1]]
        assert triples.labels.tolist() == [[1, 1, 1], [1, 0, -1]]
        assert pairs.labels.dtype == np.int8
        for group, numbers in ((pairs, (0, 3)), (triples, (1, 2))):
            for row, number in enumerate(numbers):
                assert same_plan(group.plans[row : row + 1], plans[number].plan)

    @pytest.mark.parametrize(
        ("split", "until", "labels"),
        [
            ("train", None, [[[1, 0], [1, 1]]]),
            ("validation", None, [[[1, 1, 1], [1, 0, -1]]]),
            (None, 0, [[[1, 0]], [[1, 1, 1]]]),
            ("train", 0, [[[1, 0]]]),
            ("validation", 0, [[[1, 1, 1]]]),
            ("train", 1, [[[1, 0], [1, 1]]]),
            ("test", None, []),
        ],
    )
    def test_of_a_split_and_up_to_a_step(
        self, filled: Store, split: str | None, until: int | None, labels: list[Any]
    ) -> None:
        assert [group.labels.tolist() for group in filled.labelled(split, until)] == labels

    def test_how_many_are_labelled_up_to_a_step(self, filled: Store) -> None:
        assert [filled.count(until=step) for step in (0, 1, 2)] == [2, 4, 4]

    def test_what_was_executed_in_a_step(self, filled: Store) -> None:
        succeeded, scores = filled.executed(0)
        assert succeeded.tolist() == [False, True]
        assert np.isnan(scores).all() and len(scores) == 2
        succeeded, scores = filled.executed(1)
        assert succeeded.tolist() == [False, True]
        assert scores.tolist() == [0.5, 0.25]
        assert (succeeded.dtype, scores.dtype) == (bool, float)
        assert [len(values) for values in filled.executed(2)] == [0, 0]

    def test_a_label_is_on_disk_before_the_call_returns(self, filled: Store) -> None:
        lines = (filled.directory / "journal.jsonl").read_text().splitlines()
        assert [json.loads(line)["kind"] for line in lines][-6:] == kinds(filled)
        last = json.loads(lines[-1])
        assert (last["plan"], last["labels"]) == (3, "11")
        assert json.loads(lines[-2])["labels"] == "10-"

    def test_an_unknown_plan_has_no_label(self, filled: Store) -> None:
        with pytest.raises((IndexError, ValueError)):
            filled.record(5, np.array([1, 1]))


class TestReports:
    def test_of_all_plans_and_of_a_step(self, filled: Store) -> None:
        assert filled.reports() == {2: REPORT}
        assert filled.reports(1) == {2: REPORT}
        assert filled.reports(0) == {}

    def test_a_label_without_a_report_says_nothing_of_one(self, filled: Store) -> None:
        assert ["report" in record for record in filled.journal.records if record["kind"] == "label"] == [
            False,
            False,
            True,
            False,
        ]

    def test_the_last_report_is_that_of_the_last_plan_that_has_one(self, store: Store, plans: list[Scored]) -> None:
        store.plan(0, plans[:3], ["train"] * 3)
        assert store.last_report is None
        store.record(0, np.array([1, 0]), {"left": 0})
        store.record(1, np.array([1, 1, 1]), {"left": 1})
        store.record(2, np.array([1, 1, 1]))
        assert store.last_report == {"left": 1}
        assert store.reports(0) == {0: {"left": 0}, 1: {"left": 1}}


class TestOneTower:
    def test_what_is_known_of_it(self, filled: Store) -> None:
        tower = filled.proposal(2)
        assert (tower.number, tower.step, tower.split, tower.score) == (2, 1, "validation", 0.5)
        assert (tower.labels, tower.report, tower.corrected, tower.outdated, tower.note) == (
            "10-",
            REPORT,
            False,
            False,
            None,
        )
        assert filled.proposal(0).score is None
        assert filled.proposal(0).labels == "10"

    @pytest.mark.parametrize("number", [-1, 4, 5])
    def test_only_of_those_that_have_labels(self, filled: Store, number: int) -> None:
        with pytest.raises(InputError, match=rf"^plan is {number}; plans 0 to 3 have labels in .*run$"):
            filled.proposal(number)

    def test_numbers_are_not_counted_from_the_end(self, filled: Store) -> None:
        filled.record(4, np.array([1, 1, 1]))
        assert filled.proposal(4).labels == "111"
        with pytest.raises(InputError, match=r"^plan is -1; plans 0 to 4 have labels"):
            filled.proposal(-1)

    def test_of_none(self, store: Store) -> None:
        with pytest.raises(InputError, match=r"^plan is 0; none has labels in .*run$"):
            store.proposal(0)


class TestCorrections:
    def test_the_new_labels_count_and_the_old_are_kept(self, filled: Store) -> None:
        filled.correct(0, "11", "seen on the video")
        assert filled.corrections == 1
        assert filled.proposal(0).labels == "11"
        assert filled.executed(0)[0].tolist() == [True, True]
        assert filled.labelled("train", until=0)[0].labels.tolist() == [[1, 1]]
        last = filled.journal.records[-1]
        assert {key: last[key] for key in ("kind", "plan", "old", "labels", "reason")} == {
            "kind": "correction",
            "plan": 0,
            "old": "10",
            "labels": "11",
            "reason": "seen on the video",
        }

    def test_plans_that_a_model_chose_afterwards_are_marked(self, filled: Store, domain: TowerDomain) -> None:
        filled.plan(2, [scored(domain, 2, 0.5, 9), scored(domain, 2, NAN, 10)], ["train"] * 2)
        for number, labels in ((4, [1, 0, -1]), (5, [1, 1]), (6, [1, 1])):
            filled.record(number, np.array(labels))
        filled.correct(3, "10", "misread")
        assert [filled.proposal(number).note for number in range(7)] == [
            None,
            None,
            None,
            "corrected",
            None,
            "chosen before a correction",
            None,
        ]
        filled.correct(0, "11", "misread")
        filled.correct(2, "110", "misread")
        assert [filled.proposal(number).note for number in range(7)] == [
            "corrected",
            None,
            "corrected; chosen before a correction",
            "corrected; chosen before a correction",
            "chosen before a correction",
            "chosen before a correction",
            None,
        ]
        assert filled.corrections == 3

    def test_what_was_learned_from_the_old_labels_is_forgotten(self, filled: Store) -> None:
        for step in (0, 1, 2):
            filled.record_training(step, {"loss/train": 0.5})
            evaluate(filled, step)
        filled.correct(2, "111", "misread")
        assert [filled.training(step) is not None for step in (0, 1, 2)] == [True, False, False]
        assert [filled.evaluated(step) for step in (0, 1, 2)] == [True, False, False]
        assert set(filled.regret()["step"]) == {0}
        filled.record_training(1, {"loss/train": 0.5})
        assert filled.training(1) == {"loss/train": 0.5}

    def test_only_of_plans_that_have_labels(self, filled: Store) -> None:
        with pytest.raises(InputError, match="plan is 4"):
            filled.correct(4, "111", "misread")
        assert filled.corrections == 0
        assert "correction" not in kinds(filled)


class TestTrainings:
    def test_their_losses_are_kept(self, store: Store) -> None:
        assert store.training(0) is None
        store.record_training(0, {"loss/train": 0.5, "loss/validation": 0.75})
        store.record_training(1, {"loss/train": 0.25})
        assert store.training(0) == {"loss/train": 0.5, "loss/validation": 0.75}
        assert store.training(1) == {"loss/train": 0.25}
        assert store.training(2) is None
        assert [(r["step"], r["losses"]) for r in store.journal.records] == [
            (0, {"loss/train": 0.5, "loss/validation": 0.75}),
            (1, {"loss/train": 0.25}),
        ]

    def test_the_same_training_done_again_is_no_news(self, store: Store) -> None:
        store.record_training(0, {"loss/train": 0.5})
        store.record_training(0, {"loss/train": 0.5})
        assert kinds(store) == ["training"]
        store.record_training(0, {"loss/train": 0.125})
        assert kinds(store) == ["training", "training"]
        assert store.training(0) == {"loss/train": 0.125}


class TestEvaluations:
    def test_a_step_is_evaluated_once_its_evaluation_is_recorded(self, store: Store) -> None:
        assert not store.evaluated(0)
        evaluate(store, 0)
        assert store.evaluated(0)
        assert not store.evaluated(1)

    def test_the_weights_lie_where_they_belong(self, store: Store) -> None:
        assert store.weights(7) == store.directory / "weights" / "step_0007.safetensors"
        evaluate(store, 7)
        assert store.weights(7).read_bytes() == b"weights"
        assert [path.name for path in store.weights(7).parent.iterdir()] == ["step_0007.safetensors"]

    def test_it_holds_only_with_the_weights_it_was_made_with(self, store: Store) -> None:
        evaluate(store, 0)
        evaluate(store, 1)
        store.weights(0).write_bytes(b"weighty")
        assert not store.evaluated(0)
        assert store.evaluated(1)
        store.weights(1).unlink()
        assert not store.evaluated(1)
        evaluate(store, 0)
        assert store.evaluated(0)

    def test_a_predictor_without_weights_leaves_none(self, store: Store) -> None:
        evaluate(store, 0, save=None)
        assert store.evaluated(0)
        assert not store.weights(0).exists()
        for step in (0, 1):
            store.weights(step).write_bytes(b"of another run")
            evaluate(store, step, save=None)
            store.weights(step).write_bytes(b"of a third")
            assert store.evaluated(step)

    def test_weights_that_cannot_be_written_leave_the_evaluation_undone(self, store: Store) -> None:
        def fails(path: Path) -> None:
            path.write_bytes(b"wei")
            raise OSError("no space")

        with pytest.raises(OSError, match="no space"):
            evaluate(store, 0, save=fails)
        assert not store.evaluated(0)
        assert kinds(store) == []
        assert list((store.directory / "weights").iterdir()) == []

    def test_tables_hold_what_was_recorded(self, store: Store) -> None:
        evaluate(store, 1, regret=0.125)
        evaluate(store, 0, regret=0.25)
        assert store.regret().columns.tolist() == REGRET_COLUMNS
        rows = store.regret().astype(object).where(store.regret().notna(), None).to_numpy().tolist()
        assert rows == [
            [0, 2, "tallest", 0, "analytic", 0.5, 0.9, 0.75, 0.25, True, 1.0, 0.5],
            [0, 2, "overhang", 0, "noisy", 0.5, 0.8, 0.0, None, False, None, None],
            [1, 2, "tallest", 0, "analytic", 0.5, 0.9, 0.75, 0.125, True, 1.0, 0.5],
            [1, 2, "overhang", 0, "noisy", 0.5, 0.8, 0.0, None, False, None, None],
        ]
        assert store.accuracy().columns.tolist() == ACCURACY_COLUMNS
        assert store.accuracy().to_numpy().tolist() == [
            [0, 2, 3, 0.75, 0.875, 0.5, 0.125, 40],
            [1, 2, 3, 0.625, 0.875, 0.5, 0.125, 40],
        ]

    def test_columns_have_their_types_also_without_rows(self, store: Store) -> None:
        for evaluated in (False, True):
            if evaluated:
                evaluate(store, 0)
            types = store.regret().dtypes
            assert all(types[name] == "int64" for name in ("step", "plans", "problem"))
            assert all(types[name] == "float64" for name in ("value", "best_value", "regret"))
            assert types["feasible"] == "bool"
            types = store.accuracy().dtypes
            assert all(types[name] == "int64" for name in ("step", "plans", "length", "n"))
            assert all(types[name] == "float64" for name in ("accuracy", "auc", "nll", "ece"))
            assert len(store.regret()) == 2 * evaluated

    def test_a_step_evaluated_again_replaces_the_first(self, store: Store) -> None:
        evaluate(store, 0, regret=0.25)
        evaluate(store, 0, regret=0.5)
        assert store.regret()["regret"].dropna().tolist() == [0.5]

    def test_every_chosen_plan_is_kept(self, store: Store) -> None:
        """A row for each plan, world and placement; together they are a tower file, too."""
        assert len(store.evaluation_plans()) == 0
        evaluate(store, 3)
        table = store.evaluation_plans()
        assert table["tower"].tolist() == [0] * 3 + [1] * 3 + [2] * 2
        assert table["position"].tolist() == [0, 1, 2, 0, 1, 2, 0, 1]
        assert table["world"].tolist() == ["analytic"] * 3 + ["noisy"] * 5
        assert table["task"].tolist() == ["tallest"] * 6 + ["overhang"] * 2
        assert table["problem"].tolist() == [0] * 6 + [1] * 2
        assert table["chance"].tolist() == [1.0, 0.95, 0.9] * 2 + [1.0, 0.8]
        assert table["label"].fillna(-1).tolist() == [1, 1, 1, 1, 0, -1, 0, -1]
        assert table["report"].notna().tolist() == [False] * 3 + [True] + [False] * 4
        assert json.loads(table["report"][3]) == {"outcome": "fell", "entries": []}
        chosen = chosen_plans(store.domain)
        store.export()
        second, first = read_towers(store.directory / "evaluation_plans.parquet")
        assert (len(first.plans), len(second.plans)) == (1, 2)
        np.testing.assert_allclose(second.plans.xy, np.repeat(chosen[0].plan.xy, 2, axis=0))
        np.testing.assert_allclose(second.plans.dims, np.repeat(chosen[0].plan.dims, 2, axis=0))
        names = [chosen[0].plan.blocks.name[b] for b in chosen[0].plan.block[0]]
        assert table["block"].tolist()[:3] == names
        assert set(names) <= set(store.domain.evaluation_blocks.name)
        np.testing.assert_array_equal(first.plans.rotation, chosen[1].plan.rotation)

    def test_what_came_of_a_chosen_plan_is_kept_until_the_evaluation_is_over(self, store: Store) -> None:
        """Only of worlds that report, and only for the very same plan."""
        one, other = (store.domain.problem(3, 1, np.random.default_rng(seed)) for seed in (0, 1))
        slow = Outcome(np.array([1, 0, -1], np.int8), {"outcome": "fell"})
        store.record_outcome(Execution(2, "tallest", 1, "panda"), one, slow)
        store.record_outcome(Execution(2, "tallest", 1, "noisy"), one, Outcome(np.array([1, 1, 1], np.int8)))
        copy = store.directory.with_name("copy")
        shutil.copytree(store.directory, copy)
        again = Store(copy, store.domain)
        found = again.outcome(Execution(2, "tallest", 1, "panda"), one)
        assert found is not None
        assert (found.labels.tolist(), found.report) == ([1, 0, -1], {"outcome": "fell"})
        assert again.outcome(Execution(2, "tallest", 1, "panda"), other) is None
        for key in ((1, "tallest", 1, "panda"), (2, "overhang", 1, "panda"), (2, "tallest", 0, "panda")):
            assert again.outcome(Execution(*key), one) is None
        assert again.outcome(Execution(2, "tallest", 1, "noisy"), one) is None
        evaluate(again, 2)
        assert again.outcome(Execution(2, "tallest", 1, "panda"), one) is None
        again.close()

    def test_tables_are_written_with_each_evaluation(self, filled: Store) -> None:
        assert not any((filled.directory / f"{name}.parquet").exists() for name in TABLES)
        evaluate(filled, 1)
        tables = (filled.plans(), filled.regret(), filled.accuracy(), filled.evaluation_plans())
        for name, table in zip(TABLES, tables, strict=True):
            assert len(table)
            pd.testing.assert_frame_equal(pd.read_parquet(filled.directory / f"{name}.parquet"), table)

    def test_tables_are_written_when_asked_for(self, filled: Store) -> None:
        filled.export()
        assert len(pd.read_parquet(filled.directory / "plans.parquet")) == 10
        for name in ("regret", "accuracy"):
            assert len(pd.read_parquet(filled.directory / f"{name}.parquet")) == 0


class TestTowersTable:
    def test_one_row_for_every_placement_of_every_labelled_plan(self, filled: Store, plans: list[Scored]) -> None:
        filled.correct(0, "11", "misread")
        table = filled.plans()
        assert table.columns[:7].tolist() == ["tower", "position", "step", "split", "score", "label", "note"]
        rows = table.iloc[:, :7].astype(object).where(table.iloc[:, :7].notna(), None).to_numpy().tolist()
        assert rows == [
            [0, 0, 0, "train", None, 1, "corrected"],
            [0, 1, 0, "train", None, 1, "corrected"],
            [1, 0, 0, "validation", None, 1, None],
            [1, 1, 0, "validation", None, 1, None],
            [1, 2, 0, "validation", None, 1, None],
            [2, 0, 1, "validation", 0.5, 1, "chosen before a correction"],
            [2, 1, 1, "validation", 0.5, 0, "chosen before a correction"],
            [2, 2, 1, "validation", 0.5, None, "chosen before a correction"],
            [3, 0, 1, "train", 0.25, 1, "chosen before a correction"],
            [3, 1, 1, "train", 0.25, 1, "chosen before a correction"],
        ]
        assert table.index.tolist() == list(range(10))
        assert (str(table["label"].dtype), str(table["note"].dtype), table["score"].dtype) == ("Int8", "string", float)

    def test_its_other_columns_are_those_of_a_tower_file(self, filled: Store, plans: list[Scored]) -> None:
        table = filled.plans()
        own = [filled.domain.table(plans[number].plan) for number in range(4)]
        expected = pd.concat(own, ignore_index=True).drop(columns=["tower", "position"])
        pd.testing.assert_frame_equal(table.iloc[:, 7:], expected)

    def test_without_labels_it_has_the_same_columns_and_no_rows(self, store: Store, plans: list[Scored]) -> None:
        empty = store.plans()
        assert len(empty) == 0
        store.plan(0, plans[:1], ["train"])
        assert len(store.plans()) == 0
        store.record(0, np.array([1, 0]))
        assert store.plans().columns.tolist() == empty.columns.tolist()


class TestOpening:
    def test_an_empty_directory_is_an_empty_run(self, store: Store) -> None:
        assert (store.directory / "weights").is_dir()
        assert (store.directory / "journal.jsonl").exists()
        assert state(store) == {
            "corrections": 0,
            "planned": [False] * 3,
            "pending": [[]] * 3,
            "labelled": [[]] * 9,
            "executed": [["[]", "[]"]] * 3,
            "count": [0] * 3,
            "reports": [{}, None],
            "training": [None] * 3,
            "evaluated": [False] * 3,
            **{key: state(store)[key] for key in ("tables", "types")},
        }

    def test_opened_again_it_answers_the_same_after_every_record(
        self, open_store: Callable[[], Store], plans: list[Scored], domain: TowerDomain
    ) -> None:
        steps: list[Callable[[Store], None]] = [
            lambda store: store.plan(0, plans[:2], ["train", "validation"]),
            lambda store: store.record(0, np.array(LABELS[0])),
            lambda store: store.record(1, np.array(LABELS[1]), REPORT),
            lambda store: store.record_training(0, {"loss/train": 0.1, "loss/validation": 0.7}),
            lambda store: store.plan(1, plans[2:], ["validation", "train", "train"]),
            lambda store: store.record(2, np.array(LABELS[2])),
            lambda store: store.record(3, np.array(LABELS[3]), {"left": []}),
            lambda store: store.record_training(1, {"loss/train": 0.2}),
            lambda store: evaluate(store, 1, 1 / 3),
            lambda store: store.correct(2, "110", "misread"),
            lambda store: evaluate(store, 2, save=None),
        ]
        store, seen = open_store(), []
        for step in steps:
            step(store)
            seen.append(state(store))
            store = open_store()
            assert state(store) == seen[-1]
        assert all(before != after for before, after in pairwise(seen))

    @pytest.mark.parametrize(
        ("kind", "content"),
        [
            ("label", {"plan": 9, "labels": "11"}),
            ("label", {"plan": 4}),
            ("correction", {"plan": 9, "old": "10", "labels": "11", "reason": ""}),
            ("plans", {"step": 3, "plans": [{"colour": "red"}]}),
        ],
    )
    def test_records_that_do_not_follow_from_those_before_are_damage(
        self, filled: Store, open_store: Callable[[], Store], kind: str, content: dict[str, Any]
    ) -> None:
        path = filled.directory / "journal.jsonl"
        filled.journal.append(kind, **content)
        line = len(path.read_text().splitlines())
        with pytest.raises(InputError, match=rf"journal\.jsonl is damaged: line {line} \({kind}\)"):
            open_store()

    def test_a_torn_label_is_pending_again(self, filled: Store, open_store: Callable[[], Store]) -> None:
        path = filled.directory / "journal.jsonl"
        path.write_bytes(path.read_bytes()[:-5])
        store = open_store()
        assert [number for number, _ in store.pending(1)] == [3, 4]
        assert store.count(1) == 3

    def test_a_label_that_cannot_be_written_is_not_taken_into_account(
        self, filled: Store, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def full(*arguments: object) -> int:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr("os.write", full)
        with pytest.raises(Stopped, match="No space left"):
            filled.record(4, np.array([1, 1, 1]))
        monkeypatch.undo()
        assert [number for number, _ in filled.pending(1)] == [4]

    def test_a_closed_store_writes_nothing_more(self, tmp_path: Path, domain: TowerDomain) -> None:
        store = Store(tmp_path, domain)
        store.close()
        before = (tmp_path / "journal.jsonl").read_bytes()
        with pytest.raises(Stopped, match="cannot be written"):
            store.record_training(0, {"loss/train": 0.5})
        assert store.training(0) is None
        assert (tmp_path / "journal.jsonl").read_bytes() == before
