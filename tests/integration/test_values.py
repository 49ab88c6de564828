"""Every key of every config, given values of wrong types and sizes: a check passes, or one line names the key."""

import itertools
import math
import shlex
from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hydra import compose, initialize_config_dir
from hydra.utils import get_class
from omegaconf import DictConfig, OmegaConf

from apf.commands.label import LabelConfig
from apf.commands.plan import PlanConfig
from apf.commands.predict import PredictConfig
from apf.commands.relabel import RelabelConfig
from apf.commands.run import make_model
from apf.config.build import build
from apf.config.values import config_dir, without
from apf.errors import InputError, shown
from apf.launch.cli import MISTAKES, one_line
from apf.launch.machine import check_machine
from apf.schema import validate
from integration.command_line import TINY, call, options

VALUES: dict[str, Any] = {
    "text": "many",
    "number as text": "3",
    "empty text": "",
    "long text": "x" * 10_000,
    "letters of all kinds": "塔\u202e[red]\x00\n😀",
    "true": True,
    "null": None,
    "missing": "???",
    "interpolation": "${nowhere}",
    "empty list": [],
    "list": [1],
    "list of texts": ["many"],
    "list of switches": [True, True],
    "list of huge numbers": [1e23, 1e23, 1e23],
    "mapping": {"a": 1},
    "zero": 0,
    "one": 1,
    "negative": -1,
    "fraction": 0.5,
    "large": 1e12,
    "huge": 1e23,
    "as huge below": -1e23,
    "integer of 400 digits": 10**400,
    "infinite": math.inf,
    "no number": math.nan,
}
NO_NUMBERS = set(VALUES) - {"zero", "one", "negative", "fraction"}
"""What no key that is a number may be."""
NO_SWITCHES = set(VALUES) - {"true"}
NO_LISTS = set(VALUES) - {"empty list", "list"}
"""What no key that is a list of numbers may be."""
MAY_BE_NULL = ("world.initial", "sampler.batch", "planner.pessimism")
WORST = ("text", "true", "null", "mapping", "list of huge numbers", "huge", "no number")
"""Those that tell most, for a quick look."""
GROUPS = ("sampler", "model", "world", "predictor", "tracker", "planner", "domain", "task")
PARTS = [(group, option) for group in GROUPS for option in options(group)]


def composed(*overrides: str, name: str = "config") -> DictConfig:
    """A config without Hydra's own part."""
    with initialize_config_dir(config_dir(), version_base="1.3"):
        return compose(name, list(overrides))


def keys(node: Any, prefix: str = "") -> Iterator[str]:
    """All keys below a node of a config: of leaves, of lists, and of mappings."""
    for key in node:
        yield f"{prefix}{key}"
        if isinstance(node._get_node(key), DictConfig) and not OmegaConf.is_missing(node, key):
            yield from keys(node[key], f"{prefix}{key}.")


def must_be_refused(key: str, default: Any, kind: str) -> bool:
    """Is that kind of value wrong, whatever the key is for, if this is its default?"""
    if kind == "null" and key in MAY_BE_NULL:
        return False
    if isinstance(default, bool):
        return kind in NO_SWITCHES
    if isinstance(default, int | float):
        return kind in NO_NUMBERS and not (kind == "large" and key.endswith("seed"))
    if isinstance(default, list):
        return kind in NO_LISTS
    if isinstance(default, dict):
        return not isinstance(VALUES[kind], dict | list)
    return False


def check_run(cfg: DictConfig) -> None:
    """All that is checked before a run writes anything."""
    config = validate(cfg)
    check_machine(config)
    make_model(cfg, config)


def complaints(
    cfg: DictConfig, only: str, check: Callable[[DictConfig], Any], kinds: Collection[str] = VALUES
) -> list[str]:
    """What is not as it should be, of all keys in and below `only`, given all kinds of values in turn."""
    found = []
    for key, kind in itertools.product(keys(cfg), kinds):
        if not f"{key}.".startswith(only):
            continue
        value, changed = VALUES[kind], cfg.copy()
        default = OmegaConf.select(cfg, key, throw_on_missing=False)
        default = OmegaConf.to_container(default) if OmegaConf.is_config(default) else default
        try:
            OmegaConf.update(changed, key, value, merge=False, force_add=True)
            check(changed)
        except MISTAKES as error:
            line = one_line(error)
            if not line.isprintable() or len(line) > 600:
                found.append(f"{key}={shown(value)}: not a line: {line[:200]!r}")
            elif key.partition(".")[0] not in line:
                found.append(f"{key}={shown(value)}: the key is not named: {line}")
        except BaseException as error:
            found.append(f"{key}={shown(value)}: a crash: {type(error).__name__}: {str(error)[:200]}")
        else:
            if must_be_refused(key, default, kind):
                found.append(f"{key}={shown(value)}: accepted")
    return found


def test_all_keys_of_a_run() -> None:
    assert complaints(composed(), "", check_run, WORST) == []


