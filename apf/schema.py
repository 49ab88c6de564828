"""The schema of a run's config, and whether its parts fit each other."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pydantic
from omegaconf import DictConfig

from apf.acquisition import Sampler
from apf.config.build import build
from apf.config.messages import describe
from apf.config.values import plain, understood
from apf.domain import Domain, Predictor, Task, World
from apf.errors import InputError
from apf.experiment import Acquisition, Execution, Initial
from apf.models import EnsembleNetwork, EnsembleSettings, Training
from apf.planning import EvaluationSettings, Learned, Planner, Trained
from apf.planning.objective import Objective, check_objective
from apf.settings import Count, Few, Name, Seed, settings
from apf.tracking import Tracker


@settings
class Config:
    """Every setting of a run. The comments in `conf/config.yaml` say what each is for."""

    seed: Seed
    plans: Count
    initial: Initial
    acquisition: Acquisition
    execution: Execution
    training: Training
    evaluation: EvaluationSettings
    domain: Domain
    model: EnsembleSettings
    sampler: Sampler
    world: World
    task: dict[str, Task]
    planner: Planner
    predictor: Predictor | Learned | Trained
    tracker: dict[str, Tracker] | Tracker
    """By their names; or one alone, as a config of one's own may have it."""
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
        kept: A run directory whose objects of plans are to be used, whatever the config says of them.

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
    """The same parts with other numbers and names beside them, those of cfg. Raises InputError, naming the key.

    Args:
        config: The parts.
        values: Of other keys of the root.
        cfg: What the values come from, for messages.
    """
    try:
        return replace(config, **values)
    except pydantic.ValidationError as error:
        raise InputError(describe(error, "", cfg)) from None


def check_together(config: Config) -> None:
    """Raises InputError, naming the key, if parts that are right by themselves do not fit each other."""
    if not config.task:
        raise InputError("task: none is chosen; choose at least one")
    first = config.initial.train + config.initial.validation
    if config.plans < first:
        raise InputError(f"plans is {config.plans}; it must be at least the {first} initial ones (initial.*)")
    for key in ("validation", "rehearsed"):
        if getattr(config.acquisition, key) >= config.acquisition.plans:
            raise InputError(
                f"acquisition.{key} is {getattr(config.acquisition, key)}; it must be less than acquisition.plans, "
                f"{config.acquisition.plans}"
            )
    plans = config.initial.train + (0 if config.training.early_stopping else config.initial.validation)
    if config.training.learning_rate * config.training.weight_decay >= plans:
        raise InputError(
            f"training.weight_decay is {config.training.weight_decay:g}; times training.learning_rate it must be less "
            f"than the {plans} plans that are trained on first, or no weight is left"
        )
    config.domain.check_length(config.sampler.max_length, "sampler")
    longest = config.sampler.max_length
    if config.acquisition.rehearsed:
        config.domain.check_length(config.evaluation.length, "evaluation.length (acquisition.rehearsed)")
        longest = max(longest, config.evaluation.length)
    config.domain.check_length(config.evaluation.length, "evaluation.length", evaluation=True)
    _check_domain(config)
    _check_world("world", config.world, config.domain, longest)
    for name, world in config.evaluation.worlds.items():
        _check_world(f"evaluation.worlds.{name}", world, config.domain, config.evaluation.length, evaluation=True)
    for length in config.evaluation.lengths:
        config.domain.check_length(length, "evaluation.lengths", evaluation=True)
    check_objective(config.objective, config.evaluation, config.task)


def _check_domain(config: Config) -> None:
    """Raises InputError, naming the key, for a part that is for the plans of another domain."""
    network = getattr(config.model.network, "func", config.model.network)  # the class, to be called later
    parts: dict[str, Any] = {"world": config.world, "predictor": config.predictor, "model": network}
    parts["sampler.candidates"] = config.sampler.candidates
    parts |= {f"evaluation.worlds.{name}": world for name, world in config.evaluation.worlds.items()}
    parts |= {f"task.{name}": task for name, task in config.task.items()}
    for key, part in parts.items():
        domain = getattr(part, "for_domain", None)
        if domain is not None and not isinstance(config.domain, domain):
            name = part.__name__ if isinstance(part, type) else type(part).__name__
            raise InputError(
                f"{key} is {name}, which is for {domain.__name__}; domain is "
                f"{type(config.domain).__name__}: choose another of the group {key.split('.')[0]}, or another domain"
            )
    if isinstance(network, type) and issubclass(network, EnsembleNetwork):
        network.check_features(config.domain)


def _check_world(key: str, world: World, domain: Domain, length: int, evaluation: bool = False) -> None:
    try:
        world.check(domain, length, evaluation)
    except InputError as error:
        raise InputError(f"{key}: {error}") from None
