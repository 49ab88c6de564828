"""Every preset, and every combination of model, sampler and world, composes, validates and runs a step."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig

from apf.commands.run import make_experiment, make_model
from apf.config.values import config_dir
from apf.domain import Kind
from apf.rundir.store import Store
from apf.schema import validate
from apf.tracking import NoTracker
from integration.command_line import TINY, options

PRESETS = ["smoke"]
MODELS = ["fcgn", "lstm", "tgn", "tgn_contact"]
SAMPLERS = ["complete", "greedy", "incremental", "random_comp", "random_ss", "search", "sequential"]
WORLDS = ["analytic", "noisy"]


def composed(*overrides: str) -> DictConfig:
    with initialize_config_dir(config_dir(), version_base="1.3"):
        return compose("config", [*overrides, *TINY, "plans=10"])


def run(cfg: DictConfig, directory: Path) -> Store:
    """One acquisition, as apf/commands/run.py does it. Returns the store of the run, open."""
    config = validate(cfg)
    store = Store(directory, config.domain)
    make_experiment(config, make_model(cfg, config), store, NoTracker()).run()
    return store


def must_have_run(store: Store, cfg: DictConfig) -> None:
    assert store.count(until=0) == 8
    assert store.count(until=1) == 10
    assert store.evaluated(1)
    _, scores = store.executed(1)
    assert len(scores) == 2
    assert np.isfinite(scores).all()
    assert len(store.regret()) == len(cfg.task) * len(cfg.evaluation.worlds)
    assert store.accuracy()["accuracy"].between(0, 1).all()
    assert store.weights(1).stat().st_size > 0


@pytest.mark.parametrize("preset", PRESETS)
def test_preset(preset: str, tmp_path: Path) -> None:
    cfg = composed(f"+experiment={preset}")
    store = run(cfg, tmp_path)
    must_have_run(store, cfg)
    store.close()


@pytest.mark.parametrize("preset", PRESETS)
def test_preset_as_it_stands_is_valid(preset: str) -> None:
    with initialize_config_dir(config_dir(), version_base="1.3"):
        validate(compose("config", [f"+experiment={preset}"]))


@pytest.mark.parametrize(
    ("group", "tested"),
    [
        ("experiment", PRESETS),
        ("model", MODELS),
        ("sampler", SAMPLERS),
        ("world", [*WORLDS, "panda"]),  # tests/panda has what is slow
        ("with_world", ["panda"]),
    ],
)
def test_every_option_is_tested_here(group: str, tested: list[str]) -> None:
    assert options(group) == tested


@pytest.mark.parametrize(("model", "sampler", "world"), list(product(MODELS, SAMPLERS, WORLDS)))
def test_combination(model: str, sampler: str, world: str, tmp_path: Path) -> None:
    cfg = composed(f"model={model}", f"sampler={sampler}", f"world={world}")
    store = run(cfg, tmp_path)
    must_have_run(store, cfg)
    lengths = store.plans().query("step == 1").groupby("tower").size()
    assert lengths.between(2, 5).all()
    if sampler == "greedy":
        assert (lengths == 5).all()
    store.close()


@pytest.mark.parametrize(("predictor", "world"), list(product(options("predictor"), WORLDS)))
def test_predictor_and_world_of_the_evaluation_compose(predictor: str, world: str) -> None:
    needed = ["predictor.run=run"] if predictor == "trained" else []
    config = validate(composed(f"predictor={predictor}", *needed, f"world@evaluation.worlds.noisy={world}"))
    assert type(config.evaluation.worlds["noisy"]).__name__.lower() == f"{world}world"
    assert predictor in type(config.predictor).__name__.lower()


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_kind_of_each_sampler(sampler: str) -> None:
    config = validate(composed(f"sampler={sampler}"))
    assert config.sampler.kind is (Kind.COMPLETE if sampler in ("complete", "random_comp") else Kind.SUBSEQUENCE)


def test_large_block_sets_have_no_block_twice() -> None:
    """The number of a block must hold any that the set may have."""
    domain = validate(composed("domain.training.blocks=200")).domain
    plans = domain.random_plans(5, 5000, np.random.default_rng(0))
    numbers = np.unique(plans.block)
    assert numbers.min() == 0
    assert numbers.max() == 199
    assert all(len(set(row)) == 5 for row in plans.block.tolist())
