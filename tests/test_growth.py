"""What a long run costs: looking a step up does not take longer the more came before it, nor does an evaluation."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import apf.rundir.store
from apf.domain import Scored
from apf.experiment import Acquisition, Execution, Experiment, Initial
from apf.rundir.columns import ACCURACY_COLUMNS, REGRET_COLUMNS
from apf.rundir.store import Store
from apf.towers import AnalyticWorld, TowerDomain

INITIAL, EACH = 20, 10


@pytest.fixture
def quick_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Thousands of records are not to wait for the disk each."""
    monkeypatch.setattr("os.fsync", lambda file: None)


def grow(store: Store, domain: TowerDomain, towers: int, every: int, reports: bool = False) -> None:
    """Record a run of so many towers of two to five blocks, evaluated after every `every`, by the store's own means."""
    rng = np.random.default_rng(towers)
    done = step = 0
    while done < towers:
        n = EACH if step else INITIAL
        scored = [
            Scored(domain.random_plans(int(rng.integers(2, 6)), 1, rng), rng.random() if step else np.nan)
            for _ in range(n)
        ]
        store.plan(step, scored, ["validation" if row % 5 == 0 else "train" for row in range(n)])
        for number, one in enumerate(scored, done):
            labels = np.full(one.plan.length, -1, np.int8)
            stood = int(rng.integers(1, one.plan.length + 1))
            labels[:stood], labels[stood : stood + 1] = 1, 0
            store.record(number, labels, {"left": number} if reports and number % 3 else None)
        done += n
        store.record_training(step, {"loss/train": 1 / done})
        if done // every > (done - n) // every:
            evaluate(store, step, done, rng)
        step += 1


def evaluate(store: Store, step: int, towers: int, rng: np.random.Generator) -> None:
    """Record an evaluation of two problems, one of which has no regret."""
    rows = [
        (step, towers, task, problem, world, rng.random(), 0.5, 0.9, regret, problem == 1, np.nan, np.nan)
        for problem, regret in ((0, np.nan), (1, rng.random()))
        for task in ("tallest", "overhang")
        for world in ("noisy", "analytic")
    ]
    accuracy = [(step, towers, length, *rng.random(4), 10) for length in (2, 3)]
    store.record_evaluation(
        step, pd.DataFrame(rows, columns=REGRET_COLUMNS), pd.DataFrame(accuracy, columns=ACCURACY_COLUMNS), []
    )


