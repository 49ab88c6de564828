"""A run that has finished can be made longer, and ends as if it had been as long from the start."""

from pathlib import Path

import pandas as pd
import pytest
import yaml

from integration.command_line import TINY, call

pytestmark = pytest.mark.usefixtures("no_figures")

LONGER = tuple("plans=16" if word == "plans=12" else word for word in TINY)


def must_be_equal(one: Path, other: Path) -> None:
    for name in ("plans", "regret", "accuracy"):
        tables = [pd.read_parquet(run / f"{name}.parquet") for run in (one, other)]
        pd.testing.assert_frame_equal(*tables, check_exact=True)


@pytest.mark.parametrize("how", ["the same command", "resume"])
def test_a_longer_run_goes_on_where_the_shorter_one_ended(here: Path, how: str) -> None:
    call(*LONGER, "hydra.run.dir=whole").must_work()
    call(*TINY, "hydra.run.dir=run").must_work()
    labels = (here / "run" / "journal.jsonl").read_bytes()
    if how == "resume":
        call("resume=run", "plans=16").must_work()
    else:
        call(*LONGER, "hydra.run.dir=run").must_work()
    must_be_equal(here / "run", here / "whole")
    assert (here / "run" / "journal.jsonl").read_bytes().startswith(labels)
    assert yaml.safe_load((here / "run" / "config.yaml").read_text())["plans"] == 16
    assert "finished" in call("resume=run").must_work().err


def test_a_run_that_has_gone_farther_has_finished(here: Path) -> None:
    call(*LONGER, "hydra.run.dir=run").must_work()
    assert "finished" in call(*TINY, "hydra.run.dir=run").must_work().err
    assert len(pd.read_parquet(here / "run" / "plans.parquet")["tower"].unique()) == 16


def test_a_sweep_made_longer_lengthens_its_runs(here: Path) -> None:
    for size in (TINY, LONGER):
        call("-m", *size, "hydra/launcher=basic", "seed=0,1").must_work()
    runs = [path for path in (here / "runs" / "sweep").iterdir() if path.is_dir()]
    assert len(runs) == 2
    for run in runs:
        assert len(pd.read_parquet(run / "plans.parquet")["tower"].unique()) == 16


def test_a_cut_acquisition_cannot_be_followed(here: Path) -> None:
    """With 13 towers the last acquisition had one tower; a longer run would have had two."""
    call(*TINY, "plans=13", "hydra.run.dir=run").must_work()
    call(*LONGER, "hydra.run.dir=run").must_refuse("13 plans", "cannot be made longer")


def test_an_unfinished_run_is_not_made_shorter(here: Path) -> None:
    call(*LONGER, "hydra.run.dir=run").must_work()
    state = here / "run" / "run.yaml"
    state.write_text(state.read_text().replace("finished: true", "finished: false"))
    call(*TINY, "hydra.run.dir=run").must_refuse("16 plans", "has not finished")
