"""Intervals of means, by bootstrap."""

import numpy as np
import pandas as pd

DRAWS = 10_000
"""Samples of a bootstrap over runs."""
DRAWS_OF_BOTH = 1000
"""Samples of a bootstrap over runs and problems."""
MIDDLE = (2.5, 97.5)
"""Percentiles: the middle 95 %."""


def over_runs(values: np.ndarray) -> tuple[float, float]:
    """The 95 % interval of the mean of these values of runs [R]; NaN for fewer than two."""
    if len(values) < 2:
        return np.nan, np.nan
    means = np.random.default_rng(0).choice(values, (DRAWS, len(values))).mean(1)
    low, high = np.percentile(means, MIDDLE)
    return float(low), float(high)


def over_runs_and_problems(table: pd.DataFrame, column: str) -> tuple[float, float]:
    """The 95 % interval of the mean of a column, with both runs and problems drawn anew; of a run alone, problems.

    NaN where the column has no value, e.g. regret where no candidate succeeds, counts for nothing.

    Args:
        table: A row for each run and problem: columns run, problem, and `column`.
        column: What the mean is of.
    """
    values = table.pivot(index="run", columns="problem", values=column).to_numpy(float)
    rng, (runs, problems) = np.random.default_rng(0), values.shape
    known = ~np.isnan(values)
    filled = np.where(known, values, 0.0)
    weights_of_runs = rng.multinomial(runs, np.full(runs, 1 / runs), DRAWS_OF_BOTH)
    weights_of_problems = rng.multinomial(problems, np.full(problems, 1 / problems), DRAWS_OF_BOTH)
    counts = np.einsum("dr,rp,dp->d", weights_of_runs, known.astype(float), weights_of_problems, optimize=True)
    sums = np.einsum("dr,rp,dp->d", weights_of_runs, filled, weights_of_problems, optimize=True)
    if not known.any():
        return np.nan, np.nan
    low, high = np.percentile(sums[counts > 0] / counts[counts > 0], MIDDLE)
    return float(low), float(high)
