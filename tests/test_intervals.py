"""Intervals of means over runs and problems."""

import numpy as np
import pandas as pd
import pytest

from analysis.intervals import over_runs_and_problems


def table(values: np.ndarray) -> pd.DataFrame:
    """A row for each of the values [R, P]."""
    runs, problems = np.indices(values.shape)
    return pd.DataFrame({"run": runs.ravel(), "problem": problems.ravel(), "regret": values.ravel()})


def test_an_interval_covers_the_mean_as_often_as_it_says() -> None:
    """Runs and problems both have effects of their own, of mean 0: an interval that knew of one alone is narrow."""
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(200):
        values = rng.normal(size=(16, 1)) + rng.normal(size=(1, 50)) + rng.normal(size=(16, 50))
        low, high = over_runs_and_problems(table(values), "regret")
        covered += low < 0 < high
    assert 0.88 < covered / 200 < 0.99


def test_what_is_not_known_counts_for_nothing() -> None:
    values = np.array([[0.25, np.nan, 0.25], [0.25, np.nan, np.nan]])
    assert over_runs_and_problems(table(values), "regret") == pytest.approx((0.25, 0.25))
    assert all(np.isnan(over_runs_and_problems(table(values * np.nan), "regret")))


def test_of_one_run_problems_are_drawn() -> None:
    """The mean of n values 0 and 1, half of each, has a standard error of 0.5 / sqrt(n)."""
    low, high = over_runs_and_problems(table(np.tile([0.0, 1.0], 50)[None]), "regret")
    assert low == pytest.approx(0.5 - 1.96 * 0.05, abs=0.01)
    assert high == pytest.approx(0.5 + 1.96 * 0.05, abs=0.01)
