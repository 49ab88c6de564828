"""Runs that many tests look at, made once, and shared by all workers of pytest-xdist."""

import fcntl
import json
import os
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import pytest
import torch

from integration.command_line import SMOKE, TINY, Result, call, spawn


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Callable[[Path], Result]], tuple[Path, Result]]:
    """`once(name, make)`: a folder that `make(folder)` filled, by whichever worker came first, and what it returned."""
    base = tmp_path_factory.getbasetemp()
    root = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def get(name: str, make: Callable[[Path], Result]) -> tuple[Path, Result]:
        folder, note = root / name, root / f"{name}.json"
        with (root / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not note.exists():
                folder.mkdir()
                note.write_text(json.dumps(asdict(make(folder))))
        return folder, Result(**json.loads(note.read_text()))

    return get


@pytest.fixture(scope="session")
def smoke(once: Callable) -> tuple[Path, Result]:
    """A run of the smoke preset in a process and a directory of its own, and what it printed."""
    folder, result = once(
        "smoke", lambda folder: spawn(["-m", "apf.main", *SMOKE, f"hydra.run.dir={folder / 'run'}"], cwd=folder)
    )
    result.must_work()
    return folder / "run", result


@pytest.fixture(scope="session")
def tiny_run(once: Callable) -> Path:
    """The directory of a tiny run in the analytic world."""

    def make(folder: Path) -> Result:
        return call(*TINY, "world=analytic", f"hydra.run.dir={folder / 'run'}")

    folder, result = once("tiny", make)
    result.must_work()
    return folder / "run"


SWEEP = (
    "-m",
    *TINY,
    "sampler=sequential,random_ss",
    "seed=range(2)",
    "sweep=mine",
    "evaluation.problems=3",
    "evaluation.lengths=[2,3]",
    "evaluation.test_plans=20",
    "planner.candidates=256",
)


@pytest.fixture(scope="session")
def sweep(once: Callable) -> Path:
    """The folder in which a sweep ran: two samplers, two seeds; its runs lie in runs/mine."""
    folder, result = once("sweep", lambda folder: spawn(["-m", "apf.main", *SWEEP], cwd=folder))
    result.must_work()
    return folder


@pytest.fixture(scope="session", autouse=True)
def one_thread() -> None:
    """As a run would have it by itself: threads that wait for each other take the processor from all workers."""
    torch.set_num_threads(1)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that is the current directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
