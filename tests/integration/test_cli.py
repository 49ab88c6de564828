"""The two commands as a user meets them: progress, summary, help, and the same command once more."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from hydra import compose, initialize_config_dir

from apf.config.values import config_dir
from apf.models import Ensemble
from integration.command_line import CONF, SMOKE, TINY, Result, call, child_environment, options, spawn


def snapshot(directory: Path) -> dict[str, tuple[int, int]]:
    """Size and time of change of every file."""
    files = (path for path in sorted(directory.rglob("*")) if path.is_file())
    return {str(path.relative_to(directory)): (path.stat().st_size, path.stat().st_mtime_ns) for path in files}


@pytest.mark.slow
def test_a_run_shows_each_step_as_lines(smoke: tuple[Path, Result]) -> None:
    lines = smoke[1].err.splitlines()
    topics = [
        match.groups() for line in lines if (match := re.match(r"step (\d+), (\d+) plans, (\w+): [\w/]+ \S", line))
    ]
    evaluated = ["data", "score", "loss", "regret", "success", "predicted", "accuracy", "auc", "nll", "ece"]
    assert topics == [
        *(("0", "20", topic) for topic in ("data", "loss")),
        *(("1", "30", topic) for topic in evaluated),
        *(("2", "40", topic) for topic in evaluated),
    ]
    assert not any("\x1b" in line or "\r" in line for line in lines), "no control characters without a terminal"


@pytest.mark.slow
def test_a_run_ends_with_a_summary(smoke: tuple[Path, Result]) -> None:
    directory, result = smoke
    summary = result.err[result.err.index("40 labelled plans") :]
    assert re.match(r"40 labelled plans in (\d+ min )?\d+ s\n", summary)
    assert "median regret" in summary
    for word in ("tallest", "overhang", "unsupported", "accuracy", "AUC", "NLL", "ECE"):
        assert word in summary
    assert summary.rstrip().splitlines()[-1] == str(directory)


@pytest.mark.slow
def test_the_same_command_again_returns_at_once(smoke: tuple[Path, Result], monkeypatch: pytest.MonkeyPatch) -> None:
    directory, _ = smoke
    before = snapshot(directory)
    monkeypatch.setattr(Ensemble, "fit", None)  # any training would crash
    result = call(*SMOKE, f"hydra.run.dir={directory}").must_work()
    assert result.err == f"{directory} holds this run already, finished\n"
    assert snapshot(directory) == before


@pytest.mark.slow
def test_what_does_not_change_the_results_may_differ(smoke: tuple[Path, Result]) -> None:
    directory, _ = smoke
    result = call(*SMOKE, f"hydra.run.dir={directory}", "tracker=wandb", "threads=2", "device=cpu", "sweep=x")
    assert "finished" in result.must_work().err


@pytest.mark.slow
def test_another_config_in_the_same_directory_is_refused(smoke: tuple[Path, Result]) -> None:
    directory, _ = smoke
    before = snapshot(directory)
    overrides = ("seed=7", "world.noise=0.004", "model.network.hidden=32", "threads=2")
    line = call(*SMOKE, *overrides, f"hydra.run.dir={directory}").must_refuse(str(directory))
    assert line.endswith("these keys differ: model.network.hidden, seed, world.noise")
    assert snapshot(directory) == before


@pytest.mark.slow
def test_another_option_of_a_group_is_refused_too(smoke: tuple[Path, Result]) -> None:
    directory, _ = smoke
    call(*SMOKE, "world=analytic", f"hydra.run.dir={directory}").must_refuse("world._target_", "world.noise")


@pytest.mark.usefixtures("no_figures")
def test_without_a_directory_a_run_gets_one_named_by_what_it_is(here: Path) -> None:
    call(*TINY, "seed=3", "sampler=random_ss", "world=analytic").must_work()
    (config,) = here.rglob("config.yaml")
    date, name = config.parent.relative_to(here / "runs").parts
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", date)
    assert re.fullmatch(r"\d\d-\d\d-\d\d-random_ss-tgn-analytic-seed3-[0-9a-f]{8}", name)


def test_the_defaults_are_those_of_the_paper() -> None:
    with initialize_config_dir(config_dir(), version_base="1.3"):
        cfg = compose("config")
    assert (cfg.plans, cfg.initial.train, cfg.initial.validation) == (400, 40, 40)
    assert (cfg.acquisition.plans, cfg.acquisition.validation) == (10, 2)
    assert cfg.model._target_ == "apf.models.EnsembleSettings"
    assert cfg.model.members == 10
    assert cfg.model.network._target_ == "apf.models.TGN"
    assert cfg.model.network.hidden == 64
    assert cfg.sampler.score._target_ == "apf.acquisition.ExpectedBald"
    assert cfg.sampler.candidates.n == 10_000
    assert cfg.world._target_ == "apf.towers.NoisyWorld"
    assert cfg.world.noise == 0.003
    targets = {name: world["_target_"] for name, world in cfg.evaluation.worlds.items()}
    assert targets == {"analytic": "apf.towers.AnalyticWorld", "noisy": "apf.towers.NoisyWorld"}
    assert list(cfg.task) == ["tallest", "overhang", "unsupported"]
    assert (cfg.evaluation.every, cfg.evaluation.problems, cfg.evaluation.length) == (100, 50, 5)
    assert cfg.planner.candidates == 100_000
    assert cfg.tracker.wandb.mode == "offline"


def test_help_reads_like_a_page() -> None:
    page = call("--help").must_work().out
    assert "Usage" in page
    assert "python -m apf.main" in page
    assert "+experiment=smoke" in page
    assert "hydra.run.dir=" in page
    assert "_target_" not in page
    assert "${" not in page
    assert "$" not in page


@pytest.mark.parametrize(
    "group", sorted(path.name for path in CONF.iterdir() if path.is_dir() and path.name not in ("hydra", "experiment"))
)
def test_help_lists_every_option(group: str) -> None:
    page = call("--help").must_work().out
    (line,) = [line for line in page.splitlines() if line.strip().startswith(f"{group}:")]
    assert set(options(group)) == {option.strip() for option in line.partition(":")[2].split(",")}


def test_help_of_the_label_command(here: Path) -> None:
    page = call("--help", command="apf.label").must_work().out
    assert "Usage" in page
    assert "python -m apf.label plans=FILE out=FILE" in page
    for word in ("tower, position, block", "tower, position, label", "world", "noisy", "seed"):
        assert word in page
    assert list(here.iterdir()) == []


@pytest.mark.slow
def test_help_in_a_process_of_its_own(tmp_path: Path) -> None:
    result = spawn(["-m", "apf.main", "--help"], cwd=tmp_path).must_work()
    assert "python -m apf.main" in result.out
    assert result.err == ""
    assert list(tmp_path.iterdir()) == []


def test_cfg_job_shows_what_would_run(here: Path) -> None:
    result = call("--cfg", "job", "+experiment=smoke", "sampler=greedy", "seed=5").must_work()
    shown = yaml.safe_load(result.out)
    assert shown["seed"] == 5
    assert shown["plans"] == 40
    assert shown["sampler"]["candidates"]["_target_"] == "apf.acquisition.GreedyExtensions"
    assert list(here.iterdir()) == []


def test_cfg_job_of_the_label_command(here: Path) -> None:
    result = call("--cfg", "job", "plans=a.csv", "out=b.csv", "world=noisy", command="apf.label").must_work()
    shown = yaml.safe_load(result.out)
    assert shown["plans"] == "a.csv"
    assert shown["world"]["noise"] == 0.003
    assert list(here.iterdir()) == []


def test_a_reader_that_goes_away_is_no_error(tmp_path: Path) -> None:
    """As in `python -m apf.label --help | head -1`: the pipe is closed before anything is printed."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "apf.label", "--help"]
    process = subprocess.run(command, cwd=tmp_path, env=child_environment(), stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    assert process.stderr == b""
    assert process.returncode == 1
