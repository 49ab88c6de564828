"""From a composed config to checked objects: the schema of the root, unknown keys, ranges, names and hashes."""

import contextlib
import difflib
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from functools import partial
from pathlib import Path, PurePath
from typing import Annotated, Any

import pydantic
from hydra.conf import HydraConf
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf
from pydantic import Field

from apf.acquisition import Sampler
from apf.errors import InputError, shown
from apf.experiment import Acquisition, Execution, Initial
from apf.models import EnsembleSettings, Training
from apf.objective import Objective, check_objective
from apf.parts import PartError, find, make
from apf.planning import EvaluationSettings, MonteCarloPlanner
from apf.predictor import Predictor
from apf.settings import Count, Few, Name, Number, Seed, settings
from apf.tasks import Task
from apf.towers import BlockSet, TowerDomain
from apf.tracking import Tracker
from apf.worlds import World

NO_EFFECT = ("tracker", "device", "threads", "sweep", "execution", "objective")
"""Keys that may differ between two runs that are the same run."""
LENGTH = "towers"
"""How far a run goes: it may be made longer."""


def config_dir() -> str:
    """The folder of configs: beside the package in a checkout, inside it when installed from a wheel."""
    package = Path(__file__).parent
    inside = package / "conf"
    return str(inside if inside.is_dir() else package.parent / "conf")


@settings
class Learned:
    """Stands for the ensemble that the run itself trains."""

    odds: Annotated[Number, Field(gt=0, le=1000)]
    """What the odds of each placement are multiplied by when plans are judged; what to try next is chosen without."""


@settings
class Config:
    """Every setting of a run. The comments in `conf/config.yaml` say what each is for."""

    seed: Seed
    towers: Count
    initial: Initial
    acquisition: Acquisition
    execution: Execution
    training: Training
    evaluation: EvaluationSettings
    domain: TowerDomain
    model: EnsembleSettings
    sampler: Sampler
    world: World
    task: dict[str, Task]
    planner: MonteCarloPlanner
    predictor: Predictor | Learned
    tracker: Tracker
    device: Name
    threads: Few
    sweep: Name
    objective: Objective


def validate(cfg: DictConfig) -> Config:
    """All parts of a config, made and checked. Raises InputError, naming the key, for what is unknown or wrong."""
    return settle(cfg)[1]


def settle(cfg: DictConfig, kept: Path | None = None) -> tuple[dict[str, Any], Config]:
    """The plain config, each value as it was understood, and all of its parts, made and checked.

    Args:
        cfg: What Hydra composed.
        kept: A run directory whose block sets are to be used, whatever the config says of them.

    Raises:
        InputError: Something is unknown or wrong; it names the key.
    """
    config = build(cfg, Config)
    values = understood(plain(cfg), config)
    if kept is not None:
        config = replace(config, domain=config.domain.kept_in(kept))
    check_together(config)
    return values, config


def with_values(config: Config, values: dict[str, Any], cfg: DictConfig) -> Config:
    """The same parts with other numbers and names beside them, those of cfg. Raises InputError, naming the key."""
    try:
        return replace(config, **values)
    except pydantic.ValidationError as error:
        raise InputError(describe(error, "", cfg)) from None


def check_together(config: Config) -> None:
    """Raises InputError, naming the key, if parts that are right by themselves do not fit each other."""
    if not config.task:
        raise InputError("task: none is chosen; choose at least one of tallest, overhang, unsupported")
    first = config.initial.train + config.initial.validation
    if config.towers < first:
        raise InputError(f"towers is {config.towers}; it must be at least the {first} initial ones (initial.*)")
    if config.acquisition.validation >= config.acquisition.towers:
        raise InputError(
            f"acquisition.validation is {config.acquisition.validation}; it must be less than "
            f"acquisition.towers, {config.acquisition.towers}"
        )
    plans = config.initial.train + (0 if config.training.early_stopping else config.initial.validation)
    if config.training.learning_rate * config.training.weight_decay >= plans:
        raise InputError(
            f"training.weight_decay is {config.training.weight_decay:g}; times training.learning_rate it must be less "
            f"than the {plans} plans that are trained on first, or no weight is left"
        )
    config.domain.check_length(config.sampler.max_length, "sampler")
    config.domain.check_length(config.evaluation.blocks, "evaluation.blocks", evaluation=True)
    _check_world("world", config.world, config.domain.training_blocks, config.sampler.max_length)
    for name, world in config.evaluation.worlds.items():
        key = f"evaluation.worlds.{name}"
        _check_world(key, world, config.domain.evaluation_blocks, config.evaluation.blocks)
    for length in config.evaluation.lengths:
        config.domain.check_length(length, "evaluation.lengths", evaluation=True)
    check_objective(config.objective, config.evaluation, config.task)


def _check_world(key: str, world: World, blocks: BlockSet, length: int) -> None:
    try:
        world.check(blocks, length)
    except InputError as error:
        raise InputError(f"{key}: {error}") from None


