"""Plans that the planner would choose, tried while the model is learned."""

from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig

from apf.config.values import config_dir
from apf.domain import Predictor
from apf.errors import InputError
from apf.planning import EvaluationSettings, Evaluator, MonteCarloPlanner
from apf.schema import validate
from apf.towers import AnalyticWorld, Overhang, Tallest, TowerDomain, Towers, stands
from integration.command_line import TINY, call
from integration.test_combinations import run

TASKS = {"tallest": Tallest(), "overhang": Overhang()}
CANDIDATES = 200


def after_tiny(*overrides: str) -> DictConfig:
    """The config of a tiny run with other values."""
    with initialize_config_dir(config_dir(), version_base="1.3"):
        return compose("config", [*TINY, *overrides])


class Knows(Predictor):
    """Knows which towers stand, and keeps what it was asked."""

    def __init__(self) -> None:
        self.asked: list[Towers] = []

    def feasibility(self, plans: Towers, rng: np.random.Generator | None = None) -> np.ndarray:
        self.asked.append(plans)
        return stands(plans).astype(float)


@pytest.fixture
def evaluator(domain: TowerDomain) -> Evaluator:
    settings = EvaluationSettings(
        every=10, problems=0, length=3, lengths=[2], test_plans=0, seed=0, worlds={"analytic": AnalyticWorld()}
    )
    return Evaluator(settings, domain, MonteCarloPlanner(candidates=CANDIDATES), TASKS)


def test_each_plan_is_the_best_of_a_problem_of_its_own_for_one_of_the_tasks(
    evaluator: Evaluator, domain: TowerDomain
) -> None:
    knows = Knows()
    plans = evaluator.rehearse(knows, 4, np.random.default_rng(3))
    assert [len(plan) for plan in plans] == [1] * 4
    assert [len(candidates) for candidates in knows.asked] == [CANDIDATES] * 4
    assert set().union(*(candidates.blocks.name for candidates in knows.asked)) <= set(domain.training_blocks.name)
    assert len({tuple(candidates.blocks.name) for candidates in knows.asked}) > 1, "not always the same blocks"
    won = Counter()
    for plan, candidates in zip(plans, knows.asked):
        standing = candidates[stands(candidates)]
        for name, task in TASKS.items():
            won[name] += bool(task.value(plan)[0] == task.value(standing).max())
    assert min(won.values()) >= 2, "two plans for each task"


def test_the_tasks_come_in_an_order_that_is_drawn(evaluator: Evaluator, domain: TowerDomain) -> None:
    def first(seed: int) -> bool:
        """Is it of the task of tallest towers?"""
        [plan] = evaluator.rehearse(knows := Knows(), 1, np.random.default_rng(seed))
        candidates = domain.concatenate(knows.asked)
        return bool(Tallest().value(plan)[0] == Tallest().value(candidates[stands(candidates)]).max())

    assert len({first(seed) for seed in range(12)}) == 2


def test_a_share_of_each_acquisition_is_rehearsed(tmp_path: Path) -> None:
    """The others are proposed as ever, and come first."""
    tried = []
    for rehearsed in (0, 1):
        with_length_4 = ("evaluation.length=4", "acquisition.plans=4", "plans=12", f"acquisition.rehearsed={rehearsed}")
        directory = tmp_path / f"{rehearsed}"
        directory.mkdir()
        store = run(after_tiny(*with_length_4), directory)
        _, scores = store.executed(1)
        assert len(scores) == 4
        assert np.isfinite(scores).all(), "each has the score that the sampler would give it"
        store.export()
        table = pd.read_parquet(directory / "plans.parquet").query("step == 1")
        tried.append(table.groupby("tower", sort=False)["block"].agg(tuple).tolist())
        store.close()
    assert tried[0][:3] == tried[1][:3]
    assert tried[0][3] != tried[1][3]
    assert len(tried[1][3]) == 4, "as long as the plans of problems"


def test_whoever_asks_no_model_needs_one_to_rehearse(tmp_path: Path) -> None:
    store = run(after_tiny("plans=10", "sampler=random_ss", "acquisition.rehearsed=1"), tmp_path)
    assert store.training(0), "the model learned from the first plans"
    store.close()


def test_a_run_that_is_made_longer_rehearses_the_same(here: Path) -> None:
    more = ("acquisition.rehearsed=1", "domain=packing")
    call(*TINY, *more, "hydra.run.dir=whole").must_work()
    call(*TINY, *more, "plans=10", "hydra.run.dir=parts").must_work()
    call(*TINY, *more, "hydra.run.dir=parts").must_work()
    one, other = (pd.read_parquet(f"{run}/plans.parquet") for run in ("whole", "parts"))
    pd.testing.assert_frame_equal(one, other, check_exact=True)


def test_plans_of_problems_must_fit_the_objects_of_the_experiment() -> None:
    few = ("acquisition.rehearsed=1", "domain.training.blocks=5", "evaluation.length=6", "evaluation.lengths=[2]")
    with pytest.raises(InputError, match=r"^evaluation\.length \(acquisition\.rehearsed\)"):
        validate(after_tiny(*few))
    validate(after_tiny(*few[1:]))
