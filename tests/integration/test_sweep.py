"""A sweep: one run for each combination, in one folder; the same command again does only what is missing."""

import re
import shutil
from pathlib import Path

import pandas as pd
import pytest
import yaml

from integration.command_line import TINY, call
from integration.conftest import SWEEP


def runs_of(folder: Path) -> list[Path]:
    return sorted(path for path in (folder / "runs" / "mine").iterdir() if path.is_dir())


@pytest.mark.slow
def test_a_sweep_makes_a_run_for_each_combination(sweep: Path) -> None:
    runs = runs_of(sweep)
    names = [re.fullmatch(r"(\w+)-tgn-noisy-seed(\d)-[0-9a-f]{8}", run.name) for run in runs]
    assert all(names), runs
    assert [name.groups() for name in names if name] == [
        (sampler, seed) for sampler in ("random_ss", "sequential") for seed in "01"
    ]
    for run, name in zip(runs, names):
        state = yaml.safe_load((run / "run.yaml").read_text())
        config = yaml.safe_load((run / "config.yaml").read_text())
        assert state["finished"]
        assert state["choices"]["sampler"] == name.group(1)
        assert config["seed"] == int(name.group(2))
        assert set(pd.read_parquet(run / "regret.parquet")["plans"]) == {10, 12}
        assert run.name.endswith(state["hash"])
    assert len({(run / "plans.parquet").read_bytes() for run in runs}) == 4


@pytest.mark.slow
def test_the_same_sweep_again_does_only_what_is_missing(sweep: Path, here: Path) -> None:
    shutil.copytree(sweep, here, dirs_exist_ok=True)
    first, missing, *rest = runs_of(here)
    tables = {name: pd.read_parquet(missing / f"{name}.parquet") for name in ("plans", "regret", "accuracy")}
    before = {path: path.stat().st_mtime_ns for run in (first, *rest) for path in run.rglob("*") if path.is_file()}
    shutil.rmtree(missing)
    result = call(*SWEEP).must_work()
    said = [line for line in result.err.splitlines() if line.startswith("already finished")]
    assert len(said) == 3
    assert not any(missing.name in line for line in said)
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert runs_of(here) == [first, missing, *rest]
    for name, table in tables.items():
        pd.testing.assert_frame_equal(table, pd.read_parquet(missing / f"{name}.parquet"), check_exact=True)


@pytest.mark.slow
def test_a_run_of_a_sweep_is_the_run_alone(sweep: Path, here: Path) -> None:
    """Jobs that share a process do not touch each other."""
    (last,) = [run for run in runs_of(sweep) if run.name.startswith("sequential-tgn-noisy-seed1")]
    overrides = [word for word in SWEEP if not word.startswith(("-m", "sampler=", "seed="))]
    call(*overrides, "sampler=sequential", "seed=1", f"hydra.run.dir={last.name}").must_work()
    for name in ("plans", "regret", "accuracy"):
        tables = [pd.read_parquet(run / f"{name}.parquet") for run in (last, here / last.name)]
        pd.testing.assert_frame_equal(*tables, check_exact=True)


@pytest.mark.slow
@pytest.mark.usefixtures("no_figures")
def test_the_name_of_a_run_tells_configs_apart(here: Path) -> None:
    """What changes the results changes the hash in the name; what does not, does not."""
    basic = "hydra/launcher=basic"
    call(
        "-m", *TINY, basic, "world=analytic", "world@evaluation.worlds.noisy=analytic,noisy", "training.batch=4,8"
    ).must_work()
    basic = "hydra/launcher=basic"
    call(
        "-m", *TINY, basic, "world=analytic", "world@evaluation.worlds.noisy=noisy", "training.batch=8", "threads=2"
    ).must_work()
    names = [path.name for path in (here / "runs" / "sweep").iterdir() if path.is_dir()]
    assert len(names) == 4
    assert {name.rpartition("-")[0] for name in names} == {"sequential-tgn-analytic-seed0"}


@pytest.mark.usefixtures("no_figures")
def test_a_crash_of_one_job_does_not_cost_the_others(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hydra's basic launcher: the first of two jobs crashes, the second still runs, the command says what failed."""
    from apf.experiment import Experiment

    learn = Experiment.learn

    def crashing(self: Experiment, step: int) -> None:
        if self.seed == 0:
            raise RuntimeError("the power is out")
        learn(self, step)

    monkeypatch.setattr(Experiment, "learn", crashing)
    result = call("-m", *TINY, "hydra/launcher=basic", "seed=0,1")
    assert result.code != 0
    assert "the power is out" in result.err
    finished = {
        path.parent.name.split("-")[3]: yaml.safe_load(path.read_text())["finished"] for path in here.rglob("run.yaml")
    }
    assert finished == {"seed0": False, "seed1": True}
