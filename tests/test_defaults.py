"""A default that stands in the code and in a config is the same in both."""

import math
from collections.abc import Iterator
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import pytest
from hydra import compose, initialize_config_dir
from hydra.utils import get_object
from omegaconf import OmegaConf

from apf.config.values import config_dir
from apf.models import Training

CONF = Path(config_dir())
CHOICES = [
    *([f"domain={path.stem}"] for path in sorted((CONF / "domain").glob("*.yaml"))),
    *([f"sampler={path.stem}"] for path in sorted((CONF / "sampler").glob("*.yaml"))),
    *([f"model={path.stem}"] for path in sorted((CONF / "model").glob("*.yaml"))),
    *([f"predictor={name}"] for name in ("learned", "analytic", "simulation")),
    ["world=panda"],
    *([f"domain={name}", "predictor=simulation"] for name in ("towers", "packing")),
]
ON_PURPOSE = {("BoxSource", "seed"), ("BlockSource", "seed"), ("BoxSource", "prefix"), ("BlockSource", "prefix")}
"""Training and evaluation have different sets."""


def composed(*overrides: str) -> dict[str, Any]:
    with initialize_config_dir(config_dir(), version_base="1.3"):
        return OmegaConf.to_container(compose("config", [*overrides]), resolve=True)  # type: ignore[return-value]


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
                yield cls.__name__, key, value, default
        yield from pairs(value, inner)


def same(one: Any, other: Any) -> bool:
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float | int) and isinstance(other, float | int):
        return math.isclose(one, other)
    return one == other or str(one) == str(other)


@pytest.mark.parametrize("overrides", CHOICES, ids=" ".join)
def test_defaults_agree(overrides: list[str]) -> None:
    config = composed(*overrides)
    if "world=panda" in overrides:  # which brings blocks that the robot can hold
        config.pop("domain")
    found = [*pairs(config), *pairs(config["training"], Training)]
    differing = [
        f"{name}.{key}: {value!r} in YAML, {default!r} in code"
        for name, key, value, default in found
        if (name, key) not in ON_PURPOSE and not same(value, default)
    ]
    assert not differing


def test_many_are_compared() -> None:
    assert len({(name, key) for o in CHOICES for name, key, *_ in [*pairs(composed(*o))]}) > 30
