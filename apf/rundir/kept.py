"""What a run directory says of its run in YAML. People may edit these files: each is checked as it is read.

`run.yaml` says how a run was started and how far it has gone, `config.yaml` what it computes. What `analysis/keep.py`
publishes of a run is less than what a run needs to go on.
"""

from pathlib import Path
from typing import Annotated, Any

import pydantic
from pydantic import ConfigDict, Field

from apf.errors import InputError, shown
from apf.rundir.claim import CONFIG, STATE
from apf.rundir.files import read_yaml
from apf.rundir.journal import End
from apf.settings import Count, CountOrNone, Few, Name, Number, Seed, Switch

Choice = str | int | float | bool | None
Part = dict[str, Any]


class _Kept(pydantic.BaseModel):
    model_config = ConfigDict(extra="allow", allow_inf_nan=False)


class Summary(_Kept):
    """What analyses ask of `run.yaml`."""

    name: Annotated[str, Field(pattern=r"^[^/\x00]+$")]
    hash: str
    sweep: Name | None
    choices: dict[str, Choice | list[Choice]]
    """The chosen option of each config group."""
    words: dict[str, str]
    """The domain's words for plans and objects."""
    titles: dict[str, str]
    """The title of each task in figures."""
    versions: dict[str, str]
    finished: Switch
    seconds: Annotated[Number, Field(ge=0)]


class State(Summary):
    """All of `run.yaml`, without which a run does not go on."""

    id: Annotated[str, Field(pattern=r"^\w+$")]
    overrides: list[str]
    cwd: Annotated[str, Field(min_length=1)]
    source: dict[str, Choice] = {}
    """Commit of the checkout that the run began with, and whether its files differed from the commit."""
    machine: dict[str, Choice] = {}
    """Host, CPU and GPU that the run began on."""
    started: str | None = None
    ended: str | None = None
    """Times of day; None: by an earlier version, or unfinished."""
    objects: dict[str, str]
    """Digests of the sets of objects, by the names of their files."""
    journal: End | None = None
    """Where the journal ended, once the run has finished."""
    files: dict[Annotated[str, Field(pattern=r"^[^/\x00]+(/[^/\x00]+)?$")], str | None] = {}
    """Checksums of the journal, tables and weights, once the run has finished."""


class Initial(_Kept):
    """Of `config.yaml`: how many plans were labelled before the first acquisition."""

    train: Count
    validation: Count


class Acquisition(_Kept):
    """Of `config.yaml`: how many plans an acquisition adds."""

    plans: Count
    validation: CountOrNone


class Kept(_Kept):
    """What is asked of `config.yaml` by all who read it. What is in its parts, each part checks when it is made."""

    seed: Seed
    plans: Count
    initial: Initial
    acquisition: Acquisition
    training: Part
    evaluation: Part
    domain: Part
    model: Part
    sampler: Part
    world: Part
    task: dict[str, Part]
    planner: Part
    predictor: Part
    tracker: Part
    device: str
    threads: Few
    sweep: Name


def read_state(directory: Path, schema: type[Summary] = State) -> dict[str, Any]:
    """The `run.yaml` of a run directory. Raises InputError, naming file and key, if it is not as `schema` asks."""
    return _read(directory / STATE, schema)


def read_config(directory: Path) -> dict[str, Any]:
    """The `config.yaml` of a run directory. Raises InputError, naming file and key, if it is no run's."""
    return _read(directory / CONFIG, Kept)


def _read(path: Path, schema: type[_Kept]) -> dict[str, Any]:
    content = read_yaml(path)
    for key in content:
        if not isinstance(key, str):
            raise InputError(f"{path}: {shown(key)}: there is no such key")
    try:
        schema.model_validate(content)
    except pydantic.ValidationError as error:
        raise InputError(f"{path}: {_describe(error)}") from None
    return content


def _describe(error: pydantic.ValidationError) -> str:
    """One line on the first thing that is wrong."""
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"] if not str(part).endswith("]"))
    if first["type"].startswith("missing"):
        return f"{key} is missing"
    return f"{key} is {shown(first['input'])}; {first['msg'].replace('Input should be', 'it should be')}"
