"""Evidence from runs of several sweeps together, which were evaluated in different ways."""

from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from analysis.evidence import Evidence
from apf.report.figures import Words
from apf.report.runs import Run
from apf.rundir.columns import ACCURACY_COLUMNS, REGRET_COLUMNS


@dataclass(frozen=True)
class Made(Run):
    """A run whose tables are at hand."""

    tables: dict[str, pd.DataFrame]

    def table(self, name: str) -> pd.DataFrame:
        return self.tables[name]


def made(sweep: str, seed: int, every: int, problems: int, sampler: str = "sequential", model: str = "tgn") -> Made:
    """A run of 120 towers, evaluated every so many."""
    at = list(range(every, 121, every))
    regret = [
        (0, towers, "tallest", problem, "noisy", 1.0, 0.9, 2.0, 0.5, True, 2.0, 0.5)
        for towers, problem in product(at, range(problems))
    ]
    accuracy = [(0, towers, length, 0.9, 0.95, 0.3, 0.05, 10) for towers, length in product(at, (2, 3))]
    tables = {
        "regret": pd.DataFrame(regret, columns=REGRET_COLUMNS),
        "accuracy": pd.DataFrame(accuracy, columns=ACCURACY_COLUMNS),
    }
    return Made(
        Path(f"{sweep}-{sampler}-{model}-{seed}"),
        {"sweep": sweep},
        {"sampler": sampler, "model": model},
        Words(),
        tables,
    )


def test_runs_of_accuracy_alone_say_nothing_of_regret() -> None:
    strategies = [made("strategies", seed, 60, 3, sampler) for sampler in ("sequential", "greedy") for seed in (0, 1)]
    architectures = [made("architectures", seed, 40, 0, model=model) for model in ("tgn", "lstm") for seed in (0, 1, 2)]
    evidence = Evidence.of([*strategies, *architectures])
    assert evidence.regrets("sequential", "tallest", 120, "noisy").shape == (2, 3)
    assert evidence.regrets("greedy", "tallest", 60, "noisy").shape == (2, 3)


def test_models_are_compared_by_runs_that_were_made_for_it() -> None:
    strategies = [made("strategies", seed, 60, 3, sampler) for sampler in ("sequential", "greedy") for seed in (0, 1)]
    architectures = [made("architectures", seed, 40, 0, model=model) for model in ("tgn", "lstm") for seed in (0, 1, 2)]
    evidence = Evidence.of([*strategies, *architectures])
    assert evidence.common_towers("tgn", "lstm") == [40, 80, 120]
    assert evidence.accuracies("tgn", 3, 80).shape == evidence.accuracies("lstm", 3, 80).shape == (3,)


def test_without_such_runs_those_at_hand_say_what_they_can() -> None:
    evidence = Evidence.of([made("strategies", seed, 60, 3) for seed in (0, 1)])
    assert evidence.accuracies("tgn", 2, 120).shape == (2,)


def longer(seed: int, plans: int) -> Made:
    """A run of greedy with evaluations up to so many plans; regret 0.5 and, in the last, 0.1."""
    run = made("strategies", seed, 60, 3, "greedy")
    regret = run.tables["regret"]
    regret.loc[regret["plans"] == 120, "regret"] = 0.1
    return replace(run, tables=run.tables | {"regret": regret[regret["plans"] <= plans]})


def test_an_evaluation_that_some_runs_had_counts_where_it_is_asked_for() -> None:
    evidence = Evidence.of([longer(0, 60), longer(1, 120), longer(2, 120)])
    assert evidence.common_towers("greedy") == [60]
    assert (evidence.count("greedy"), evidence.count("greedy", 60), evidence.count("greedy", 120)) == (3, 3, 2)
    assert evidence.count("greedy", 180) == evidence.count("sequential") == 0
    for drawn in (evidence, *(evidence.drawn(np.random.default_rng(seed)) for seed in range(30))):
        values = drawn.regrets("greedy", "tallest", 120, "noisy")
        assert 0 < len(values) <= 3
        assert np.isfinite(values).all(), "only runs that had it"
        assert len(drawn.regrets("greedy", "tallest", 60, "noisy")) == 3


def test_a_sweep_may_bring_its_own_way_of_an_option() -> None:
    ours, theirs = made("strategies", 0, 60, 3, "greedy"), made("published", 0, 60, 3, "published_greedy")
    assert set(Evidence.of([ours, theirs]).sources) == {"greedy"}
    assert Evidence.of([ours, theirs]).sources["greedy"] == [ours, theirs]
    elsewhere = made("strategies", 0, 60, 3, "published_greedy")
    assert set(Evidence.of([elsewhere]).sources) == {"published_greedy"}


def test_runs_of_different_problems_do_not_break_the_comparison() -> None:
    evidence = Evidence.of([made("a", 0, 60, 3), made("a", 1, 60, 3), made("a", 0, 60, 2, "greedy")])
    assert evidence.regrets("sequential", "tallest", 60, "noisy").shape == (2, 3)
    few = evidence.regrets("greedy", "tallest", 60, "noisy")
    assert few.shape == (1, 3)
    assert np.isnan(few[:, 2]).all()
