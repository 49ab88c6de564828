"""The sweeps of the paper's figures and tables: each composes as it stands, and runs when scaled down."""

import re
from pathlib import Path

import pandas as pd
import pytest
import yaml
from hydra import compose, initialize_config_dir

from apf.config.values import config_dir
from apf.schema import validate
from integration.command_line import REPOSITORY, TINY, call

SWEEPS = REPOSITORY / "sweeps"
RUNS = {
    "architectures": 9,
    "baselines": 8,
    "beyond": 32,
    "early_stopping": 8,
    "packing": 15,
    "paper": 40,
    "predictors": 3,
    "published": 20,
    "robot_table": 6,
    "strategies": 16,
}
SEEDS = {
    "architectures": 3,
    "baselines": 4,
    "beyond": 16,
    "early_stopping": 2,
    "packing": 3,
    "paper": 8,
    "predictors": 1,
    "published": 4,
    "robot_table": 1,
    "strategies": 4,
}
SAMPLERS = {
    "packing": {"sequential", "incremental", "complete", "greedy", "random_ss"},
    "strategies": {"sequential", "incremental", "complete", "greedy"},
    "baselines": {"random_ss", "random_comp"},
    "paper": {"sequential", "incremental", "complete", "greedy", "random_ss"},
    "published": {
        "published_sequential",
        "published_incremental",
        "complete",
        "published_greedy",
        "published_random_ss",
    },
    "early_stopping": {"sequential", "greedy"},
}

LESS = {"robot_table": ("predictor=analytic", "world/flaws=worn", "task=[overhang]")}
"""A robot takes half a minute for a tower."""
WORLDS: dict[str, set[str]] = {"architectures": set(), "robot_table": {"analytic", "noisy", "panda"}}
"""Where the towers that were chosen are built."""


def test_every_sweep_is_tested() -> None:
    assert {path.stem for path in (SWEEPS / "experiment").glob("*.yaml")} == set(RUNS)


@pytest.mark.parametrize("name", RUNS)
def test_a_sweep_as_it_stands_is_valid(name: str) -> None:
    with initialize_config_dir(config_dir(), version_base="1.3"):
        overrides = [f"+experiment={name}"]
        cfg = compose("config", overrides, return_hydra_config=True)
        assert validate(compose("config", overrides)).sweep == name
    runs = 1
    for values in cfg.hydra.sweeper.params.values():
        seeds = re.fullmatch(r"range\((\d+),(\d+)\)", values)
        runs *= int(seeds[2]) - int(seeds[1]) if seeds else len(values.split(","))
    assert runs == RUNS[name]


@pytest.mark.parametrize("name", ["paper", "published"])
def test_each_seed_has_sets_and_problems_of_its_own(name: str) -> None:
    with initialize_config_dir(config_dir(), version_base="1.3"):
        configs = [validate(compose("config", [f"+experiment={name}", f"seed={seed}"])) for seed in (10, 11)]
    sets = [digest for config in configs for digest in config.domain.digests.values()]
    assert len(set(sets)) == 4
    assert [config.evaluation.seed for config in configs] == [10, 11]


@pytest.mark.parametrize("name", ["sequential", "incremental", "greedy", "random_ss"])
def test_a_sampler_of_the_published_code_differs_in_what_it_says(name: str) -> None:
    with initialize_config_dir(config_dir(), version_base="1.3"):
        theirs = validate(compose("config", ["+experiment=published", f"sampler=published_{name}"])).sampler
        ours = validate(compose("config", [f"sampler={name}"])).sampler
    assert (theirs.initial, type(theirs.score), theirs.max_length) == (ours.initial, type(ours.score), 5)
    assert theirs.kind == ("whole" if name == "incremental" else "subsequence")
    assert theirs.candidates.n == 10_000
    assert theirs.candidates != ours.candidates


@pytest.mark.slow
@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("name", RUNS)
def test_a_sweep_scaled_down(name: str, here: Path) -> None:
    sweep = ("-m", f"+experiment={name}", "hydra/launcher=basic", *LESS.get(name, ()))
    one_seed = ("hydra.sweeper.params.seed=0",) if SEEDS[name] > 1 else ()
    its_own = ("evaluation.lengths", "evaluation.every", *(["evaluation.problems"] if name == "architectures" else []))
    small = [word for word in TINY if not word.startswith(its_own)]
    small += ["training.epochs=1"] if name in ("paper", "published") else []
    small += ["acquisition.rehearsed=1"] if name == "beyond" else []
    call(*sweep, *one_seed, *small, "model.network.hidden=4").must_work()
    runs = [path for path in (here / "runs" / name).iterdir() if path.is_dir()]
    assert len(runs) == (1 if name in LESS else RUNS[name] // SEEDS[name])
    states = [yaml.safe_load((run / "run.yaml").read_text()) for run in runs]
    assert all(state["finished"] for state in states)
    if name in SAMPLERS:
        assert {state["choices"]["sampler"] for state in states} == SAMPLERS[name]
    for run in runs:
        accuracy, regret = (pd.read_parquet(run / f"{table}.parquet") for table in ("accuracy", "regret"))
        assert set(accuracy["length"]) == ({2, 3, 4, 5} if name in ("packing", "beyond") else {2, 3, 4, 5, 6, 7})
        assert set(regret["world"]) == WORLDS.get(name, {"analytic", "noisy"})
