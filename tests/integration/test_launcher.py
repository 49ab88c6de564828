"""Sweeps on this machine: a process for each run; none that dies takes others along, and none outlives the sweep."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from apf.launch.sweep import explain
from integration.command_line import TINY, call, child_environment, spawn

WORLD = """
import os, signal, time
from apf.settings import settings
from apf.towers import AnalyticWorld


@settings
class Crashing(AnalyticWorld):
    how: str

    def execute(self, plans, rng):
        if os.path.exists("healed"):
            pass
        elif self.how == "segfault":
            os.kill(os.getpid(), signal.SIGSEGV)
        elif self.how == "exit":
            os._exit(3)
        elif self.how == "slow":
            time.sleep(60)
        return super().execute(plans, rng)
"""


@pytest.fixture
def crashing(tmp_path: Path) -> tuple[str, ...]:
    """Overrides for a world that crashes, from a folder of its own; `world.how` says how."""
    (tmp_path / "conf" / "world").mkdir(parents=True)
    (tmp_path / "conf" / "world" / "crashing.yaml").write_text("_target_: crashing.Crashing\nhow: none\n")
    (tmp_path / "crashing.py").write_text(WORLD)
    return ("-m", "apf.main", "-m", *TINY, "hydra.searchpath=[file://conf]", "world=crashing", "sweep=mine")


def path(tmp_path: Path) -> str:
    return os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])


def states(tmp_path: Path) -> dict[str, bool]:
    """Which runs have finished, by how their world crashes."""
    runs = [run.parent for run in (tmp_path / "runs" / "mine").glob("*/run.yaml")]
    how = {run: yaml.safe_load((run / "config.yaml").read_text())["world"]["how"] for run in runs}
    return {how[run]: yaml.safe_load((run / "run.yaml").read_text())["finished"] for run in runs}


@pytest.mark.slow
def test_runs_that_die_take_no_others_along(tmp_path: Path, crashing: tuple[str, ...]) -> None:
    sweep = [*crashing, "world.how=segfault,exit,none", "hydra.launcher.jobs=1", "seed=0"]
    result = spawn([*sweep[:-1], "seed=0,-1"], cwd=tmp_path, PYTHONPATH=path(tmp_path))
    assert result.code == 1
    summary = result.err.strip().splitlines()[-7:]
    assert [line.split()[0] for line in summary] == ["failed"] * 4 + ["finished", "failed", "error:"]
    assert summary[0].endswith("killed by SIGSEGV")
    assert "seed is -1" in summary[1]
    assert summary[2].endswith("exit code 3")
    assert summary[-1].startswith("error: 5 of 6 runs did not finish; the same command again")
    assert "Traceback" not in result.err
    assert states(tmp_path) == {"segfault": False, "exit": False, "none": True}

    (tmp_path / "healed").touch()
    again = spawn(sweep, cwd=tmp_path, PYTHONPATH=path(tmp_path)).must_work()
    words = [line.split()[:2] for line in again.err.strip().splitlines()[-3:]]
    assert [first for first, _ in words] == ["finished", "finished", "already"]
    assert states(tmp_path) == {"segfault": True, "exit": True, "none": True}


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_runs_end_with_their_sweep(tmp_path: Path, crashing: tuple[str, ...], number: int) -> None:
    command = [sys.executable, *crashing, "world.how=slow", "seed=0,1", "hydra.launcher.jobs=1"]
    with subprocess.Popen(
        command, cwd=tmp_path, env=child_environment(PYTHONPATH=path(tmp_path)), stderr=subprocess.PIPE, text=True
    ) as process:
        logs: list[Path] = []
        while not logs:
            logs = list((tmp_path / "runs").glob("mine/*/run.log"))
            time.sleep(0.05)
        time.sleep(0.3)
        process.send_signal(number)
        _, said = process.communicate(timeout=30)
    assert process.returncode == (143 if number == signal.SIGTERM else -number)
    if number == signal.SIGTERM:
        assert said.strip().splitlines()[-1] == "interrupted; the same command again does what is missing"
    until = time.monotonic() + 10
    while "interrupted" not in logs[0].read_text():
        assert time.monotonic() < until, "the run goes on without its sweep"
        time.sleep(0.1)


def test_what_is_the_same_run_runs_once(here: Path) -> None:
    result = call("-m", *TINY, "threads=1,2", "seed=-1")
    assert result.err.splitlines()[-1].startswith("error: 1 of 1 runs did not finish")


@pytest.mark.parametrize("jobs", ["0", "-1", "some"])
def test_a_wrong_number_of_jobs(here: Path, jobs: str) -> None:
    call("-m", *TINY, "seed=0,1", f"hydra.launcher.jobs={jobs}").must_refuse("hydra.launcher.jobs", jobs, "auto")
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("launcher", ["slurm", "slurm_local"])
def test_a_launcher_that_is_not_installed(here: Path, launcher: str) -> None:
    try:
        import hydra_plugins.hydra_submitit_launcher  # noqa: F401
    except ImportError:
        call("-m", *TINY, "seed=0,1", f"hydra/launcher={launcher}").must_refuse("pip install 'apf[slurm]'")
        assert list(here.iterdir()) == []
    else:
        pytest.skip("it is installed")


@pytest.mark.parametrize(
    ("code", "said", "reason", "traced"),
    [
        (0, "all went well", "", False),
        (1, "step 1\nerror: seed is -1", "seed is -1", False),
        (-11, "Fatal Python error: Segmentation fault\nframes", "killed by SIGSEGV", True),
        (-9, "step 1", "killed by SIGKILL", False),
        (3, "step 1", "exit code 3", False),
        (143, "step 1\ninterrupted; go on with: ...", "interrupted", False),
        (1, "Traceback (most recent call last):\n  a line\nValueError: no", "exit code 1: ValueError: no", True),
    ],
)
def test_why_a_process_failed(code: int, said: str, reason: str, traced: bool) -> None:
    line, trace = explain(code, said)
    assert line == reason
    assert bool(trace) is traced
