"""How good are predicted chances? Accuracy, and what explains it: order, likelihood and calibration."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd

BINS = 10
"""Bins of equal width, of a reliability diagram and of the calibration error."""
SURE = 1e-6
"""Least chance that the likelihood counts for an outcome: one plan costs at most 13.8 nats."""


class Reliability(NamedTuple):
    """A reliability diagram: for each bin the mean predicted chance [M], the share that succeeded [M], the plans [M].

    Mean and share of an empty bin are NaN.
    """

    predicted: np.ndarray
    observed: np.ndarray
    n: np.ndarray


def accuracy(probability: np.ndarray, labels: np.ndarray) -> float:
    """Share of plans that are called right at P > 1/2.

    Args:
        probability: [N] predicted chance that a plan succeeds.
        labels: [N] bool, whether it does.
    """
    return float(((probability > 0.5) == labels).mean())


def auc(probability: np.ndarray, labels: np.ndarray) -> float:
    """Area under the ROC curve: the chance that a feasible plan gets a higher probability than an infeasible one.

    Computed from the ranks of the feasible plans (Mann and Whitney 1947); ties count one half. It depends on the order
    of the plans alone, on no threshold.

    Args:
        probability: [N] predicted chance that a plan succeeds.
        labels: [N] bool, both values among them.
    """
    positives, negatives = labels.sum(), (~labels).sum()
    ranks = pd.Series(probability).rank().to_numpy()
    return float((ranks[labels].sum() - positives * (positives + 1) / 2) / (positives * negatives))


def nll(probability: np.ndarray, labels: np.ndarray) -> float:
    """Mean negative log-likelihood of the outcomes [nats]; ln 2 = 0.69 for who always says 1/2.

    The chance of an outcome counts as `SURE` at least, so that a predictor that says 0 or 1 has a finite value.

    Args:
        probability: [N] predicted chance that a plan succeeds.
        labels: [N] bool, whether it does.
    """
    of_outcome = np.where(labels, probability, 1 - np.asarray(probability, float))
    return float(-np.log(of_outcome.clip(SURE, 1.0)).mean()) + 0.0


def reliability(probability: np.ndarray, labels: np.ndarray, bins: int = BINS) -> Reliability:
    """What was predicted and what came of it, in bins of equal width: ((m - 1) / M, m / M], the first with 0.

    Args:
        probability: [N] predicted chance that a plan succeeds.
        labels: [N] bool, whether it does.
        bins: M.
    """
    edges = np.linspace(0, 1, bins + 1)
    place = np.searchsorted(edges[1:-1], np.asarray(probability, float), side="left")
    n = np.bincount(place, minlength=bins)
    with np.errstate(invalid="ignore"):
        predicted, observed = (np.bincount(place, values, bins) / n for values in (probability, labels))
    return Reliability(predicted, observed, n)


def ece(probability: np.ndarray, labels: np.ndarray) -> float:
    """Expected calibration error, in `BINS` = 10 bins of equal width of the predicted chance of success.

    sum_m |B_m| / N x |observed share of B_m - mean predicted chance of B_m| (Guo et al. 2017, On Calibration of Modern
    Neural Networks, Section 2, for a binary outcome: the chance of success takes the place of the confidence in the
    predicted class). It is the mean distance from the diagonal of the reliability diagram.

    Args:
        probability: [N] predicted chance that a plan succeeds.
        labels: [N] bool, whether it does.
    """
    found = reliability(probability, labels)
    return float(np.nansum(found.n * np.abs(found.observed - found.predicted)) / found.n.sum())


MEASURES: Mapping[str, Callable[[np.ndarray, np.ndarray], float]] = {
    "accuracy": accuracy,
    "auc": auc,
    "nll": nll,
    "ece": ece,
}
"""By the names of their columns in `accuracy.parquet`."""
