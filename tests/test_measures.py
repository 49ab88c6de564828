"""Accuracy, AUC, NLL and ECE against values worked out by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from apf.planning.measures import MEASURES, accuracy, auc, ece, nll, reliability

P = np.array([0.05, 0.2, 0.3, 0.45, 0.5, 0.75, 0.8, 0.95])
"""Predicted chances, which lie in the bins 0, 1, 2, 4, 4, 7, 7, 9: a bin holds its upper edge."""
Y = np.array([0, 0, 1, 0, 1, 1, 0, 1], bool)


def test_accuracy_by_hand() -> None:
    assert accuracy(P, Y) == 5 / 8, "wrong at 0.3, at 0.5, which is not above one half, and at 0.8"


def test_auc_by_hand() -> None:
    """Of the four that fail 0.3 beats two, 0.5 and 0.75 three each, 0.95 all."""
    assert auc(P, Y) == 12 / 16
    assert auc(np.array([0.4, 0.4]), np.array([True, False])) == 0.5, "a tie counts one half"


def test_nll_by_hand() -> None:
    expected = -math.log(0.95 * 0.8 * 0.3 * 0.55 * 0.5 * 0.75 * 0.2 * 0.95) / 8
    assert nll(P, Y) == pytest.approx(expected, abs=1e-12)
    assert nll(np.full(2, 0.5), np.array([True, False])) == pytest.approx(math.log(2))


def test_who_is_sure_and_wrong_pays_a_finite_price() -> None:
    assert nll(np.array([0.0, 1.0]), np.array([True, True])) == pytest.approx(-math.log(1e-6) / 2)
    assert nll(np.array([0.0, 1.0]), np.array([False, True])) == 0.0


def test_ece_by_hand() -> None:
    """Gaps: 0.05, 0.2, 0.7 and 0.05 of one plan; 0.025 and 0.275 of two, of which half succeed."""
    assert ece(P, Y) == pytest.approx((0.05 + 0.2 + 0.7 + 2 * 0.025 + 2 * 0.275 + 0.05) / 8)


def test_reliability_by_hand() -> None:
    found = reliability(P, Y)
    assert found.n.tolist() == [1, 1, 1, 0, 2, 0, 0, 2, 0, 1]
    np.testing.assert_allclose(found.predicted, [0.05, 0.2, 0.3, np.nan, 0.475, np.nan, np.nan, 0.775, np.nan, 0.95])
    np.testing.assert_allclose(found.observed, [0, 0, 1, np.nan, 0.5, np.nan, np.nan, 0.5, np.nan, 1])


def test_the_ends_have_a_bin() -> None:
    assert reliability(np.array([0.0, 0.1, 1.0]), np.array([False, False, True])).n.tolist() == [2, *[0] * 8, 1]


@pytest.mark.parametrize("success", [0.1, 0.5, 0.83])
def test_who_says_the_base_rate_is_calibrated(success: float) -> None:
    labels = np.arange(100) < round(100 * success)
    says = np.full(100, success)
    assert ece(says, labels) == pytest.approx(0, abs=1e-12)
    assert auc(says, labels) == 0.5


@given(st.lists(st.tuples(st.integers(0, 64), st.booleans()), min_size=2, max_size=40))
def test_bounds_and_order_of_the_plans(rows: list[tuple[int, bool]]) -> None:
    probability = np.array([0.5, 0.5, *(p / 64 for p, _ in rows)])
    labels = np.array([True, False, *(y for _, y in rows)])
    for name, measure in MEASURES.items():
        value = measure(probability, labels)
        assert 0 <= value <= (13.9 if name == "nll" else 1)
        assert measure(probability[::-1], labels[::-1]) == pytest.approx(value, abs=1e-9)
    assert auc(1 - probability, ~labels) == pytest.approx(auc(probability, labels))
