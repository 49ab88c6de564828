"""The commands of a newcomer with a GPU, on a pretended one: `device` stays auto."""

from pathlib import Path

import pandas as pd
import pytest
from pretend_gpu import pretend_gpu

from integration.command_line import TINY, call

pytestmark = pytest.mark.usefixtures("no_figures")


def tables(run: Path) -> dict[str, pd.DataFrame]:
    """The tables of a run, by name."""
    return {name: pd.read_parquet(run / f"{name}.parquet") for name in ("plans", "regret", "accuracy")}


@pytest.mark.parametrize(
    "choice", ["model=tgn", "model=tgn_contact", "model=fcgn", "model=lstm", "sampler=search", "planner=search"]
)
def test_a_run_on_a_gpu_does_what_one_on_a_cpu_does(here: Path, choice: str) -> None:
    command = (*TINY, choice)
    with pretend_gpu() as gpu:
        call(*command, "hydra.run.dir=there").must_work()
    assert gpu.moves > 0
    call(*command, "hydra.run.dir=here").must_work()
    there = tables(here / "there")
    for name, table in tables(here / "here").items():
        pd.testing.assert_frame_equal(there[name], table, rtol=0.01)


def test_a_run_that_began_on_one_device_goes_on_on_another(here: Path) -> None:
    with pretend_gpu():
        call(*TINY, "plans=10", "hydra.run.dir=run").must_work()
    before = tables(here / "run")
    call("resume=run", "plans=12", "device=cpu").must_work()
    with pretend_gpu():
        call("resume=run", "plans=14").must_work()
    after = tables(here / "run")
    assert after["plans"]["tower"].max() == 13
    for name, table in before.items():
        pd.testing.assert_frame_equal(after[name][after[name]["step"] < 2].reset_index(drop=True), table)
