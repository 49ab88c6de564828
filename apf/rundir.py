"""Whose a run directory is, who works in it, how it was started, and how to go on with it."""

import contextlib
import fcntl
import os
import re
import secrets
import shlex
import socket
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode

from apf.config import LENGTH, config_dir, config_hash, flatten, identity
from apf.errors import InputError, Stopped
from apf.files import checksum, read_yaml, write_yaml
from apf.interrupts import Interrupted
from apf.towers import TowerDomain

CONFIG, STATE, JOURNAL, LOCK = "config.yaml", "run.yaml", "journal.jsonl", "lock"
TABLES = ("towers.parquet", "regret.parquet", "accuracy.parquet")
WORLD_TABLE = "world.parquet"
"""What the world reported of each plan, if it reports anything."""
NOT_KEPT = ("hydra.mode", "hydra.run.", "hydra.sweep", "hydra/sweeper", "hydra.launcher", "hydra/launcher")
"""Hydra's own overrides that say where and how a run is started, not what it is."""


@contextlib.contextmanager
def locked(directory: Path) -> Iterator[None]:
    """Hold a run directory while this process lives; the system frees it, however the process ends.

    Raises InputError if another process holds it, or nothing can be written there.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        lock = (directory / LOCK).open("a+")
    except OSError as error:
        raise InputError(f"{directory}: cannot be written: {error.strerror}") from None
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.seek(0)
            holder = lock.read().strip() or "another process"
            raise InputError(f"{directory}: {holder} works in it; wait for it, or stop it, and try again") from None
        with contextlib.suppress(OSError):
            lock.truncate(0)
            lock.write(f"process {os.getpid()} on {socket.gethostname()}")
            lock.flush()
        yield


def check(directory: Path, config: dict[str, Any], domain: TowerDomain) -> bool:
    """Could this run be the one that the directory holds, if it holds one? Returns whether that has gone as far.

    Raises InputError, naming the keys that differ, if another run lives there, or if it goes on in another way.
    """
    if not (directory / CONFIG).exists():
        return False
    kept = read_yaml(directory / CONFIG)
    mine, theirs = (flatten(identity(c)) for c in (config, kept))
    differing = [key for key in sorted(mine.keys() | theirs.keys()) if mine.get(key) != theirs.get(key)]
    if differing:
        raise InputError(f"{directory} holds a run of another config; these keys differ: {', '.join(differing)}")
    domain.check_kept(directory)
    if not (directory / JOURNAL).exists():
        raise InputError(
            f"{directory / JOURNAL} is missing, and all labels with it; put it back, or remove {directory}"
        )
    done = finished(directory)
    if config[LENGTH] < kept[LENGTH] and not done:
        raise InputError(f"{directory} holds a run of {kept[LENGTH]} towers that has not finished; go on with as many")
    first, each = sum(kept["initial"].values()), kept["acquisition"]["towers"]
    if config[LENGTH] > kept[LENGTH] and (kept[LENGTH] - first) % each:
        raise InputError(
            f"{directory} holds a run of {kept[LENGTH]} towers, whose last acquisition had fewer than {each}: "
            "it cannot be made longer"
        )
    return done and config[LENGTH] <= kept[LENGTH]


def begin(directory: Path, config: dict[str, Any], domain: TowerDomain) -> None:
    """Make the (locked) directory this run's own, unless it is already; config.yaml, written last, says that it is."""
    if check(directory, config, domain):
        return
    if (directory / CONFIG).exists():
        lengthen(directory, config)
        return
    hydra = HydraConfig.get()
    in_sweep = hydra.mode == RunMode.MULTIRUN or directory.parent == Path(hydra.sweep.dir).absolute()
    choices = {key: value for key, value in hydra.runtime.choices.items() if "hydra/" not in key}
    state = {
        "name": directory.name,
        "id": secrets.token_hex(4),
        "hash": config_hash(config),
        "sweep": config["sweep"] if in_sweep else None,
        "choices": {**choices, "task": list(config["task"])},
        "overrides": list(hydra.overrides.task),
        "hydra": hydra_arguments(hydra),
        "cwd": str(Path.cwd()),
        "versions": {name: version(name) for name in ("apf", "torch", "torch-geometric", "numpy")},
        "finished": False,
        "seconds": 0.0,
    }
    try:
        domain.keep(directory)
        write_yaml(directory / STATE, state)
        (directory / JOURNAL).touch()
        write_yaml(directory / CONFIG, config)
    except OSError as error:
        raise InputError(f"{directory}: cannot be written: {error.strerror}") from None


