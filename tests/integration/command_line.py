"""Runs the commands as a user does: in this process, which is fast, or in one of their own."""

import contextlib
import io
import os
import runpy
import subprocess
import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from unittest import mock

import apf.commands.label  # what commands import when there is work is there before a test traps imports
import apf.commands.plan
import apf.commands.predict
import apf.commands.relabel
import apf.commands.run
import apf.evaluate
import apf.main
import apf.relabel

REPOSITORY = Path(__file__).parents[2]
CONF = REPOSITORY / "conf"
ANALYSIS = REPOSITORY / "analysis"


def started(name: str) -> Callable[[], None]:
    """The command in a file that nobody imports: after an import, it would hide the function of `apf` of that name."""
    main: Callable[[], None] = runpy.run_module(name, run_name="started")["main"]
    return main


MAINS = {
    "apf.main": apf.main.main,
    "apf.evaluate": apf.evaluate.main,
    "apf.label": started("apf.label"),
    "apf.plan": started("apf.plan"),
    "apf.predict": started("apf.predict"),
    "apf.relabel": apf.relabel.main,
    "apf.panda.show": lambda: import_module("apf.panda.show").main(),
    "apf.panda.sheets": lambda: import_module("apf.panda.sheets").main(),
}

TINY = (
    "tracker=none",
    "plans=12",
    "initial.train=4",
    "initial.validation=4",
    "acquisition.plans=2",
    "acquisition.validation=1",
    "training.updates=3",
    "model.members=2",
    "model.network.hidden=8",
    "evaluation.every=1",
    "evaluation.problems=1",
    "evaluation.length=2",
    "evaluation.lengths=[2]",
    "evaluation.test_plans=4",
    "planner.candidates=64",
    "sampler.candidates.n=50",
)
"""Eight initial towers, then two acquisitions of two, evaluated after each, in about a second."""

SMOKE = (
    "+experiment=smoke",
    "tracker=none",
    "training.updates=10",
    "evaluation.problems=2",
    "evaluation.test_plans=20",
    "sampler.candidates.n=1000",
)
"""The smoke preset, made a little smaller: 12 + 8 initial towers and two acquisitions of 10, all evaluated."""


@dataclass(frozen=True)
class Result:
    """How a command ended: exit code, standard output, standard error."""

    code: int
    out: str
    err: str

    def must_work(self) -> "Result":
        """Itself; fails, showing all that was printed, unless the exit code is 0."""
        assert self.code == 0, f"exit code {self.code}\n{self.out}\n{self.err}"
        return self

    def must_refuse(self, *words: str) -> str:
        """The one line that a failed command ended with; fails unless it is one line, and holds the words."""
        assert self.code != 0, f"was accepted\n{self.out}\n{self.err}"
        assert "Traceback" not in self.err, self.err
        lines = self.err.strip().splitlines()
        assert len(lines) == 1, self.err
        assert lines[0].startswith("error: "), self.err
        for word in words:
            assert word in lines[0], f"{word!r} is not named: {lines[0]}"
        return lines[0]


def call(*arguments: str, command: str = "apf.main") -> Result:
    """The command in this process, in the current directory. A crash becomes a traceback and exit code 1."""
    out, err = io.StringIO(), io.StringIO()
    code = 0
    with (
        mock.patch.object(sys, "argv", [command, *arguments]),
        mock.patch.dict(os.environ),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            MAINS[command]()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
            if isinstance(end.code, str):
                print(end.code, file=sys.stderr)
        except Exception:
            traceback.print_exc()
            code = 1
    return Result(code, out.getvalue(), err.getvalue())


def spawn(arguments: Sequence[str | Path], cwd: Path, **environment: str) -> Result:
    """`python ARGUMENTS` in a process of its own, with these variables added to its environment."""
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=cwd,
        env=child_environment(**environment),
        capture_output=True,
        text=True,
        timeout=300,
    )
    return Result(done.returncode, done.stdout, done.stderr)


def child_environment(**environment: str) -> dict[str, str]:
    """This process's environment for a child, less what would change how the commands behave."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("HYDRA_", "WANDB_"))}
    return kept | environment


def options(group: str) -> list[str]:
    """The options that conf/ holds of a group."""
    return sorted(path.stem for path in (CONF / group).glob("*.yaml"))