def build(cfg: DictConfig, schema: type) -> Any:
    """`schema` filled with what the config names, each class checked before any is called.

    Raises InputError, naming the key, for a class that does not fit its place, and for what is missing or wrong.
    """
    missing = sorted(OmegaConf.missing_keys(cfg))
    if missing:
        raise InputError(f"{missing[0]} is missing; give it as {missing[0]}=...")
    parts = find(plain(cfg), [schema])
    try:
        return schema(**make(parts))
    except pydantic.ValidationError as error:
        raise InputError(describe(error, "", cfg)) from None
    except PartError as error:
        cause = error.__cause__
        if isinstance(cause, pydantic.ValidationError):
            raise InputError(describe(cause, error.key, cfg)) from None
        if isinstance(cause, InputError):
            raise InputError(f"{error.key}: {cause}") from None
        reason = next(iter(str(cause).splitlines()), "")
        raise InputError(f"{error.key}: {type(cause).__name__}: {reason}") from cause


def no_such_key(where: str, node: DictConfig | None) -> str:
    """One line on a key that is unknown in its part of a config: the one that was meant, or all that there are."""
    key = where.rpartition(".")[2]
    known = [str(k) for k in node or () if str(k) not in (key, "_target_", "_partial_", "hydra")]
    close = difflib.get_close_matches(key, known, n=1)
    hint = f"did you mean {close[0]}?" if close else f"known here: {', '.join(known) or 'nothing'}"
    return f"{where}: there is no such key; {hint}"


def describe(error: pydantic.ValidationError, key: str, cfg: DictConfig) -> str:
    """One line on the first thing that is wrong: its key, its value, and what would be right."""
    first = error.errors()[0]
    where = location(first["loc"], key, cfg, last=first["type"] not in ABSENT)
    if first["type"] in ("unexpected_keyword_argument", "extra_forbidden"):
        node = OmegaConf.select(cfg, where.rpartition(".")[0]) if "." in where else cfg
        return no_such_key(where, node)
    if first["type"] in ABSENT and isinstance(first["loc"][-1], int):
        return f"{where.rpartition('.')[0]} is {shown(list(first['input']))}; it should hold more values"
    if first["type"] in ABSENT:
        return f"{where} is missing; give it as {where}=..."
    reason = first["msg"].removeprefix("Value error, ").replace("Input should be", "it should be")
    if first["type"] == "value_error":
        return f"{where}: {reason}" if where else reason
    if first["type"] == "string_type" and isinstance(first["input"], int | float):
        reason += f"; a text that looks like a number has quotes of its own: '{where}=\"{shown(first['input'])}\"'"
    return f"{where} is {shown(first['input'])}; {reason}"


ABSENT = ("missing", "missing_argument", "missing_keyword_only_argument")
"""What pydantic calls a field that is not there."""


def location(parts: Sequence[int | str], key: str, cfg: DictConfig, last: bool) -> str:
    """The key of what pydantic complains of, below `key`: its own words for the options of a union are left out.

    last: the last part must be there, too.
    """
    node: Any = OmegaConf.to_container(cfg)
    for name in filter(None, key.split(".")):
        node = node.get(name) if isinstance(node, dict) else None
    where = [key] if key else []
    for number, part in enumerate(parts):
        inside = part in node if isinstance(node, dict) else isinstance(node, list) and part in range(len(node))
        if inside or not (last or number < len(parts) - 1):
            where.append(str(part))
            node = node[part] if inside else None
    return ".".join(where)


def check_hydra(hydra: Any, schema: Any = None, prefix: str = "hydra.") -> None:
    """Raises InputError for a key of Hydra's own part of the config that Hydra does not know: `+` adds any."""
    schema = OmegaConf.structured(HydraConf) if schema is None else schema
    known = [str(key) for key in schema]
    for key in hydra:
        if prefix + str(key) == "hydra.env":  # Hydra's own, though its schema does not tell
            continue
        if key not in known:
            close = difflib.get_close_matches(str(key), known, n=1)
            hint = f"did you mean {close[0]}?" if close else f"known here: {', '.join(known)}"
            raise InputError(f"{prefix}{key}: there is no such key; {hint}")
        if OmegaConf.is_missing(schema, key) or OmegaConf.is_missing(hydra, key):
            continue
        if isinstance(schema._get_node(key), DictConfig) and OmegaConf.get_type(schema, key) is not dict:
            check_hydra(hydra[key], schema[key], f"{prefix}{key}.")


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


def name_of(config: dict[str, Any], choices: Mapping[str, Any]) -> str:
    """The name of the run of a plain config, and what was chosen of each group."""
    parts = [choices[group] for group in ("sampler", "model", "world")]
    if choices["predictor"] != "learned":
        parts = [choices["predictor"]]
    return "-".join([*map(str, parts), f"seed{config['seed']}", config_hash(config)])


OmegaConf.register_new_resolver("run_name", run_name, replace=True)