def lengthen(directory: Path, config: dict[str, Any]) -> None:
    """Note that the run goes farther now, if it does."""
    kept = read_yaml(directory / CONFIG)
    if kept[LENGTH] != config[LENGTH]:
        reopen(directory)
        overrides = [text for text in read_yaml(directory / STATE)["overrides"] if _key(text) != LENGTH]
        state = {**read_yaml(directory / STATE), "overrides": [*overrides, f"{LENGTH}={config[LENGTH]}"]}
        write_yaml(directory / STATE, state)
        write_yaml(directory / CONFIG, {**kept, LENGTH: config[LENGTH]})


def abandon(directory: Path) -> None:
    """Take back what `begin` made for a run that never came to its first record."""
    if not is_new(directory):
        return
    for path in (CONFIG, STATE, JOURNAL, LOCK, "run.log", "training_blocks.csv", "evaluation_blocks.csv"):
        (directory / path).unlink(missing_ok=True)
    with contextlib.suppress(OSError):
        (directory / "weights").rmdir()


def is_new(directory: Path) -> bool:
    """Has nothing been recorded yet?"""
    return (directory / JOURNAL).exists() and (directory / JOURNAL).stat().st_size == 0


def finish(directory: Path, seconds: float) -> None:
    """Note that the run has finished, and how its tables and weights look."""
    weights = [f"weights/{path.name}" for path in sorted((directory / "weights").glob("*.safetensors"))]
    reported = [WORLD_TABLE] if (directory / WORLD_TABLE).exists() else []
    files = {name: checksum(directory / name) for name in (*TABLES, *reported, *weights)}
    state = read_yaml(directory / STATE)
    write_yaml(directory / STATE, {**state, "finished": True, "seconds": round(seconds, 1), "files": files})


def reopen(directory: Path) -> None:
    """Note that a finished run has something to do again."""
    write_yaml(directory / STATE, {**read_yaml(directory / STATE), "finished": False})


def finished(directory: Path) -> bool:
    """Has the run there finished, and are its tables and weights still what they were?"""
    if not (directory / STATE).exists():
        return False
    state = read_yaml(directory / STATE)
    files = state.get("files", {})
    return bool(state.get("finished")) and all(checksum(directory / name) == files[name] for name in files)


def hydra_arguments(hydra: Any) -> list[str]:
    """Flags and overrides that a command line needs besides the overrides of the job, to compose the same config."""
    arguments = []
    for source in hydra.runtime.config_sources:
        if source.provider == "command-line":
            arguments += ["--config-dir", source.path]
        if source.provider == "main" and source.path != config_dir():
            arguments += ["--config-path", source.path]
    if hydra.job.config_name != "config":
        arguments += ["--config-name", hydra.job.config_name]
    return arguments + [text for text in hydra.overrides.hydra if not text.lstrip("+~").startswith(NOT_KEPT)]


def resumed(arguments: list[str]) -> list[str]:
    """The command line with `resume=DIR` replaced by what the run in DIR was started with; what else it says, wins.

    Goes to the directory where the run was started, so that relative paths mean the same. Raises InputError if there is
    no run to go on with.
    """
    resume = [text for text in arguments if text.startswith("resume=")]
    if not resume:
        return arguments
    others = [text for text in arguments if text not in resume]
    if len(resume) > 1 or {"-m", "--multirun"} & set(others):
        raise InputError("resume takes one run directory; a sweep goes on with its own command")
    directory = Path(resume[0].partition("=")[2]).absolute()
    if not (directory / STATE).exists():
        raise InputError(f"resume={directory}: no run there; give a directory that holds {STATE}")
    state = read_yaml(directory / STATE)
    if Path(state["cwd"]).is_dir():
        os.chdir(state["cwd"])
    given = {_key(text) for text in others}
    kept = [text for text in state["overrides"] if _key(text) not in given]
    return [*state["hydra"], *kept, *others, f"hydra.run.dir={quoted(directory)}"]


def _key(override: str) -> str:
    return override.lstrip("+~").partition("=")[0]


def quoted(path: Path | str) -> str:
    """A path or another text as a value in Hydra's override grammar."""
    escaped = re.sub(r"(\\*)('|\Z)", lambda found: 2 * found[1] + found[2].replace("'", "\\'"), str(path))
    return f"'{escaped}'"


@contextlib.contextmanager
def resumable(directory: Path) -> Iterator[None]:
    """What ends the run says how to go on with it; a mistake before its first record passes as it is."""
    how = f"go on with: python -m apf.main resume={shlex.quote(str(directory))}"
    try:
        yield
    except KeyboardInterrupt as error:
        number = error.number if isinstance(error, Interrupted) else 2
        raise Interrupted(number, f"interrupted; {how}") from None
    except (InputError, Stopped) as error:
        if isinstance(error, InputError) and is_new(directory):
            raise
        raise Stopped(f"{error}; {how}") from error
    except OSError as error:
        reason = f"{error.filename or directory}: cannot be written: {error.strerror}" if error.strerror else error
        raise Stopped(f"{reason}; {how}") from error
