"""What a run returns to a sweeper: figures of its last evaluation, from its tables; failed runs return nothing."""

import math
import re
from pathlib import Path
from typing import Any, ClassVar

import pandas as pd
import pytest
import yaml
from hydra.core.utils import JobReturn, JobStatus

import apf.launch.sweep
from apf.errors import Stopped
from apf.experiment import Experiment
from apf.launch.sweep import Sweep
from apf.planning.objective import metrics_of, outcome, returned
from integration.command_line import TINY, call, spawn

OPTUNA = ("-m", "hydra/sweeper=optuna", "hydra.sweeper.n_jobs=1", "hydra.sweeper.sampler.seed=0")

REGRET = pd.DataFrame(
    [
        (1, 10, "tallest", "noisy", 0.9, 0.1, True),
        (2, 12, "tallest", "noisy", 0.5, 0.2, True),
        (2, 12, "tallest", "noisy", 0.75, 0.4, False),
        (2, 12, "tallest", "noisy", 1.0, 0.9, True),
        (2, 12, "overhang", "noisy", 0.25, math.nan, False),
        (2, 12, "tallest", "analytic", 0.75, 0.0, True),
    ],
    columns=["step", "plans", "task", "world", "chance", "regret", "feasible"],
)
ACCURACY = pd.DataFrame([(1, 10, 2, 0.5), (2, 12, 2, 0.75)], columns=["step", "plans", "length", "accuracy"])


def test_figures_of_an_evaluation() -> None:
    last = metrics_of(REGRET, ACCURACY)[2]
    assert last.pop("regret/noisy/overhang") != last.get("regret/noisy/overhang"), "NaN"
    assert last == {
        "regret/analytic/tallest": 0.0,
        "regret/noisy/tallest": 0.4,
        "success/analytic/tallest": 1.0,
        "success/noisy/tallest": pytest.approx(2 / 3),
        "success/noisy/overhang": 0.0,
        "predicted/tallest": 0.75,
        "predicted/overhang": 0.25,
        "accuracy/2": 0.75,
    }


def test_from_the_tables_of_a_run(tmp_path: Path) -> None:
    REGRET.to_parquet(tmp_path / "regret.parquet")
    ACCURACY.to_parquet(tmp_path / "accuracy.parquet")
    assert returned(tmp_path, (), 12) is None
    assert returned(tmp_path, ("regret/noisy/tallest",), 12) == 0.4
    assert returned(tmp_path, ("regret/noisy/tallest",), 11) == 0.1, "the run has gone on since"
    assert returned(tmp_path, ("accuracy/2", "regret/noisy/tallest"), 1000) == (0.75, 0.4)
    value = returned(tmp_path, ("regret/noisy/overhang",), 12)
    assert isinstance(value, float)
    assert math.isnan(value)


def test_what_a_sweeper_is_told(tmp_path: Path) -> None:
    done = outcome(["seed=1"], tmp_path, 0.5, None)
    assert (done.status, done.return_value, done.overrides) == (JobStatus.COMPLETED, 0.5, ["seed=1"])
    failed = outcome(["seed=1"], tmp_path, None, Stopped("it failed"))
    assert failed.status is JobStatus.FAILED
    with pytest.raises(Stopped, match="it failed"):
        _ = failed.return_value


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("again", [False, True])
def test_the_job_returns_it(here: Path, monkeypatch: pytest.MonkeyPatch, again: bool) -> None:
    """The task function itself, as Hydra's own launchers call it; at once, if the run has finished."""
    command = ("-m", *TINY, "hydra/launcher=basic", "seed=0,1", "sweep=mine")
    if again:
        call(*command).must_work()
        monkeypatch.setattr(Experiment, "run", None)
    values: list[Any] = []
    done = JobReturn.return_value.fset  # type: ignore[attr-defined]

    def note(self: JobReturn, value: Any) -> None:
        values.append(value)
        done(self, value)

    monkeypatch.setattr(JobReturn, "return_value", property(JobReturn.return_value.fget, note))  # type: ignore[attr-defined]
    call(*command, "objective=regret/noisy/tallest").must_work()
    tables = [pd.read_parquet(path) for path in sorted(here.glob("runs/mine/*/regret.parquet"))]
    assert values == [
        table.query("step == 2 and world == 'noisy' and task == 'tallest'")["regret"].median() for table in tables
    ]


