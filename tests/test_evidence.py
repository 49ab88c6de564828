"""Evidence from runs of several sweeps together, which were evaluated in different ways."""

from dataclasses import dataclass
from itertools import product
from pathlib import Path

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
