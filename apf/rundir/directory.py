"""What a run directory holds, how it was started, how far it has gone, and whether it may go on."""

import contextlib
import secrets
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import OmegaConf

from apf.config.values import LENGTH, config_dir, config_hash, flatten, identity
from apf.domain import Domain, Task
from apf.errors import InputError, Stopped
from apf.interrupts import Interrupted
from apf.rundir.claim import CONFIG, JOURNAL, STATE, TABLES, WORLD_TABLE, is_new, refuse_foreign
from apf.rundir.files import checksum, read_yaml, write_yaml
from apf.rundir.journal import Journal, create
from apf.rundir.kept import read_config, read_state
from apf.rundir.provenance import now, provenance
from apf.rundir.versions import versions

NOT_KEPT = ("hydra.mode", "hydra.run.", "hydra.sweep", "hydra/sweeper", "hydra.launcher", "hydra/launcher")
"""Hydra's own overrides that say where and how a run is started, not what it is."""


MANY, TARGET = ("task", "tracker"), "_target_"
"""Groups of which several options may be chosen, unless one class fills the whole key."""


def check(directory: Path, config: dict[str, Any], domain: Domain) -> bool:
    """Check that this run may use the directory: the directory holds no run, or holds this one.

    Args:
        directory: May hold a run.
        config: The plain config of this run.
        domain: The domain of this run.

    Returns:
        Whether the run in the directory has finished, with at least as many plans as the config asks for.

    Raises:
        InputError: The directory holds a run of another config (the message names the keys that differ), a run whose
            files are damaged or missing, or one that cannot go on with this number of plans.
    """
    if not holds_run(directory):
        return False
    kept = read_config(directory)
    mine, theirs = (flatten(identity(c)) for c in (config, kept))
    differing = [key for key in sorted(mine.keys() | theirs.keys()) if mine.get(key) != theirs.get(key)]
    if differing:
        raise InputError(f"{directory} holds a run of another config; these keys differ: {', '.join(differing)}")
    check_objects(directory, domain)
    if not (directory / JOURNAL).exists():
        raise InputError(
            f"{directory / JOURNAL} is missing, and all labels with it; put it back, or remove {directory}"
        )
    done = finished(directory)
    if config[LENGTH] < kept[LENGTH] and not done:
        raise InputError(f"{directory} holds a run of {kept[LENGTH]} plans that has not finished; go on with as many")
    first, each = sum(kept["initial"].values()), kept["acquisition"]["plans"]
    if config[LENGTH] > kept[LENGTH] and (kept[LENGTH] - first) % each:
        raise InputError(
            f"{directory} holds a run of {kept[LENGTH]} plans, whose last acquisition had fewer than {each}: "
            "it cannot be made longer"
        )
    return done and config[LENGTH] <= kept[LENGTH]


def check_objects(directory: Path, domain: Domain) -> None:
    """Raises InputError if the objects of the domain are not those with which the run began."""
    began = read_state(directory)["objects"]
    for name, digest in domain.digests.items():
        if began.get(name) != digest:
            raise InputError(
                f"{directory / name} differs from the config, or was changed; labels belong to what the run began with"
            )
    domain.check_kept(directory)


def begin(directory: Path, config: dict[str, Any], domain: Domain, tasks: Mapping[str, Task]) -> None:
    """Write the first files of a run into the (locked) directory, unless the run has begun there already.

    `config.yaml` is written last: a directory that has it holds a run.

    Args:
        directory: Where the run is to be.
        config: The plain config.
        domain: Of the run.
        tasks: By their names in the config.

    Raises:
        InputError: As in `check`; or a file of the user's would be overwritten (the message names this file).
    """
    if check(directory, config, domain):
        return
    if holds_run(directory):
        lengthen(directory, config)
        return
    refuse_foreign(directory, domain, config_hash(config))
    hydra = HydraConfig.get()
    in_sweep = hydra.mode == RunMode.MULTIRUN or directory.parent == Path(hydra.sweep.dir).absolute()
    chosen = hydra.runtime.choices
    choices = {key: value for key, value in chosen.items() if "hydra/" not in key and not follows(key, chosen)}
    identifier = secrets.token_hex(4)
    state = {
        "name": directory.name,
        "id": identifier,
        "hash": config_hash(config),
        "sweep": config["sweep"] if in_sweep else None,
        "choices": {**choices, **{key: list(config[key]) for key in MANY if TARGET not in config[key]}},
        "overrides": as_typed(hydra.overrides.task),
        "cwd": str(Path.cwd()),
        "words": {"plan": domain.plan_word, "object": domain.object_word},
        "titles": {name: task.title for name, task in tasks.items()},
        "objects": domain.digests,
        "versions": versions(),
        **provenance(),
        "finished": False,
        "seconds": 0.0,
    }
    try:
        domain.keep(directory)
        write_yaml(directory / STATE, state)
        create(directory / JOURNAL, identifier)
        write_yaml(directory / CONFIG, config)
    except OSError as error:
        raise InputError(f"{directory}: cannot be written: {error.strerror}") from None
    except UnicodeError:
        raise InputError(f"{directory}: its name, or a value of the config, cannot be written as text") from None
    check_written(directory, config, state, domain)