@pytest.mark.parametrize(
    ("objective", "words"),
    [
        ("regret/noisy/talest", ("regret/noisy/talest", "regret/noisy/tallest", "accuracy/2")),
        ("accuracy/5", ("accuracy/5", "there are", "accuracy/2")),
        ("[accuracy/2,losses]", ("'losses'", "there are")),
        ("3", ("objective", "name of a metric", "3")),
        ("true", ("objective", "name of a metric")),
        ("{a: 1}", ("objective", "name of a metric")),
    ],
)
def test_a_figure_that_there_is_not(here: Path, objective: str, words: tuple[str, ...]) -> None:
    call(*TINY, f"objective={objective}").must_refuse(*words)
    assert list(here.iterdir()) == []


def test_where_nothing_is_evaluated(here: Path) -> None:
    nothing = ("evaluation.problems=0", "evaluation.test_plans=0")
    call(*TINY, *nothing, "objective=accuracy/2").must_refuse("accuracy/2", "there are: none")


@pytest.mark.usefixtures("no_figures")
def test_it_may_change(here: Path) -> None:
    """It says what is read of a run, not what the run computes."""
    call(*TINY, "hydra.run.dir=run").must_work()
    again = call(*TINY, "hydra.run.dir=run", "objective=accuracy/2").must_work()
    assert again.err.endswith("holds this run already, finished\n")


# -- Optuna ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def optuna() -> None:
    """Only with `pip install 'apf[optuna]'`, which the extra `test` includes."""
    pytest.importorskip("optuna")


@pytest.mark.slow
@pytest.mark.usefixtures("optuna")
def test_a_sweep_by_optuna(tmp_path: Path) -> None:
    """Three trials, each a run of its own; the same command again finds them all, and the same best one."""
    command = ["-m", "apf.main", *OPTUNA, *TINY, "hydra.sweeper.n_trials=3", "evaluation.test_plans=40"]
    command += ["training.learning_rate=tag(log,interval(1e-4,1e-1))", "hydra.sweeper.direction=maximize"]
    command += ["objective=accuracy/2", "sweep=best"]
    spawn(command, cwd=tmp_path).must_work()
    folder = tmp_path / "runs" / "best"
    runs = [path for path in folder.iterdir() if path.is_dir()]
    assert len(runs) == 3
    accuracy = {
        yaml.safe_load((run / "config.yaml").read_text())["training"]["learning_rate"]: pd.read_parquet(
            run / "accuracy.parquet"
        )["accuracy"].iloc[-1]
        for run in runs
    }
    best = yaml.safe_load((folder / "optimization_results.yaml").read_text())
    assert best["best_value"] == max(accuracy.values())
    assert accuracy[best["best_params"]["training.learning_rate"]] == best["best_value"]
    before = {path: path.stat().st_mtime_ns for run in runs for path in run.rglob("*")}
    again = spawn(command, cwd=tmp_path).must_work()
    assert again.err.count("already finished") == 3
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert yaml.safe_load((folder / "optimization_results.yaml").read_text()) == best


class FakeProcess:
    """A run that does not take a process: a failed one, or one whose tables say how far `training.warmup` is from 7."""

    fail: ClassVar[set[int]] = set()
    told: ClassVar[list[int]] = []

    @classmethod
    def run(cls, sweep: Sweep, job: apf.launch.sweep.Job, board: Any) -> tuple[apf.launch.sweep.Job, float, str]:
        board.started(job.directory.name)
        warmup = int(next(text for text in job.command if text.startswith("training.warmup=")).partition("=")[2])
        cls.told.append(warmup)
        if len(cls.told) - 1 in cls.fail:
            job.state, job.reason = "failed", "the power is out"
        else:
            job.directory.mkdir(parents=True, exist_ok=True)
            regret = math.nan if warmup == 0 else abs(warmup - 7)
            rows = [(2, 12, "tallest", "noisy", 0.9, regret, True)]
            pd.DataFrame(rows, columns=REGRET.columns).to_parquet(job.directory / "regret.parquet")
            ACCURACY.to_parquet(job.directory / "accuracy.parquet")
            job.state = "finished"
        return job, board.ended(job.directory.name), ""


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> type[FakeProcess]:
    monkeypatch.setattr(Sweep, "run_process", lambda sweep, job, board: FakeProcess.run(sweep, job, board))
    monkeypatch.setattr(FakeProcess, "fail", set())
    monkeypatch.setattr(FakeProcess, "told", [])
    return FakeProcess


