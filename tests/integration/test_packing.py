"""The second domain through the command line, with nothing but domain=packing."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from apf.packing import PackingDomain, packed_prefixes, write_packings
from integration.command_line import TINY, call, options

pytestmark = pytest.mark.usefixtures("no_figures")
PACKING = (*TINY, "domain=packing")


@pytest.mark.parametrize("sampler", options("sampler"))
def test_every_sampler_learns(here: Path, sampler: str) -> None:
    call(*PACKING, f"sampler={sampler}", "hydra.run.dir=run").must_work()
    plans = pd.read_parquet("run/plans.parquet")
    assert plans.groupby("packing").ngroups == 12
    assert set(plans["label"].dropna()) == {0, 1}
    regret = pd.read_parquet("run/regret.parquet")
    assert set(regret["task"]) == {"volume", "value", "flat"}
    assert set(regret["world"]) == {"analytic", "noisy"}
    assert sorted(path.name for path in Path("run").glob("*.csv")) == ["evaluation_boxes.csv", "training_boxes.csv"]


def test_the_same_seed_gives_the_same_tables_and_a_longer_run_goes_on(here: Path) -> None:
    call(*PACKING, "hydra.run.dir=whole").must_work()
    call(*PACKING, "plans=10", "hydra.run.dir=run").must_work()
    call(*PACKING, "hydra.run.dir=run").must_work()
    for name in ("plans", "regret", "accuracy"):
        pd.testing.assert_frame_equal(pd.read_parquet(f"run/{name}.parquet"), pd.read_parquet(f"whole/{name}.parquet"))


def test_a_stopped_run_is_resumed_from_its_directory(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from integration.test_resume import stop_after

    call(*PACKING, "hydra.run.dir=whole").must_work()
    stop_after(9, monkeypatch, lambda: (_ for _ in ()).throw(KeyboardInterrupt))
    assert call(*PACKING, "hydra.run.dir=run").code == 130
    monkeypatch.undo()
    monkeypatch.chdir(here)
    call("resume=run").must_work()
    for name in ("plans", "regret", "accuracy"):
        pd.testing.assert_frame_equal(pd.read_parquet(f"run/{name}.parquet"), pd.read_parquet(f"whole/{name}.parquet"))


def test_a_label_is_corrected(here: Path) -> None:
    call(*PACKING, "hydra.run.dir=run").must_work()
    length = (pd.read_parquet("run/plans.parquet")["packing"] == 9).sum()
    labels = "0" + "-" * (length - 1)
    call("run=run", "plan=9", f"labels={labels}", command="apf.relabel").must_work()
    assert json.loads(Path("run/journal.jsonl").read_text().splitlines()[-1])["labels"] == labels
    call("resume=run").must_work()
    plans = pd.read_parquet("run/plans.parquet")
    assert plans[plans["packing"] == 9]["label"].tolist()[:1] == [0]


@pytest.mark.parametrize("predictor", ["analytic", "simulation"])
def test_predictors_that_know_the_rule(here: Path, predictor: str) -> None:
    call(*PACKING, f"predictor={predictor}", "evaluation.problems=4", "hydra.run.dir=run").must_work()
    regret, accuracy = (pd.read_parquet(f"run/{name}.parquet") for name in ("regret", "accuracy"))
    if predictor == "analytic":
        assert (accuracy["accuracy"] == 1).all()
        assert (regret[regret["world"] == "analytic"]["regret"] == 0).all()
    assert (regret["value"] >= 0).all()


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_labels_of_a_packing_file(here: Path, ending: str) -> None:
    domain = PackingDomain()
    plans = [domain.random_plans(length, 40, np.random.default_rng(length)) for length in (3, 1)]
    write_packings(plans[0], f"mine.{ending}")
    result = call("domain=packing", f"plans=mine.{ending}", "out=labels.csv", command="apf.label").must_work()
    labels = pd.read_csv("labels.csv")
    assert labels.columns.tolist() == ["packing", "position", "label"]
    ok = packed_prefixes(plans[0])
    np.testing.assert_array_equal((labels["label"] == 1).to_numpy().reshape(40, 3), ok)
    assert f"40 plans labelled, {ok[:, -1].sum()} of them succeed" in result.out


def test_boxes_of_a_file(here: Path) -> None:
    table = pd.DataFrame({"box": list("abcdefgh"), "dim_x": 60, "dim_y": 70, "dim_z": 80, "value": range(8)})
    table = table.rename(columns={f"dim_{axis}": f"dim_{axis} [mm]" for axis in "xyz"})
    table.to_csv("mine.csv", index=False)
    own = ("domain.training.file=mine.csv", "hydra.run.dir=run")
    call(*PACKING, *own).must_work()
    assert set(pd.read_parquet("run/plans.parquet")["box"]) <= set("abcdefgh")
    table.assign(value=-1).to_csv("wrong.csv", index=False)
    call(*PACKING, "domain.training.file=wrong.csv").must_refuse("domain.training.file: wrong.csv, row 2", "value = -1")


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("domain.container.height=0.1", ("domain.training", "does not fit into domain.container")),
        ("domain.places.wall=0.9", ("domain.places", "at most 1 together")),
        ("domain.gripper.thickness=0", ("domain.gripper.thickness", "greater than 0")),
        ("domain.training.boxes=4", ("sampler", "packings of 5 boxes need 5 boxes")),
        ("domain.containr=1", ("containr",)),
        ("world=panda", ("domain.training.mass", "no such key")),  # what the robot needs of towers
        ("task=tallest", ("task.tallest", "PackingDomain")),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(here: Path, override: str, words: tuple[str, ...]) -> None:
    call(*PACKING, override).must_refuse(*words)
    assert not list(here.iterdir())