def check_written(directory: Path, config: dict[str, Any], state: dict[str, Any], domain: Domain) -> None:
    """Raises InputError if what a run begins with cannot be read back as it was written.

    Args:
        directory: Of the run.
        config: What config.yaml should hold.
        state: What run.yaml should hold.
        domain: Of the run.
    """
    for name, written in ((CONFIG, config), (STATE, state)):
        read = read_yaml(directory / name)
        for key in written:
            if read.get(key) != written[key]:
                raise InputError(f"{key}: a value cannot be kept: {directory / name} does not give it back as it is")
    try:
        domain.check_kept(directory)
    except InputError as error:
        raise InputError(f"domain: what it names cannot be kept; are there blanks or symbols? {error}") from None


def follows(group: str, choices: Mapping[str, Any]) -> bool:
    """Does this group's choice follow from another group's, as that of `world/noisy` follows from `world: noisy`?"""
    name, _, package = group.partition("@")
    parent, _, option = name.rpartition("/")
    return bool(parent) and choices.get(parent if package in ("", parent) else f"{parent}@{package}") == option


def as_typed(overrides: Any) -> list[str]:
    """Overrides of a command line as they were typed, with their interpolations unresolved."""
    return OmegaConf.to_container(overrides, resolve=False)  # type: ignore[return-value]


def holds_run(directory: Path) -> bool:
    """Has a run made the directory its own?"""
    return (directory / CONFIG).exists() and (directory / STATE).exists()


def lengthen(directory: Path, config: dict[str, Any]) -> None:
    """If the config asks for another number of plans than before, write it, and mark the run as unfinished."""
    kept = read_config(directory)
    if kept[LENGTH] != config[LENGTH]:
        reopen(directory)
        write_yaml(directory / CONFIG, {**kept, LENGTH: config[LENGTH]})


def finish(directory: Path, journal: Journal) -> None:
    """Write into `run.yaml` that the run has finished, where its journal ends, and the checksums of its files."""
    weights = [f"weights/{path.name}" for path in sorted((directory / "weights").glob("*.safetensors"))]
    reported = [WORLD_TABLE] if (directory / WORLD_TABLE).exists() else []
    files = {name: checksum(directory / name) for name in (JOURNAL, *TABLES, *reported, *weights)}
    ended = {"finished": True, "seconds": round(journal.seconds, 1), "ended": now()}
    done = {**ended, "journal": asdict(journal.end), "files": files}
    write_yaml(directory / STATE, {**read_state(directory), **done})


def reopen(directory: Path) -> None:
    """Write into `run.yaml` that the run is unfinished again."""
    write_yaml(directory / STATE, {**read_state(directory), "finished": False})


def finished(directory: Path) -> bool:
    """Has the run in the directory finished, and do its journal, tables and weights still have the same checksums?"""
    if not (directory / STATE).exists():
        return False
    state = read_state(directory)
    files = state.get("files") or {}
    return bool(state.get("finished")) and all(checksum(directory / name) == files[name] for name in files)


def output_directory(hydra: Any) -> Path:
    """Hydra's output directory. Its name is a name, whatever it looks like: `${seed}` is not the seed."""
    return Path(OmegaConf.to_container(hydra.runtime, resolve=False)["output_dir"])  # type: ignore


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
    return arguments + [text for text in as_typed(hydra.overrides.hydra) if not text.lstrip("+~").startswith(NOT_KEPT)]


@contextlib.contextmanager
def resumable(directory: Path) -> Iterator[None]:
    """Context: an error that ends the run gets a message that says how to resume the run.

    A user's mistake before the first record passes unchanged: there is nothing to resume.
    """
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
