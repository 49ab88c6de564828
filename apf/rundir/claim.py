"""Locks a directory for one run and one process at a time, and protects the user's files there."""

import contextlib
import os
import re
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import portalocker

from apf.errors import InputError
from apf.rundir.files import make_folder, read_yaml, sync_path_to
from apf.rundir.journal import BEGINS

if TYPE_CHECKING:
    from apf.domain import Domain

CONFIG, STATE, JOURNAL, LOCK, LOG = "config.yaml", "run.yaml", "journal.jsonl", "lock", "run.log"
CHOSEN_TABLE = "evaluation_plans.parquet"
"""The table of the plans that evaluations chose."""
TABLES = ("plans.parquet", "regret.parquet", "accuracy.parquet", CHOSEN_TABLE)
WORLD_TABLE = "world.parquet"
"""The table of the world's reports, if the world reports anything."""
LOGS = "logs"
"""The folder of the world's logs of plans, if the world writes any."""
FIRST = (STATE, JOURNAL, CONFIG)
"""Files that a run writes first, after the objects of its domain's plans."""
LATER = (
    LOG,
    "metrics.csv",
    *TABLES,
    WORLD_TABLE,
    "weights/step_*.safetensors",
    "figures/regret.*",
    "figures/accuracy.*",
    f"{LOGS}/*",
)
"""Files that a run writes later."""
HOLDER = re.compile(r"process \d+ on \S+")
"""Content of a lock file."""


@dataclass(frozen=True)
class Claim:
    """A directory that this process has locked. before: names of the files and folders that were there before."""

    directory: Path
    before: frozenset[str]

    def abandon(self, domain: "Domain") -> None:
        """Remove what this process made for a run that ended before its first record. All other files stay."""
        if JOURNAL not in self.before and not is_new(self.directory):
            return
        for name in (*FIRST[::-1], *domain.object_files, LOG, LOCK):
            if name not in self.before:
                (self.directory / name).unlink(missing_ok=True)
        if "weights" not in self.before:
            with contextlib.suppress(OSError):
                (self.directory / "weights").rmdir()


@contextlib.contextmanager
def locked(directory: Path) -> Iterator[Claim]:
    """Hold a run directory while this process lives; the system frees it, however the process ends.

    Raises InputError if another process holds it, or nothing can be written there.
    """
    try:
        make_folder(directory)
        sync_path_to(directory)
        was_there = os.path.lexists(directory / LOCK)
        lock = _hold(directory)
        before = frozenset(path.name for path in directory.iterdir() if path.name != LOCK or was_there)
    except OSError as error:
        raise InputError(f"{directory}: cannot be written: {error.strerror}") from None
    with lock:
        yield Claim(directory, before)


def _hold(directory: Path) -> TextIO:
    """The lock, held until it is closed, and saying so."""
    path = directory / LOCK
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise InputError(f"{path} is not a file of its own; a run locks it: remove it, or choose another hydra.run.dir")
    new = not path.exists()
    lock = os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666), "r+")
    try:
        portalocker.lock(lock, portalocker.LockFlags.EXCLUSIVE | portalocker.LockFlags.NON_BLOCKING)
    except portalocker.exceptions.AlreadyLocked:
        raise InputError(f"{directory}: {_holder(lock)} works in it; wait for it, or stop it, and try again") from None
    except portalocker.LockException as error:
        lock.close()
        raise InputError(f"{path}: cannot be locked: {error}; a run needs a file system with working locks") from None
    if not path.exists() or not os.path.samestat(os.fstat(lock.fileno()), path.stat()):
        lock.close()  # of a run that was abandoned, and took its lock away, before this process held it
        return _hold(directory)
    with contextlib.suppress(OSError):
        if new or (directory / STATE).exists() or _is_note(lock):  # an empty file may be the user's
            lock.seek(0)
            lock.truncate()
            lock.write(f"process {os.getpid()} on {socket.gethostname()}")
            lock.flush()
    return lock


def _holder(lock: TextIO) -> str:
    """Who holds the lock, as its file says."""
    with lock, contextlib.suppress(OSError, UnicodeDecodeError):
        return lock.read().strip() or "another process"
    return "another process"


def _is_note(lock: TextIO) -> bool:
    with contextlib.suppress(UnicodeDecodeError):
        return HOLDER.fullmatch(lock.read()) is not None
    return False


def is_new(directory: Path) -> bool:
    """Has nothing been recorded yet?"""
    try:
        with (directory / JOURNAL).open("rb") as journal:
            journal.readline()  # what it is, and of which run
            return not journal.read(1)
    except FileNotFoundError:
        return True


def refuse_foreign(directory: Path, domain: "Domain", identity: str) -> None:
    """Raises InputError, naming the file, if a new run would overwrite something in a directory that holds no run.

    What an earlier start of the same run wrote before it was killed is no such thing.

    Args:
        directory: Where the run is to be.
        domain: Of the run.
        identity: What `run.yaml` has as `hash`.
    """
    names = (LOCK, *domain.object_files, *FIRST, *LATER)
    for path in sorted({path for name in names for path in _glob(directory, name)}):
        if not _is_of_a_start(path, domain, identity):
            raise InputError(
                f"{path} is there already, and a run would overwrite it; move it, or choose another hydra.run.dir"
            )


def _glob(directory: Path, name: str) -> list[Path]:
    path = directory / name
    return sorted(directory.glob(name)) if "*" in name else [path] * os.path.lexists(path)


def _is_of_a_start(path: Path, domain: "Domain", identity: str) -> bool:
    """Is this what a start of the run writes, and replaces if it starts again?"""
    if path.is_symlink() or not path.is_file():
        return False
    if path.name in domain.object_files:
        return domain.is_kept(path)
    try:
        text = path.read_text()
        if path.name == LOCK:
            return not text or HOLDER.fullmatch(text) is not None
        if path.name == STATE:
            state = read_yaml(path)
            return state.get("hash") == identity and {"id", "versions", "finished"} <= state.keys()
        return path.name == JOURNAL and text.startswith(BEGINS) and is_new(path.parent)
    except (OSError, UnicodeDecodeError, InputError):
        return False
