"""python -m apf.evaluate: what a finished run has learned, tried in another world."""

from pathlib import Path

import pandas as pd
import pytest

from apf.errors import InputError
from apf.evaluate import translated
from apf.trained import load_ensemble
from integration.command_line import TINY, call

pytestmark = pytest.mark.usefixtures("no_figures")


@pytest.fixture
def finished(here: Path) -> Path:
    """A run that was evaluated twice, of blocks that no config names."""
    call(*TINY, "domain.evaluation.seed=77", "hydra.run.dir=first").must_work()
    return here / "first"


def test_a_finished_run_in_another_world(finished: Path) -> None:
    """With the run's own objects, and its own problems: the plans that it chose are chosen again."""
    call(
        *TINY, "run=first", "world=noisy", "world.noise=0.05", "hydra.run.dir=second", command="apf.evaluate"
    ).must_work()
    first, second = (pd.read_parquet(f"{run}/evaluation_plans.parquet") for run in ("first", "second"))
    assert set(second["world"]) == {"noisy"}
    last = first[(first["step"] == first["step"].max()) & (first["world"] == "noisy")].reset_index(drop=True)
    same = ["task", "problem", "position", "value", "chance", "block", "rotation", "x", "y"]
    same = [column for column in same if column in last]
    pd.testing.assert_frame_equal(last[same], second[same])
    assert Path("second/evaluation_blocks.csv").read_text() == Path("first/evaluation_blocks.csv").read_text()
    call("resume=second").must_work()


def test_an_earlier_step(finished: Path) -> None:
    ensembles = [load_ensemble(finished, step) for step in (1, 2, None)]
    weights = [next(iter(each.network.parameters())) for each in ensembles]
    assert not weights[0].equal(weights[1])
    assert weights[1].equal(weights[2]), "the last one by default"
    call(*TINY, "run=first", "step=1", "world=noisy", "hydra.run.dir=second", command="apf.evaluate").must_work()
    first, second = (pd.read_parquet(f"{run}/evaluation_plans.parquet") for run in ("first", "second"))
    chosen = first[(first["step"] == 1) & (first["world"] == "noisy")]
    assert second["chance"].tolist() == chosen["chance"].tolist()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run=nothing", "world=noisy"), ("nothing holds no run",)),
        (("run=first", "step=9", "world=noisy"), ("step is 9", "steps 1, 2")),
        (
            ("run=first", "world=noisy", "domain=packing", "task=[volume]"),
            ("predictor.run", "TowerDomain", "PackingDomain"),
        ),
        (("run=first", "world=panda"), ("block", "gripper takes at most")),
    ],
)
def test_mistakes_leave_nothing(finished: Path, arguments: tuple[str, ...], words: tuple[str, ...]) -> None:
    call(*TINY, *arguments, "hydra.run.dir=second", command="apf.evaluate").must_refuse(*words)
    assert not Path("second").exists()


def test_a_run_that_did_not_learn(here: Path) -> None:
    call(*TINY, "predictor=analytic", "hydra.run.dir=first").must_work()
    call(*TINY, "run=first", "world=noisy", "hydra.run.dir=second", command="apf.evaluate").must_refuse(
        "keeps no weights"
    )


@pytest.mark.parametrize("arguments", [(), ("run=a",), ("world=noisy",), ("run=", "world=noisy")])
def test_both_are_needed(arguments: tuple[str, ...]) -> None:
    with pytest.raises(InputError, match=r"=\.\.\. is missing: python -m apf.evaluate run=DIR world=NAME"):
        translated(arguments)