def experiment(store: Store, towers: int) -> Experiment:
    """As much of an experiment as tells figures."""
    nothing: Any = None
    return Experiment(
        seed=0,
        plans=towers,
        every=100,
        initial=Initial(train=INITIAL // 2, validation=INITIAL // 2),
        acquisition=Acquisition(plans=EACH, validation=2),
        execution=Execution(time_limit=None),
        sampler=nothing,
        world=AnalyticWorld(),
        model=nothing,
        evaluator=nothing,
        store=store,
        tracker=nothing,
    )


def plain_table(store: Store, domain: TowerDomain, towers: int) -> pd.DataFrame:
    """What `Store.towers` must be, one tower after another."""
    parts = []
    for number in range(towers):
        tower = store.proposal(number)
        part = domain.table(domain.decode([tower.plan]))
        part["tower"] = number
        part.insert(2, "step", tower.step)
        part.insert(3, "split", tower.split)
        part.insert(4, "score", np.nan if tower.score is None else tower.score)
        label = [None if symbol == "-" else int(symbol) for symbol in tower.labels or ""]
        part.insert(5, "label", pd.Series(label, dtype="Int8"))
        part.insert(6, "note", pd.Series([tower.note] * len(part), dtype="string"))
        parts.append(part)
    return pd.concat(parts, ignore_index=True)


@pytest.mark.usefixtures("quick_disk")
@pytest.mark.parametrize("reports", [False, True])
@pytest.mark.parametrize("corrected", [(), (3, 25, 39)])
def test_the_table_of_towers_is_what_one_tower_after_another_gives(
    tmp_path: Path, domain: TowerDomain, corrected: tuple[int, ...], reports: bool
) -> None:
    store = Store(tmp_path, domain)
    grow(store, domain, 40, every=20, reports=reports)
    store.labelled()  # what was decoded before a correction, or before more labels, must not stay
    for number in corrected:
        store.correct(number, "0".ljust(len(store.proposal(number).labels or ""), "-"), "seen")
    pd.testing.assert_frame_equal(store.plans(), plain_table(store, domain, 40), check_exact=True)
    again = Store(tmp_path, domain)
    pd.testing.assert_frame_equal(again.plans(), store.plans(), check_exact=True)
    if corrected:
        assert set(store.plans()["note"].dropna()) >= {"corrected", "chosen before a correction"}
    grow_one = domain.random_plans(5, 1, np.random.default_rng(0))
    store.plan(9, [Scored(grow_one, 0.5)], ["train"])
    pd.testing.assert_frame_equal(store.plans(), plain_table(store, domain, 40), check_exact=True)
    store.record(40, np.array([1, 1, 1, 0, -1]))
    pd.testing.assert_frame_equal(store.plans(), plain_table(store, domain, 41), check_exact=True)


def test_an_empty_table_of_towers_has_the_types_of_a_full_one(tmp_path: Path, domain: TowerDomain) -> None:
    for name in ("empty", "full"):
        (tmp_path / name).mkdir()
    empty, full = Store(tmp_path / "empty", domain), Store(tmp_path / "full", domain)
    grow(full, domain, 20, every=20)
    assert len(empty.plans()) == 0
    pd.testing.assert_frame_equal(empty.plans(), full.plans()[:0])


@pytest.mark.usefixtures("quick_disk")
def test_labelled_plans_are_the_oldest_first_and_of_the_split_and_steps_asked_for(
    tmp_path: Path, domain: TowerDomain
) -> None:
    store = Store(tmp_path, domain)
    grow(store, domain, 60, every=60)
    towers = [store.proposal(number) for number in range(60)]
    for split in (None, "train", "validation"):
        for until in (None, 0, 2):
            kept = [t for t in towers if split in (None, t.split) and (until is None or t.step <= until)]
            groups = store.labelled(split, until)
            assert [group.plans.length for group in groups] == sorted({len(t.labels or "") for t in kept})
            for group in groups:
                same = [t for t in kept if len(t.labels or "") == group.plans.length]
                assert domain.encode(group.plans) == [t.plan for t in same]
                assert ["".join("01-"[label] for label in row) for row in group.labels] == [t.labels for t in same]


def test_labels_that_come_out_of_order(tmp_path: Path, domain: TowerDomain) -> None:
    """By their numbers, however they came; the last report is that of the highest number."""
    store = Store(tmp_path, domain)
    plans = [domain.random_plans(2, 1, np.random.default_rng(seed)) for seed in range(4)]
    store.plan(0, [Scored(plan, np.nan) for plan in plans], ["train"] * 4)
    for number, report in ((2, {"left": 2}), (0, {"left": 0}), (3, None), (1, None)):
        store.labelled()
        store.record(number, np.array([1, number % 2]), report)
    (group,) = store.labelled()
    assert domain.encode(group.plans) == [domain.encode(plan)[0] for plan in plans]
    assert group.labels.tolist() == [[1, 0], [1, 1], [1, 0], [1, 1]]
    assert store.last_report == {"left": 2}
    assert store.plans()["tower"].tolist() == [0, 0, 1, 1, 2, 2, 3, 3]


@pytest.mark.usefixtures("quick_disk")
def test_the_history_is_what_was_told_step_by_step(tmp_path: Path, domain: TowerDomain) -> None:
    store = Store(tmp_path, domain)
    grow(store, domain, 60, every=20)
    whole = experiment(store, 60)
    history = whole.history()
    assert [(f.step, int(f.phase), f.plans) for f in history] == [
        (step, phase, 20 + 10 * step) for step in range(5) for phase in ((0, 1, 2) if step % 2 == 0 else (0, 1))
    ]
    for figures in history:
        if figures.phase == 2:
            told = whole.evaluation_metrics(figures.step)
            assert list(figures.values.items()) == list(told.values.items())
            rows = store.regret()
            rows = rows[(rows["step"] == figures.step) & (rows["problem"] == 1)]
            row = rows[(rows["world"] == "noisy") & (rows["task"] == "tallest")].iloc[0]
            assert figures.values["regret/noisy/tallest"] == row["regret"], "the other problem has none"
            assert figures.values["success/noisy/tallest"] == 0.5
            assert next(iter(figures.values)) == "regret/analytic/tallest"
            accuracy = store.accuracy(figures.step).set_index("length")["accuracy"]
            assert figures.values["accuracy/3"] == accuracy[3]


@pytest.mark.usefixtures("quick_disk")
def test_what_is_written_stays_in_proportion_to_the_run(
    tmp_path: Path, domain: TowerDomain, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All rows of all tables that the evaluations of a run write: a few times those of its last tables."""
    written: dict[str, list[int]] = {}
    monkeypatch.setattr(
        apf.rundir.store, "write_table", lambda table, path: written.setdefault(path.stem, []).append(len(table))
    )
    store = Store(tmp_path, domain)
    grow(store, domain, 600, every=10)
    for name, table in (("plans", store.plans()), ("regret", store.regret()), ("accuracy", store.accuracy())):
        assert sum(written[name]) < 12 * len(table), "30 times, if every evaluation wrote it"
        assert 1 <= len(table) / written[name][-1] < 1.15, "it is about a tenth behind at most"


def least(action: Callable[[], object], repetitions: int) -> float:
    """Seconds of this process that an action takes when nothing disturbs it."""
    times = []
    for _ in range(repetitions):
        begun = time.process_time_ns()
        action()
        times.append(time.process_time_ns() - begun)
    return min(times) / 1e9


@pytest.mark.slow
@pytest.mark.usefixtures("quick_disk")
def test_time_grows_no_faster_than_the_run(tmp_path: Path, domain: TowerDomain) -> None:
    """1,000 towers against 4,000. What concerns one step takes as long; what concerns all, four times as long."""
    small, large = (times(tmp_path / str(towers), domain, towers) for towers in (1_000, 4_000))
    assert large[0] < 2 * small[0]
    assert large[1] < 6 * small[1]


def times(directory: Path, domain: TowerDomain, towers: int) -> tuple[float, float]:
    """Seconds for all that the loop asks of the last step, and to open, tell and export everything."""
    directory.mkdir()
    store = Store(directory, domain)
    grow(store, domain, towers, every=100)
    whole = experiment(store, towers)
    last = whole.steps

    def one_step() -> None:
        for _ in range(50):
            assert store.planned(last)
            assert store.pending(last) == []
            assert store.count(until=last) == towers
            assert len(store.executed(last)[0]) == EACH
            assert store.reports(last) == {}
            assert store.last_report is None
            whole.execution_metrics(last)

    def all_of_it() -> None:
        again = Store(directory, domain)
        again.labelled()
        experiment(again, towers).history()
        again.export()
        again.close()

    return least(one_step, 20), least(all_of_it, 5)


@pytest.mark.slow
@pytest.mark.usefixtures("quick_disk")
def test_twenty_thousand_towers_go_on_at_once(tmp_path: Path, domain: TowerDomain) -> None:
    """Open, tell the history, decode for training, and write the tables: within 5 s of one core."""
    store = Store(tmp_path, domain)
    grow(store, domain, 20_000, every=100)
    store.close()
    begun = time.process_time()
    again = Store(tmp_path, domain)
    assert len(experiment(again, 20_000).history()) == 2 * 1_999 + 200
    assert sum(len(group.labels) for group in again.labelled("train", until=1_998)) > 15_000
    again.export()
    assert time.process_time() - begun < 5
    again.close()
