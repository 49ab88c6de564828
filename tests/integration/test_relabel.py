"""Correcting a label: both are kept, what was learned is learned again, what was chosen meanwhile is marked."""

import json
from pathlib import Path

import pandas as pd
import pytest
import yaml

from integration.command_line import TINY, call

pytestmark = pytest.mark.usefixtures("no_figures")
RELABEL = "apf.relabel"


@pytest.fixture
def run(here: Path) -> Path:
    """A finished run of three acquisitions; tower 9 is of the first."""
    call(*TINY, "plans=14", "hydra.run.dir=run").must_work()
    return here / "run"


def labels_of(run: Path, tower: int) -> str:
    table = pd.read_parquet(run / "plans.parquet")
    return "".join("-" if pd.isna(label) else str(label) for label in table[table["tower"] == tower]["label"])


def other_labels(old: str) -> str:
    return "0" + "-" * (len(old) - 1)


def test_a_correction_is_recorded_and_learned(run: Path) -> None:
    old = labels_of(run, 9)
    new = other_labels(old)
    before = {name: pd.read_parquet(run / f"{name}.parquet") for name in ("plans", "regret", "accuracy")}
    weights = {path.name: path.read_bytes() for path in (run / "weights").iterdir()}
    call("run=run", "plan=9", f"labels={new}", "reason=the camera was blocked", command=RELABEL).must_work()
    record = json.loads((run / "journal.jsonl").read_text().splitlines()[-1])
    kept = {key: record[key] for key in ("kind", "plan", "old", "labels", "reason")}
    assert kept == {"kind": "correction", "plan": 9, "old": old, "labels": new, "reason": "the camera was blocked"}
    assert record["at"]
    assert yaml.safe_load((run / "run.yaml").read_text())["finished"] is False
    assert pd.read_parquet(run / "accuracy.parquet")["step"].tolist() == [], "all evaluations came after tower 9"

    call("resume=run").must_work()
    towers = pd.read_parquet(run / "plans.parquet")
    assert labels_of(run, 9) == new
    notes = towers.groupby("tower")["note"].first()
    assert notes[9] == "corrected"
    assert set(notes[[10, 11, 12, 13]]) == {"chosen before a correction"}
    assert notes[:9].isna().all()
    same = towers["tower"] != 9
    columns = [column for column in towers if column != "note"]
    pd.testing.assert_frame_equal(towers[same][columns], before["plans"][same][columns], check_exact=True)
    assert pd.read_parquet(run / "regret.parquet")["step"].unique().tolist() == [1, 2, 3]
    for path in (run / "weights").iterdir():
        assert path.read_bytes() != weights[path.name], "the models learned from the corrected label"


def test_evaluations_before_the_tower_stay(run: Path) -> None:
    before = pd.read_parquet(run / "regret.parquet")
    call("run=run", "plan=13", f"labels={other_labels(labels_of(run, 13))}", command=RELABEL).must_work()
    after = pd.read_parquet(run / "regret.parquet")
    pd.testing.assert_frame_equal(after, before[before["step"] < 3])


def test_a_correction_taken_back_gives_the_first_results(run: Path) -> None:
    before = {name: pd.read_parquet(run / f"{name}.parquet") for name in ("regret", "accuracy")}
    old = labels_of(run, 13)
    for labels in (other_labels(old), old):
        call("run=run", "plan=13", f"labels={labels}", command=RELABEL).must_work()
        call("resume=run").must_work()
    for name, table in before.items():
        pd.testing.assert_frame_equal(table, pd.read_parquet(run / f"{name}.parquet"), check_exact=True)


def test_labels_after_the_fall_may_be_left_out(run: Path) -> None:
    call("run=run", "plan=9", "labels=0", command=RELABEL).must_work()
    assert labels_of(run, 9) == other_labels(labels_of(run, 9))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("plan=0", "labels=111"), ("labels is 111", "2 characters")),
        (("plan=0", "labels=01"), ("labels is 01",)),
        (("plan=0", "labels=1-"), ("labels is 1-",)),
        (("plan=0", "labels=1x"), ("labels is 1x",)),
        (("plan=99", "labels=10"), ("plan is 99", "plans 0 to 13")),
        (("plan=0",), ("labels is missing",)),
        (("plan=first", "labels=10"), ("plan", "first")),
        (("+nonsense=1", "plan=0", "labels=10"), ("nonsense",)),
    ],
)
def test_what_is_refused(run: Path, arguments: tuple[str, ...], words: tuple[str, ...]) -> None:
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file() and path.name != "lock"}
    call("run=run", *arguments, command=RELABEL).must_refuse(*words)
    assert {path: path.read_bytes() for path in before} == before
    same = labels_of(run, 0)
    call("run=run", "plan=0", f"labels='{same}'", command=RELABEL).must_refuse("has these labels already")


def test_where_there_is_no_run(here: Path) -> None:
    call("run=nowhere", "plan=0", "labels=1", command=RELABEL).must_refuse("nowhere", "no run there")
    assert list(here.iterdir()) == []
