"""One seed, one result; and a run that was stopped ends as if it had never been."""

import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from apf.models import Ensemble
from apf.rundir.store import Store
from apf.towers import BlockSource, NoisyWorld, write_blocks
from integration.command_line import SMOKE, TINY, Result, call, child_environment, spawn

TABLES = ("regret", "accuracy", "plans")


def must_be_equal(one: Path, other: Path) -> None:
    """Fails unless all tables and weights of two runs are the same, bit for bit."""
    for name in TABLES:
        tables = [pd.read_parquet(run / f"{name}.parquet") for run in (one, other)]
        assert len(tables[0])
        pd.testing.assert_frame_equal(*tables, check_exact=True)
    weights = [{path.name: path.read_bytes() for path in (run / "weights").iterdir()} for run in (one, other)]
    assert weights[0]
    assert weights[0].keys() == weights[1].keys()
    assert weights[0] == weights[1]


@pytest.mark.slow
def test_the_same_seed_in_another_process(smoke: tuple[Path, Result], tmp_path: Path) -> None:
    spawn(["-m", "apf.main", *SMOKE, "hydra.run.dir=run"], cwd=tmp_path, PYTHONHASHSEED="1").must_work()
    must_be_equal(smoke[0], tmp_path / "run")


@pytest.mark.slow
def test_another_seed_differs(smoke: tuple[Path, Result], here: Path) -> None:
    call(*SMOKE, "seed=1", "hydra.run.dir=run").must_work()
    one, other = (pd.read_parquet(run / "plans.parquet") for run in (smoke[0], here / "run"))
    assert not set(one["x"]) & set(other["x"]) - {0.0}, "no placement comes twice"
    for path in (smoke[0] / "weights").iterdir():
        assert path.read_bytes() != (here / "run" / "weights" / path.name).read_bytes()


@pytest.mark.slow
def test_problems_are_the_same_for_all_seeds(smoke: tuple[Path, Result], here: Path) -> None:
    call(*SMOKE, "seed=1", "plans=20", "hydra.run.dir=run").must_work()
    one, other = (pd.read_parquet(run / "regret.parquet") for run in (smoke[0], here / "run"))
    one = one[one["step"] == 1]
    assert len(other) == len(one)
    assert other["best_value"].tolist() == one["best_value"].tolist()


@pytest.mark.slow
def test_a_killed_process_goes_on_with_the_same_command(smoke: tuple[Path, Result], tmp_path: Path) -> None:
    command = [sys.executable, "-m", "apf.main", *SMOKE, "hydra.run.dir=run"]
    with subprocess.Popen(
        command, cwd=tmp_path, env=child_environment(), stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
    ) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if line.startswith("step 0"):
                process.send_signal(signal.SIGKILL)
                break
    assert process.returncode == -signal.SIGKILL
    run = tmp_path / "run"
    assert not (run / "plans.parquet").exists(), "it was to be killed midway"
    before = (run / "config.yaml").read_bytes()
    spawn(["-m", "apf.main", *SMOKE, "hydra.run.dir=run"], cwd=tmp_path).must_work()
    must_be_equal(smoke[0], run)
    assert (run / "config.yaml").read_bytes() == before


class Killed(BaseException):
    """Ends a run on the spot."""


def dies(owner: type, name: str, call_number: int, after: bool) -> Callable[[pytest.MonkeyPatch], None]:
    """Makes the n-th call of a method the last thing that a run does, or the first that it does not."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        original, count = getattr(owner, name), 0

        def dying(*args: Any, **kwargs: Any) -> Any:
            nonlocal count
            count += 1
            if count == call_number and not after:
                raise Killed
            result = original(*args, **kwargs)
            if count == call_number:
                raise Killed
            return result

        monkeypatch.setattr(owner, name, dying)

    return plant


MOMENTS = {
    "before anything is chosen": dies(Store, "plan", 1, after=False),
    "initial plans chosen": dies(Store, "plan", 1, after=True),
    "first tower built, not recorded": dies(NoisyWorld, "execute", 1, after=True),
    "some initial towers labelled": dies(Store, "record", 5, after=True),
    "all initial towers labelled": dies(Store, "record", 8, after=True),
    "trained": dies(Ensemble, "fit", 1, after=True),
    "about to write weights": dies(Ensemble, "save", 1, after=False),
    "weights written, evaluation not": dies(Store, "record_evaluation", 1, after=False),
    "evaluation recorded, tables not written": dies(Store, "export", 1, after=False),
    "evaluated": dies(Store, "record_evaluation", 1, after=True),
    "next plans chosen": dies(Store, "plan", 2, after=True),
    "some of the next labelled": dies(Store, "record", 9, after=True),
    "trained again": dies(Ensemble, "fit", 2, after=True),
    "all labelled": dies(Store, "record", 12, after=True),
    "last evaluation recorded, tables not written": dies(Store, "export", 2, after=False),
    "tables written, figures not": dies(Store, "export", 3, after=True),
}


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A tiny run of each sampler that was never stopped."""
    root = tmp_path_factory.mktemp("uninterrupted")
    for sampler in ("incremental", "complete"):
        call(*TINY, f"sampler={sampler}", f"hydra.run.dir={root / sampler}").must_work()
    return {sampler: root / sampler for sampler in ("incremental", "complete")}


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("moment", MOMENTS)
def test_a_run_stopped_at_any_moment_ends_the_same(
    moment: str, uninterrupted: dict[str, Path], here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = (*TINY, "sampler=incremental", "hydra.run.dir=run")
    with monkeypatch.context() as patch:
        MOMENTS[moment](patch)
        with pytest.raises(Killed):
            call(*command)
    call(*command).must_work()
    must_be_equal(uninterrupted["incremental"], here / "run")


@pytest.mark.slow
@pytest.mark.usefixtures("no_figures")
def test_a_run_stopped_again_and_again_ends_the_same(
    uninterrupted: dict[str, Path], here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every start labels one tower and dies: twelve starts for twelve towers."""
    command = (*TINY, "sampler=complete", "hydra.run.dir=run")
    for _ in range(12):
        with monkeypatch.context() as patch:
            dies(Store, "record", 1, after=True)(patch)
            with pytest.raises(Killed):
                call(*command)
    call(*command).must_work()
    must_be_equal(uninterrupted["complete"], here / "run")
    assert "finished" in call(*command).must_work().err


@pytest.mark.usefixtures("no_figures")
def test_a_block_file_that_changed_since_does_not_change_what_was_labelled(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Labels belong to the blocks they were seen with: go on with those, or refuse; never relabel other towers."""
    write_blocks(BlockSource(seed=5).load(), here / "blocks.csv")
    command = (*TINY, "domain.training.file=blocks.csv", "hydra.run.dir=run")
    with monkeypatch.context() as patch:
        dies(Store, "record_evaluation", 1, after=True)(patch)
        with pytest.raises(Killed):
            call(*command)
    before = pd.read_parquet(here / "run" / "plans.parquet")
    assert len(before)
    write_blocks(BlockSource(seed=6).load(), here / "blocks.csv")
    result = call(*command)
    if result.code:
        result.must_refuse("blocks.csv")
    after = pd.read_parquet(here / "run" / "plans.parquet")
    pd.testing.assert_frame_equal(before, after.iloc[: len(before)], check_exact=True)