@pytest.mark.usefixtures("optuna")
def test_optuna_learns_from_what_it_is_told(here: Path, fake: type[FakeProcess]) -> None:
    call(
        *OPTUNA, *TINY, "hydra.sweeper.n_trials=12", "training.warmup=range(1,20)", "objective=regret/noisy/tallest"
    ).must_work()
    best = yaml.safe_load((here / "runs" / "sweep" / "optimization_results.yaml").read_text())
    assert best["best_value"] == min(abs(warmup - 7) for warmup in fake.told)
    assert abs(best["best_params"]["training.warmup"] - 7) == best["best_value"]


@pytest.mark.usefixtures("optuna")
def test_a_failed_run_is_not_a_value(here: Path, fake: type[FakeProcess]) -> None:
    """Optuna goes on as far as `max_failure_rate` allows, and then says which did not finish."""
    fake.fail = {0, 1, 2}
    command = (*OPTUNA, *TINY, "training.warmup=range(1,20)", "objective=regret/noisy/tallest")
    command = (*command, "hydra.sweeper.n_trials=5")
    refused = call(*command)
    assert refused.code == 1
    assert refused.err.splitlines()[-1].startswith("error: 1 of 1 runs did not finish")
    assert ": the power is out" in refused.err
    assert "Traceback" not in refused.err
    assert len(fake.told) == 1
    call(*command, "hydra.sweeper.max_failure_rate=1").must_work()
    best = yaml.safe_load((here / "runs" / "sweep" / "optimization_results.yaml").read_text())
    assert best["best_value"] == min(abs(warmup - 7) for warmup in fake.told[3:])


@pytest.mark.usefixtures("optuna")
def test_a_value_that_is_no_number(here: Path, fake: type[FakeProcess]) -> None:
    command = (*OPTUNA, *TINY, "hydra.sweeper.n_trials=1", "training.warmup=choice(0)")
    result = call(*command, "objective=regret/noisy/tallest")
    assert result.code == 1
    assert "its objective is nan: no candidate of the problems succeeds" in result.err
    assert "Traceback" not in result.err


@pytest.mark.usefixtures("optuna")
def test_several_objectives(here: Path, fake: type[FakeProcess]) -> None:
    call(
        *(*OPTUNA, *TINY, "hydra.sweeper.n_trials=4", "training.warmup=range(1,20)"),
        *("objective=[regret/noisy/tallest,accuracy/2]", "hydra.sweeper.direction=[minimize,maximize]"),
    ).must_work()
    best = yaml.safe_load((here / "runs" / "sweep" / "optimization_results.yaml").read_text())
    least = min(abs(warmup - 7) for warmup in fake.told)
    assert {tuple(solution["values"]) for solution in best["solutions"]} == {(least, 0.75)}


@pytest.mark.usefixtures("optuna")
def test_optuna_needs_an_objective(here: Path) -> None:
    result = call(*OPTUNA, *TINY, "training.warmup=range(1,20)")
    assert result.err.splitlines()[-1].startswith("error: objective is null; hydra/sweeper=optuna needs one")
    assert list(here.iterdir()) == []


def test_hydra_s_own_sweeper_wants_none(here: Path, fake: type[FakeProcess]) -> None:
    """And a run that fails is told of once, in the line that says what to do."""
    call("-m", *TINY, "training.warmup=1,2", "hydra.launcher.jobs=1").must_work()
    fake.fail = {2}
    result = call("-m", *TINY, "training.warmup=3,4", "hydra.launcher.jobs=1", "objective=accuracy/2")
    assert result.err.splitlines()[-1].startswith("error: 1 of 2 runs did not finish; the same command again")
    assert "Error executing job" not in result.err
    assert len(re.findall(r"^finished +\S+: 0.75$", result.err, re.MULTILINE)) == 1
