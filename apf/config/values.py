"""A config as plain values: resolved, as it was understood, and by what it is named."""

import contextlib
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import partial
from pathlib import Path, PurePath
from typing import Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

NO_EFFECT = ("tracker", "device", "threads", "sweep", "execution", "objective")
"""Keys that may differ between two runs that are the same run."""
LENGTH = "plans"
"""How far a run goes: it may be made longer."""


def config_dir() -> str:
    """The folder of configs: beside the package in a checkout, inside it when installed from a wheel."""
    return str(_beside_or_inside("conf"))


def sweeps_dir() -> str:
    """The folder of sweeps, as a search path of Hydra's; likewise. Resolver `sweeps` of the configs."""
    return f"file://{_beside_or_inside('sweeps')}"


def _beside_or_inside(name: str) -> Path:
    package = Path(__file__).parents[1]
    inside = package / name
    return inside if inside.is_dir() else package.parent / name


def without(cfg: DictConfig, *keys: str) -> DictConfig:
    """A config without what a domain brings and a command does not need."""
    return OmegaConf.masked_copy(cfg, [str(key) for key in cfg if key not in keys])


def plain(cfg: DictConfig) -> dict[str, Any]:
    """The resolved config without Hydra's own part, as plain containers."""
    keys = [str(key) for key in cfg if key != "hydra"]
    refer = [key for key in keys if OmegaConf.is_interpolation(cfg, key)]
    raw: Any = OmegaConf.to_container(cfg) if refer else {}
    values = {key: "???" if OmegaConf.is_missing(cfg, key) else cfg[key] for key in keys}
    values |= {key: _as_typed(raw[key], values[key]) for key in refer}
    return {key: _contained(value) if OmegaConf.is_config(value) else value for key, value in values.items()}


def _contained(node: Any) -> Any:
    """As plain containers, resolved; what holds nothing to resolve takes half the time if it is not asked to be."""
    container = OmegaConf.to_container(node)
    return _as_typed(container, OmegaConf.to_container(node, resolve=True)) if "${" in str(container) else container


def _as_typed(raw: Any, value: Any) -> Any:
    """A resolved value. What comes from an environment variable (`${oc.env:N}`) means what it would mean typed."""
    if isinstance(raw, dict) and isinstance(value, dict):
        return {key: _as_typed(raw.get(key), inner) for key, inner in value.items()}
    if isinstance(raw, list) and isinstance(value, list):
        return [_as_typed(*pair) for pair in zip(raw, value, strict=True)]
    if isinstance(raw, str) and isinstance(value, str) and raw.startswith("${oc.env:"):
        for kind in (int, float):
            with contextlib.suppress(ValueError):
                return kind(value)
        return {"true": True, "false": False, "null": None}.get(value.lower(), value)
    return value


def understood(given: Any, made: Any) -> Any:
    """A plain config with the values that its objects hold: a number that was given as text is a number.

    Args:
        given: Plain containers and values.
        made: What became of them.
    """
    if isinstance(given, dict):
        if isinstance(made, partial):
            made = made.keywords
        if is_dataclass(made):
            made = {field.name: getattr(made, field.name) for field in fields(made)}
        if isinstance(made, Mapping):
            return {key: understood(value, made[key]) if key in made else value for key, value in given.items()}
    if isinstance(given, list) and isinstance(made, list | tuple) and len(given) == len(made):
        return [understood(*pair) for pair in zip(given, made, strict=True)]
    value = made.value if isinstance(made, Enum) else str(made) if isinstance(made, PurePath) else made
    return value if isinstance(value, str | int | float | bool | None) else given


def identity(config: dict[str, Any]) -> dict[str, Any]:
    """The part of a plain config that decides what a run computes, however far it goes."""
    return {key: value for key, value in config.items() if key not in (*NO_EFFECT, LENGTH)}


def config_hash(config: dict[str, Any]) -> str:
    """Eight hexadecimal digits that identify what a run computes."""
    text = json.dumps(_numbers(identity(config)), sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def _numbers(node: Any) -> Any:
    """A plain config in which 1.0 is 1: both are one number."""
    if isinstance(node, dict):
        return {key: _numbers(value) for key, value in node.items()}
    if isinstance(node, list):
        return [_numbers(item) for item in node]
    return int(node) if isinstance(node, float) and node.is_integer() else node


def flatten(config: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """A nested dict as {"a.b.c": leaf}; lists are leaves."""
    flat: dict[str, Any] = {}
    for key, value in config.items():
        if isinstance(value, dict):
            flat |= flatten(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def run_name(_root_: DictConfig) -> str:
    """Names a run by what it is: sampler-model-world-seed-hash. Resolver `run_name` of the configs."""
    choices = _root_.hydra.runtime.choices if "hydra" in _root_ else HydraConfig.get().runtime.choices
    return name_of(plain(_root_), choices)


def name_of(config: dict[str, Any], choices: Mapping[str, Any], varied: Sequence[str] = ()) -> str:
    """The name of a run: sampler-model-world, words on what else was varied, seed and hash.

    Args:
        config: The plain config.
        choices: What was chosen of each group.
        varied: Words, e.g. `learning_rate_0.001`.
    """
    parts = [choices[group] for group in ("sampler", "model", "world")]
    if choices["predictor"] != "learned":
        parts = [choices["predictor"]]
    return "-".join([*map(str, parts), *varied, f"seed{config['seed']}", config_hash(config)])


KEPT_DOMAIN: dict[str, str] = {}
"""Which domain a kept option of the group `domain` holds, by the option's name."""


def of_domain(choice: str) -> str:
    """Where other groups have their options for a domain. Resolver `of_domain` of the configs."""
    return KEPT_DOMAIN.get(choice, choice)


OmegaConf.register_new_resolver("run_name", run_name, replace=True)
OmegaConf.register_new_resolver("of_domain", of_domain, replace=True)
OmegaConf.register_new_resolver("sweeps", sweeps_dir, replace=True)
