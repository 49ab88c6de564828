"""Was a run evaluated as the protocol of the sweeps says (`sweeps/protocol.yaml`)? Training may be anything."""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from apf.api.composed import composed
from apf.config.values import flatten, plain, sweeps_dir
from apf.report.runs import Run
from apf.rundir.files import read_yaml

BARE = "strategies"
"""The sweep with which runs of no sweep are compared: it adds nothing to the protocol."""
COMPARED = ("plans", "evaluation.", "planner.", "task.", "domain._target_", "domain.evaluation.")
"""Keys, and beginnings of keys, that an evaluation depends on."""
OF_SPEED = ("planner.first", "planner.chunk")
"""Keys of these that change no result."""
SHOWN = 3
"""Deviations that a note names at most."""


def deviations(run: Run) -> list[str]:
    """How the run was evaluated otherwise than the protocol says, a text for each key: its value, and the protocol's.

    A run of a sweep that includes the protocol is compared with that sweep, any other run with the sweep `BARE`. Only
    keys that both have are compared, since runs of earlier versions lack some. A run may have more evaluations, longer
    plans in its test sets, and more labelled plans.
    """
    said = _protocol(str(run.choices.get("experiment")), run.config.get("seed", 0))
    done = flatten(run.config)
    keys = [key for key in said if key.startswith(COMPARED) and key not in OF_SPEED and key in done]
    return [f"{key} is {done[key]} (protocol: {said[key]})" for key in keys if not _agrees(key, done, said)]


def note_on(runs: Mapping[str, Sequence[Run]]) -> str:
    """What is to be said of the runs of another protocol; empty if there are none.

    Args:
        runs: The runs behind each name.
    """
    names: dict[str, list[str]] = {}
    for name, of_name in runs.items():
        found = [deviation for deviation in map(deviations, of_name) if deviation]
        texts = list(dict.fromkeys(text for deviation in found for text in deviation))
        if texts:
            more = f" and {len(texts) - SHOWN} more" if len(texts) > SHOWN else ""
            said = ", ".join(texts[:SHOWN]) + more
            names.setdefault(said, []).append(f"{len(found)} of {len(of_name)} of {name}")
    return "; ".join(f"runs of another protocol ({', '.join(who)}): {said}" for said, who in names.items())


@cache
def _protocol(experiment: str, seed: int) -> dict[str, Any]:
    """The flat config of a sweep, or of `BARE`, with that seed."""
    config = _composed(experiment if _includes_protocol(_sweeps() / "experiment" / f"{experiment}.yaml") else BARE)
    config.seed = seed
    return flatten(plain(config))


@cache
def _composed(experiment: str) -> DictConfig:
    with composed("config", [f"+experiment={experiment}", "tracker=none"]) as (config, _):
        return config


@cache
def _includes_protocol(path: Path) -> bool:
    """Does the defaults list of a config, or of one that it names there, have the protocol?"""
    if path == _sweeps() / "protocol.yaml":
        return True
    entries = read_yaml(path).get("defaults", []) if path.is_file() else []
    names = [entry.lstrip("/").partition("@")[0] for entry in entries if isinstance(entry, str)]
    return any(_includes_protocol(_sweeps() / f"{name}.yaml") for name in names)


def _sweeps() -> Path:
    return Path(sweeps_dir().removeprefix("file://"))


def _agrees(key: str, done: Mapping[str, Any], said: Mapping[str, Any]) -> bool:
    """Is the value of a key what the protocol says, or more where more does no harm?"""
    value, wanted = done[key], said[key]
    if key == "plans":
        return bool(value >= wanted)
    if key == "evaluation.every":
        return bool(wanted % value == 0)
    if key == "evaluation.lengths":
        return set(wanted) <= set(value)
    if key == "evaluation.also":
        return all(plans in value or plans % done["evaluation.every"] == 0 for plans in wanted)
    return bool(value == wanted)
