"""Runs as forked processes, which import nothing again, and tell their phases: for injecting faults."""

import faulthandler
import os
import select
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib.pyplot  # noqa: F401  imported when a run draws, and here once for all
import seaborn  # noqa: F401

import apf.commands.run
import apf.main
from apf.experiment import Experiment
from apf.rundir.store import Store

PHASES = ("starting", "choosing", "building", "training", "evaluating", "writing tables", "drawing, finishing")
LABEL = "label"
"""What a run says each time that a label is on the disk."""


def nothing() -> None:
    """Plants no fault."""


@dataclass
class Run:
    """`python -m apf.main ARGUMENTS` in a fork of this process. plant: called in the fork first, to inject a fault."""

    arguments: Sequence[str]
    cwd: Path
    plant: Callable[[], None] = nothing
    code: int | None = None
    heard: list[tuple[float, str]] = field(default_factory=list)
    """(seconds since the start, phase that began or label)."""
    said: str = ""
    """What it wrote to its standard error."""

    def __post_init__(self) -> None:
        self.pipe, end = os.pipe()
        self.errors, error_end = os.pipe()
        self.started = time.monotonic()
        self.pid = os.fork()
        if self.pid == 0:
            _child(self.arguments, self.cwd, self.plant, end, error_end)
        os.close(end)
        os.close(error_end)

    @property
    def labels(self) -> int:
        """Labels of which the run said that they are on the disk."""
        return sum(what == LABEL for _, what in self.heard)

    @property
    def phases(self) -> list[tuple[float, str]]:
        """(seconds, phase) of all that began."""
        return [(0.0, PHASES[0]), *((at, what) for at, what in self.heard if what != LABEL)]

    def listen(self, seconds: float) -> bool:
        """Hear what it says for a while; returns whether it is still there."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0:
            ready = select.select([self.pipe, self.errors], [], [], left)[0]
            if self.errors in ready:
                self.said += os.read(self.errors, 65536).decode(errors="replace")
            if self.pipe in ready:
                data = os.read(self.pipe, 65536)
                if not data:
                    return False
                now = time.monotonic() - self.started
                self.heard += [(now, what) for what in data.decode().splitlines()]
        return True

    def wait(self, limit: float = 120.0) -> int:
        """Let it end. Returns its exit code, negative for a signal."""
        self.listen(limit)
        return self._reap(limit)

    def kill(self, number: int = signal.SIGKILL) -> int:
        """Send a signal, and wait for the end."""
        os.kill(self.pid, number)
        return self._reap(30.0)

    def _reap(self, limit: float) -> int:
        until = time.monotonic() + limit
        while (done := os.waitpid(self.pid, os.WNOHANG))[0] == 0:
            if time.monotonic() > until:
                os.kill(self.pid, signal.SIGKILL)
            time.sleep(0.002)
        self.listen(0.001)
        while data := os.read(self.errors, 65536):
            self.said += data.decode(errors="replace")
        os.close(self.pipe)
        os.close(self.errors)
        self.code = os.waitstatus_to_exitcode(done[1])
        return self.code


def _child(arguments: Sequence[str], cwd: Path, plant: Callable[[], None], pipe: int, errors: int) -> None:
    code = 1
    try:
        faulthandler.disable()  # a test runner's
        os.chdir(cwd)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(errors, 2)
        sys.stdout, sys.stderr = (os.fdopen(stream, "w", buffering=1) for stream in (1, 2))
        sys.argv = ["apf.main", *arguments]
        _tell(pipe)
        plant()
        apf.main.main()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
        if isinstance(end.code, str):
            print(end.code, file=sys.stderr)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)


def _tell(pipe: int) -> None:
    """Make the run say which phase begins, and when a label is on the disk."""

    def say(owner: Any, name: str, before: str = "", after: str = "") -> None:
        original = getattr(owner, name)

        def saying(*args: Any, **kwargs: Any) -> Any:
            os.write(pipe, f"{before}\n".encode() if before else b"")
            result = original(*args, **kwargs)
            os.write(pipe, f"{after}\n".encode() if after else b"")
            return result

        setattr(owner, name, saying)

    for method, phase in zip(("choose", "execute", "learn", "evaluate"), PHASES[1:5], strict=True):
        say(Experiment, method, phase)
    say(Store, "export", PHASES[5])
    say(apf.commands.run, "save_figures", PHASES[6])
    say(Store, "record", after=LABEL)
