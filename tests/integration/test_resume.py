"""Going on with a run: by its directory alone, from anywhere, whatever stopped it, by one process at a time."""

import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
import yaml

from apf.domain import are_labels
from apf.experiment import Experiment
from apf.interrupts import TimeLimitError, time_limit
from apf.models import training
from apf.rundir.claim import locked
from apf.rundir.store import Store
from apf.towers import BlockSource, NoisyWorld, write_blocks
from integration.command_line import TINY, Result, call

pytestmark = pytest.mark.usefixtures("no_figures")


@pytest.fixture
def stopped(here: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run in run/ that stopped after five labels."""
    stop_after(5, monkeypatch, lambda: (_ for _ in ()).throw(KeyboardInterrupt))
    result = call(*TINY, "hydra.run.dir=run")
    assert result.code == 130
    monkeypatch.undo()
    monkeypatch.chdir(here)
    return here / "run"


def stop_after(labels: int, monkeypatch: pytest.MonkeyPatch, what: Callable[[], object]) -> None:
    """Do that once so many labels are recorded."""
    record, count = Store.record, iter(range(1, 1000))

    def recording(self: Store, *recorded: Any) -> None:
        record(self, *recorded)
        if next(count) == labels:
            what()

    monkeypatch.setattr(Store, "record", recording)


def last_line(result: Result) -> str:
    assert "Traceback" not in result.err, result.err
    return result.err.strip().splitlines()[-1]


def test_resume_needs_the_directory_alone(stopped: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    call(*TINY, "hydra.run.dir=whole").must_work()
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    call(f"resume={stopped}").must_work()
    for name in ("plans", "regret", "accuracy"):
        tables = [pd.read_parquet(run / f"{name}.parquet") for run in (stopped, stopped.parent / "whole")]
        pd.testing.assert_frame_equal(*tables, check_exact=True)
    assert yaml.safe_load((stopped / "run.yaml").read_text())["finished"]
    assert "finished" in call(f"resume={stopped}").must_work().err


def test_relative_paths_mean_the_same_after_a_resume(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_blocks(BlockSource(seed=5).load(), here / "blocks.csv")
    stop_after(5, monkeypatch, lambda: (_ for _ in ()).throw(KeyboardInterrupt))
    assert call(*TINY, "domain.training.file=blocks.csv", "hydra.run.dir=a run").code == 130
    (here / "elsewhere").mkdir()
    monkeypatch.chdir(here / "elsewhere")
    call("resume=../a run").must_work()


def test_what_is_given_with_resume_wins(stopped: Path) -> None:
    call("resume=run", "threads=2", "seed=13").must_refuse("another config", "seed")
    call("resume=run", "threads=2", "tracker=none").must_work()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("resume=nowhere",), ("nowhere", "no run there")),
        (("resume=a", "resume=b"), ("resume takes one run directory",)),
        (("-m", "resume=a", "seed=0,1"), ("sweep", "its own command")),
    ],
)
def test_resume_of_nothing(here: Path, arguments: tuple[str, ...], words: tuple[str, ...]) -> None:
    call(*arguments).must_refuse(*words)
    assert list(here.iterdir()) == []


def test_ctrl_c_says_how_to_go_on(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number, code in ((signal.SIGINT, 130), (signal.SIGTERM, 143)):
        before = signal.signal(number, signal.SIG_DFL)  # a shell's background job ignores Ctrl-C, and so do its tests
        with monkeypatch.context() as patch:
            stop_after(2, patch, lambda n=number: signal.raise_signal(n))
            result = call(*TINY, f"hydra.run.dir=run{code}")
        signal.signal(number, before)
        assert result.code == code
        assert last_line(result) == f"interrupted; go on with: python -m apf.main resume={here / f'run{code}'}"
        assert "interrupted" in (here / f"run{code}" / "run.log").read_text()


def test_a_second_process_is_refused(stopped: Path) -> None:
    with locked(stopped):
        call("resume=run").must_refuse(str(stopped), "works in it", "process ")
    call("resume=run").must_work()


def test_the_time_before_a_stop_counts(stopped: Path) -> None:
    journal = (stopped / "journal.jsonl").read_text().splitlines()
    assert len(journal) == 7
    call("resume=run").must_work()
    assert yaml.safe_load((stopped / "run.yaml").read_text())["seconds"] > 0
    assert (stopped / "journal.jsonl").read_text().splitlines()[:7] == journal


def test_a_loss_that_is_not_finite(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "cross_entropy", lambda logits, y: torch.full_like(logits, torch.inf))
    result = call(*TINY, "hydra.run.dir=run")
    assert result.code == 1
    for word in ("error: training diverged", "training.learning_rate", f"resume={here / 'run'}"):
        assert word in last_line(result)


def test_a_crash_leaves_its_traceback_in_the_log(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def crash(self: Experiment, step: int) -> None:
        raise ZeroDivisionError("a bug")

    with monkeypatch.context() as patch:
        patch.setattr(Experiment, "learn", crash)
        assert call(*TINY, "hydra.run.dir=run").code == 1
    log = (here / "run" / "run.log").read_text()
    assert "Traceback" in log
    assert "ZeroDivisionError: a bug" in log
    call("resume=run").must_work()


@pytest.mark.parametrize(
    ("fail", "words"),
    [
        (lambda: time.sleep(20), ("plan 3", "execution.time_limit=0.3 s")),
        (lambda: (_ for _ in ()).throw(ValueError("no grip")), ("plan 3", "ValueError: no grip")),
        (lambda: np.array([0, 1]), ("plan 3", "got [0, 1]")),
    ],
)
def test_a_world_that_fails(
    here: Path, monkeypatch: pytest.MonkeyPatch, fail: Callable[[], object], words: tuple[str, ...]
) -> None:
    execute, count = NoisyWorld.execute, iter(range(1000))
    with monkeypatch.context() as patch:
        patch.setattr(NoisyWorld, "execute", lambda *a: fail() if next(count) == 3 else execute(*a))
        result = call(*TINY, "execution.time_limit=0.3", "hydra.run.dir=run")
    assert result.code == 1
    for word in ("error: world: ", *words, "resume="):
        assert word in last_line(result)
    assert len([line for line in (here / "run" / "journal.jsonl").open() if '"label"' in line[:20]]) == 3
    call("resume=run", "execution.time_limit=null").must_work()


def test_a_time_limit_ends_with_its_block() -> None:
    with pytest.raises(TimeLimitError), time_limit(0.05):
        time.sleep(5)
    with time_limit(0.05):
        pass
    time.sleep(0.1)


@pytest.mark.parametrize(
    ("labels", "right"),
    [([1, 1], True), ([1, 0], True), ([1, 0, -1], True), ([0, 1], False), ([1, -1], False), ([1, 0, 0], False)],
)
def test_what_labels_are(labels: list[int], right: bool) -> None:
    assert are_labels(np.array(labels)) is right


@pytest.mark.parametrize("name", ["plans.parquet", "weights/step_0001.safetensors"])
@pytest.mark.parametrize("damage", [Path.unlink, lambda path: path.write_bytes(path.read_bytes()[:-4] + b"oops")])
def test_a_file_of_a_finished_run_is_made_again(here: Path, name: str, damage: Callable[[Path], object]) -> None:
    call(*TINY, "hydra.run.dir=run").must_work()
    before = {
        path: path.read_bytes() for path in [*(here / "run").glob("*.parquet"), *(here / "run").glob("weights/*")]
    }
    damage(here / "run" / name)
    call("resume=run").must_work()
    assert {path: path.read_bytes() for path in before} == before


def test_a_missing_or_damaged_journal(stopped: Path) -> None:
    journal = stopped / "journal.jsonl"
    text = journal.read_bytes()
    journal.write_bytes(b"x" + text[1:])
    call("resume=run").must_refuse("journal.jsonl is damaged: line 1 of 7")
    lines = text.splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[1:]))
    call("resume=run").must_refuse("journal.jsonl has format 1", "reads format 6")
    journal.write_bytes(b"")
    call("resume=run").must_refuse("journal.jsonl is empty", "all labels")
    journal.unlink()
    call("resume=run").must_refuse("journal.jsonl is missing", "all labels")
    journal.write_bytes(text)
    call("resume=run").must_work()


def test_a_new_run_that_cannot_begin_leaves_nothing(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders that somebody made stay, also if they are empty."""
    (here / "mine").mkdir()
    call(*TINY, "hydra.run.dir=mine/runs/new", "model.members=0").must_refuse("model.members")
    assert list(here.rglob("*")) == [here / "mine"]
    (here / "mine" / "empty").mkdir()
    call(*TINY, "hydra.run.dir=mine/empty", "model.members=0").must_refuse("model.members")
    assert list(here.rglob("*")) == [here / "mine", here / "mine" / "empty"]
