"""What a person sees: progress on a pseudo-terminal, plain lines elsewhere."""

import os
import pty
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from apf.tracking import console
from integration.command_line import TINY, call, child_environment


def screen(arguments: list[str], cwd: Path) -> list[str]:
    """The lines that a command printed on a terminal of 80 columns, without colours; it must work."""
    ours, theirs = pty.openpty()
    environment = child_environment(TERM="xterm", COLUMNS="80", LINES="24")
    with subprocess.Popen(
        [sys.executable, *arguments], cwd=cwd, env=environment, stdin=theirs, stdout=theirs, stderr=theirs
    ) as process:
        os.close(theirs)
        said = b""
        try:
            while chunk := os.read(ours, 65536):
                said += chunk
        except OSError:  # Linux's way to say that all who could write are gone
            pass
        os.close(ours)
    text = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "\n", said.decode())
    assert process.returncode == 0, text
    return [line for line in re.split(r"[\r\n]+", text) if line.strip()]


@pytest.mark.slow
def test_a_run_on_a_terminal(tmp_path: Path) -> None:
    """Each kind of work by its name; no step but a number; how long it took is not taken for how long it takes."""
    lines = screen(["-m", "apf.main", *TINY, "evaluation.problems=400", "hydra.run.dir='a[b]'"], tmp_path)
    joined = " ".join(lines)
    assert re.search(r"step \d/2, planning \d+/400", joined)
    assert re.search(r"\d:\d\d so far, (about|more than) \d:\d\d left", joined)
    assert "writing tables and figures" in joined
    assert "None" not in joined
    assert re.match(r"a\[b\] in /", lines[0])
    assert len([line for line in lines if line.startswith("step 2, 12 plans, regret: ")]) == 1


@pytest.mark.slow
def test_a_sweep_on_a_terminal(tmp_path: Path) -> None:
    command = ["-m", "apf.main", "-m", *TINY, "evaluation.problems=40", "seed=0,1", "hydra.launcher.jobs=1"]
    joined = " ".join(screen(command, tmp_path))
    assert re.search(r"0 of 2 runs done", joined)
    assert re.search(r"1 of 2 runs done\W*, \d:\d\d so far, about \d:\d\d left", joined)
    for seed in "01":
        assert re.search(rf"sequential-tgn-noisy-seed{seed}\S*  step \d/2, [a-z]", joined), joined
    assert re.search(r"\[1/2\] sequential-tgn-noisy-seed\S+ finished, \d+ s; about \d:\d\d left", joined)


@pytest.mark.usefixtures("no_figures")
def test_lines_elsewhere(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a log, too, it is said now and then how long it still takes."""
    monkeypatch.setattr(console, "EVERY", -1)
    result = call(*TINY, "hydra.run.dir=run").must_work()
    lines = [line for line in result.err.splitlines() if " so far" in line]
    for what in ("step 0/2, first plans 3/8", "step 1/2, building 2/2", "step 1/2, planning", "step 2/2, training"):
        assert any(line.startswith(f"{what}: 0:0") for line in lines), what
    assert lines[-1] in (here / "run" / "run.log").read_text()
    monkeypatch.undo()
    monkeypatch.chdir(here)
    assert " so far" not in call(*TINY, "hydra.run.dir=other").must_work().err, "not more than once a minute"


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize(
    "overrides", [(), ("sampler=random_ss",), ("evaluation.every=3", "evaluation.problems=0"), ("predictor=analytic",)]
)
def test_the_plan_is_what_is_done(here: Path, monkeypatch: pytest.MonkeyPatch, overrides: tuple[str, ...]) -> None:
    """All kinds of work that were foretold, so many times, also after an interruption."""
    planned: list[Counter[str]] = []
    begun: Counter[str] = Counter()

    def plan(self: Any, steps: int, work: Any) -> None:
        planned.append(Counter(work))

    def begin(self: Any, step: int, kind: str, number: int = 1, of: int = 1) -> None:
        begun[kind] += 1
        if len(planned) == 1 and kind == "training" and step == 1:
            begun[kind] -= 1
            raise KeyboardInterrupt

    monkeypatch.setattr(console.ConsoleTracker, "plan", plan)
    monkeypatch.setattr(console.ConsoleTracker, "begin", begin)
    command = (*TINY, *overrides, "hydra.run.dir=run")
    if "predictor=analytic" not in overrides:
        assert call(*command).code == 130
    before = Counter(begun)
    call(*command).must_work()
    del begun["writing tables and figures"]
    assert +planned[-1] == begun - before
    if len(planned) > 1:
        assert +planned[0] == +begun