@pytest.mark.slow
def test_all_keys_of_a_run_given_all_values() -> None:
    assert complaints(composed(), "", check_run) == []


@pytest.mark.parametrize(
    ("group", "option"), [pytest.param(*part, marks=pytest.mark.slow) for part in PARTS], ids=map("-".join, PARTS)
)
def test_all_keys_of_an_option_given_all_values(group: str, option: str) -> None:
    choice = f"{group}=[{option}]" if group == "task" else f"{group}={option}"
    assert complaints(composed(choice), f"{group}.", check_run) == []


@pytest.mark.parametrize(
    ("name", "schema", "given", "unused"),
    [
        ("label", LabelConfig, ["plans=a.csv", "out=b.csv"], ["model", "task"]),
        ("plan", PlanConfig, ["objects=a.csv"], ["model"]),
        ("predict", PredictConfig, ["plans=a.csv", "out=b.csv"], ["model", "task"]),
        ("relabel", RelabelConfig, ["run=a", "plan=1", "labels='10'"], []),
        ("show", "apf.panda.commands.show.ShowConfig", ["tower=a.csv"], ["domain", "model", "task"]),
        ("sheets", "apf.panda.commands.sheets.SheetsConfig", ["blocks=a.csv"], []),
    ],
)
def test_all_keys_of_other_commands(name: str, schema: Any, given: list[str], unused: list[str]) -> None:
    if isinstance(schema, str):
        pytest.importorskip("pybullet")
        schema = get_class(schema)
    cfg = without(composed(*given, name=name), *unused)
    assert complaints(cfg, "", partial(build, schema=schema), WORST) == []


def test_the_look_at_values_sees_what_is_wrong() -> None:
    """A check that accepts all, one that crashes, and one that names no key are told."""

    def crash(cfg: DictConfig) -> None:
        raise ZeroDivisionError

    def mumble(cfg: DictConfig) -> None:
        raise InputError("something is wrong")

    cfg = composed()
    assert complaints(cfg, "threads.", lambda cfg: None, WORST) == [
        f"threads={shown(VALUES[kind])}: accepted" for kind in WORST
    ]
    for check, said in ((crash, "a crash: ZeroDivisionError"), (mumble, "the key is not named")):
        found = complaints(cfg, "threads.", check, WORST)
        assert len(found) == len(WORST)
        assert all(said in line for line in found)


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("threads=1000", ("threads is 1000", "cores")),
        ("threads=100000", ("threads is 100000", "less than or equal to 1000")),
        ("evaluation.problems=1e23", ("evaluation.problems", "less than or equal to 1000000")),
        ("seed=true", ("seed is true", "a number")),
        ("plans='\"12\"'", ("plans is '12'", "a number")),
        ("world.noise=1e12", ("world.noise", "less than or equal to 1")),
        ("domain.training.blocks=1e12", ("domain.training.blocks", "less than or equal to 10000")),
        ("evaluation.lengths=[2,2]", ("evaluation.lengths: 2 stands twice",)),
        ("planner.candidates=1e8", ("planner.candidates is 100000000", "GiB")),
        ("model.members=1000 model.network.hidden=4096", ("model", "GiB")),
        ("training.learning_rate=1 training.weight_decay=8", ("training.weight_decay", "8 plans")),
        ("execution.time_limit=1e-300", ("execution.time_limit",)),
        ("domain.mirror=1", ("domain.mirror is 1", "boolean")),
        ("domain.training.side=[0.1]", ("domain.training.side is [0.1]", "more values")),
        ("sweep=5", ("sweep is 5", 'sweep="5"')),
        ("sweep=", ("sweep",)),
        ("hydra.launcher.jobs=true -m", ("hydra.launcher.jobs is True",)),
        ("model.network._partial_=null", ("model.network._partial_ is null", "true or false")),
        ("model.network._partial_=false", ("model.network",)),
        ("+_partial_=true", ("_partial_", "no such key")),
        ("+_target_=os.getcwd", ("_target_", "no such key")),
        ("+initial._partial_=true", ("initial._partial_", "_target_")),
        ("+world._args_=[1]", ("world._args_", "no such key")),
        ("+world._recursive_=5", ("world._recursive_", "no such key")),
        ("+world._convert_=none", ("world._convert_", "no such key")),
        ("world._target_=null", ("world._target_ is null", "MODULE.CLASS")),
        ("world._target_=World", ("world._target_ is 'World'", "MODULE.CLASS")),
    ],
)
def test_refused_before_anything_is_written(here: Path, override: str, words: tuple[str, ...]) -> None:
    call(*TINY, "hydra.run.dir=runs/new", *shlex.split(override)).must_refuse(*words)
    assert list(here.iterdir()) == []


def test_a_number_may_be_written_in_any_way() -> None:
    """Whole, with a point or with an exponent: it is the number that counts."""
    for text in ("200", "200.0", "2e2"):
        config = validate(composed(f"plans={text}"))
        assert config.plans == 200
        assert type(config.plans) is int
    assert validate(composed("world.noise=0")).world.noise == 0.0
