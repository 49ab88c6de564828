"""A default that stands in the code and in a config is the same in both."""

import importlib
import inspect
import math
import pkgutil
from collections.abc import Iterator
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import pytest
from hydra import compose, initialize_config_dir
from hydra.utils import get_object
from omegaconf import OmegaConf

import apf
from apf.config.values import config_dir
from apf.experiment import Acquisition
from apf.models import Training
from apf.panda.film import Camera
from apf.planning import EvaluationSettings

CONF = Path(config_dir())
CHOICES = [
    *([f"domain={path.stem}"] for path in sorted((CONF / "domain").glob("*.yaml"))),
    *([f"sampler={path.stem}"] for path in sorted((CONF / "sampler").glob("*.yaml"))),
    *([f"model={path.stem}"] for path in sorted((CONF / "model").glob("*.yaml"))),
    *([f"predictor={name}"] for name in ("learned", "analytic", "simulation", "oracle")),
    *(["world=panda", "world/flaws=exact", f"world/reality={name}"] for name in ("bullet", "mujoco")),
    ["predictor=trained", "predictor.run=run"],
    *([f"tracker={path.stem}"] for path in sorted((CONF / "tracker").glob("*.yaml"))),
    *([f"planner={name}"] for name in ("monte_carlo", "search")),
    *([f"domain={name}", "predictor=simulation"] for name in ("towers", "packing")),
]
SETS = ("apf.packing.sources.BoxSource", "apf.towers.sources.BlockSource")
ON_PURPOSE = {(name, key) for name in SETS for key in ("seed", "prefix")}
"""Training and evaluation have different sets."""
OF_A_CLASS = {("apf.panda.world.PandaWorld", "initial"), ("apf.acquisition.sampler.Sampler", "batch")}
"""Null in code; a config names a class. It is no plain value, so it is not compared."""
ANYBODYS = {"WANDB_PROJECT", "WANDB_ENTITY", "MLFLOW_TRACKING_URI", "MLFLOW_EXPERIMENT_NAME"}
"""Variables of the environment that configs read."""


@pytest.fixture(autouse=True)
def bare_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ANYBODYS:
        monkeypatch.delenv(name, raising=False)


def composed(*overrides: str, name: str = "config") -> dict[str, Any]:
    with initialize_config_dir(config_dir(), version_base="1.3"):
        config = OmegaConf.to_container(compose(name, [*overrides]), resolve=True)
    if "world=panda" in overrides:  # which brings blocks that the robot can hold
        config.pop("domain")  # type: ignore[union-attr]
    return config  # type: ignore[return-value]


def of_a_run(overrides: list[str]) -> list[tuple[str, str, Any, Any]]:
    config = composed(*overrides)
    parts = {"training": Training, "evaluation": EvaluationSettings, "acquisition": Acquisition}
    return [*pairs(config), *(pair for key, cls in parts.items() for pair in pairs(config[key], cls))]


def of_the_camera() -> list[tuple[str, str, Any, Any]]:
    return [*pairs(composed(name="show")["camera"], Camera)]


def defaults_in_code() -> set[tuple[str, str]]:
    """Class and key of each field of a settings class that has a plain value as its default."""
    found = set()
    for module in pkgutil.walk_packages(apf.__path__, "apf."):
        if module.name.removeprefix("apf.") in apf.__all__:  # run, and imported by nobody
            continue
        for _, cls in inspect.getmembers(importlib.import_module(module.name), inspect.isclass):
            if cls.__module__ == module.name and cls.__dict__.get("__pydantic_config__", {}).get("extra") == "forbid":
                for key, field in cls.__pydantic_fields__.items():
                    default = None if field.is_required() else field.get_default(call_default_factory=True)
                    if field.init is not False and not field.is_required() and not is_dataclass(default):
                        found.add((full_name(cls), key))
    return found


def full_name(cls: type) -> str:
    return f"{cls.__module__}.{cls.__qualname__}"


def pairs(node: Any, cls: Any = None) -> Iterator[tuple[str, str, Any, Any]]:
    """Of each value of a config whose class has a default for it: class, key, the value, that default."""
    if isinstance(node, list):
        for item in node:
            yield from pairs(item)
    if not isinstance(node, dict):
        return
    cls = get_object(node["_target_"]) if "_target_" in node else cls
    known = getattr(cls, "__pydantic_fields__", {})
    for key, value in node.items():
        inner = None
        if key in known and not known[key].is_required():
            default = known[key].get_default(call_default_factory=True)
            if is_dataclass(default):
                inner = type(default)
            elif not isinstance(value, dict):
                yield full_name(cls), key, value, default
        yield from pairs(value, inner)


def same(one: Any, other: Any) -> bool:
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float | int) and isinstance(other, float | int):
        return math.isclose(one, other)
    return one == other or str(one) == str(other)


def differing(found: list[tuple[str, str, Any, Any]]) -> list[str]:
    return [
        f"{name}.{key}: {value!r} in YAML, {default!r} in code"
        for name, key, value, default in found
        if (name, key) not in ON_PURPOSE and not same(value, default)
    ]


@pytest.mark.parametrize("overrides", CHOICES, ids=" ".join)
def test_defaults_agree(overrides: list[str]) -> None:
    assert not differing(of_a_run(overrides))


def test_defaults_of_the_camera_agree() -> None:
    assert not differing(of_the_camera())


def test_each_default_in_code_is_compared() -> None:
    """No config leaves one out, and no choice above is missing."""
    found = [*(pair for choice in CHOICES for pair in of_a_run(choice)), *of_the_camera()]
    assert defaults_in_code() - OF_A_CLASS == {(name, key) for name, key, *_ in found}
