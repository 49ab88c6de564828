import math
import warnings

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from pretend_gpu import pretend_gpu

from apf.acquisition import bald, entropy, expected_bald

LN2 = math.log(2)
probabilities = st.floats(0, 1)
several = arrays(float, array_shapes(min_dims=2, max_dims=3, max_side=5), elements=probabilities)


def h(p):
    """Entropy of a Bernoulli variable [nats]."""
    return -sum(q * math.log(q) for q in (p, 1 - p) if q > 0)


@pytest.mark.parametrize(
    ("p", "nats"),
    [
        (0.5, 0.693147),  # ln 2
        (0.2, 0.500402),  # 0.2 * 1.609438 + 0.8 * 0.223144
        (0.25, 0.562335),  # 0.25 * 1.386294 + 0.75 * 0.287682
        (0.0, 0.0),
        (1.0, 0.0),
    ],
)
def test_entropy_by_hand(p, nats):
    assert entropy(np.array(p)) == pytest.approx(nats, abs=1e-6)


def test_entropy_is_exact_zero_at_the_ends():
    assert entropy(np.array([0.0, 1.0])).tolist() == [0.0, 0.0]


@given(p=probabilities)
def test_entropy_is_the_textbook_formula(p):
    assert entropy(np.array(p)) == pytest.approx(h(p), abs=1e-15)


@pytest.mark.parametrize(
    ("p", "nats"),
    [
        # entropy of the mean 0.5, ln 2 = 0.693147, less the entropy that both have, 0.500402
        ((0.2, 0.8), 0.192745),
        # mean 0.75: 0.562335, less half of ln 2
        ((0.5, 1.0), 0.215762),
        # mean 0.25: 0.562335, and each member is sure
        ((0.0, 0.0, 0.0, 1.0), 0.562335),
    ],
)
def test_bald_by_hand(p, nats):
    assert bald(np.array(p)[:, None]) == pytest.approx([nats], abs=1e-6)


@pytest.mark.parametrize("members", [2, 4, 10])
def test_half_sure_of_success_and_half_of_failure_tell_most(members):
    p = np.repeat([0.0, 1.0], members // 2)[:, None]
    assert bald(p) == pytest.approx([LN2], abs=1e-15)


@given(p=arrays(float, 7, elements=probabilities), members=st.integers(1, 10))
def test_members_that_agree_tell_nothing(p, members):
    np.testing.assert_allclose(bald(np.tile(p, (members, 1))), 0, atol=1e-14)


@given(p=several)
def test_bald_lies_between_zero_and_ln_2(p):
    score = bald(p)
    assert score.shape == p.shape[1:]
    assert ((score >= 0) & (score <= LN2)).all()


def test_rounding_never_makes_it_negative():
    p = np.random.default_rng(0).random(1000)
    assert min(bald(np.tile(p, (members, 1))).min() for members in range(2, 11)) == 0


def test_numbers_of_single_precision_are_added_up_in_double():
    p = np.array([[0.2], [0.8]], np.float32)
    low, high = p[:, 0].tolist()
    assert entropy(p).dtype == bald(p).dtype == np.float64
    assert entropy(p)[:, 0] == pytest.approx([h(low), h(high)], abs=1e-15)


@given(p=several, data=st.data())
def test_the_order_of_members_does_not_matter(p, data):
    order = data.draw(st.permutations(range(len(p))))
    np.testing.assert_allclose(bald(p[order]), bald(p), atol=1e-14)


@given(p=several)
def test_success_and_failure_are_alike(p):
    np.testing.assert_allclose(bald(1 - p), bald(p), atol=1e-13)


@given(p=several)
def test_bald_is_entropy_of_the_mean_less_mean_entropy(p):
    flat = p.reshape(len(p), -1)
    expected = [h(np.mean(column)) - np.mean([h(q) for q in column]) for column in flat.T]
    np.testing.assert_allclose(bald(p).ravel(), expected, atol=1e-13)


def test_certain_and_all_but_certain_members_give_numbers():
    values = [0.0, 1.0, 1e-300, 5e-324, 1 - 2**-53, 0.5]
    p = np.array([(a, b) for a in values for b in values]).T
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        score = bald(p)
    assert np.isfinite(score).all()
    same = p[0] == p[1]
    np.testing.assert_allclose(score[same], 0, atol=1e-15)
    assert score[(p[0] == 0.0) & (p[1] == 1.0)] == pytest.approx([LN2])
    assert score[(p[0] == 1e-300) & (p[1] == 1.0)] == pytest.approx([LN2])


def test_expected_bald_by_hand():
    # two members, one plan, three prefixes: the members' means are 0.8, 0.5, 0.5
    p = np.array([[[0.9, 0.5, 1.0]], [[0.7, 0.5, 0.0]]])
    # prefix 2: 0.500402 - (0.325083 + 0.610864) / 2 = 0.032429, attempted with 1
    # prefix 3: the members agree: 0, attempted with 0.8
    # prefix 4: ln 2, attempted with 0.8 * 0.5 = 0.4: 0.277259
    assert expected_bald(p) == pytest.approx([0.032429 + 0.277259], abs=2e-6)


def test_what_follows_a_certain_fall_does_not_count():
    p = np.array([[[0.0, 0.0]], [[0.0, 1.0]]])
    assert expected_bald(p).tolist() == [0.0]
    other_way_round = np.array([[[0.0, 0.0]], [[1.0, 0.0]]])
    assert expected_bald(other_way_round) == pytest.approx([LN2])


@given(p=arrays(float, st.tuples(st.integers(1, 4), st.integers(1, 4), st.just(1)), elements=probabilities))
def test_with_one_prefix_expected_bald_is_bald(p):
    np.testing.assert_array_equal(expected_bald(p), bald(p)[:, 0])


@given(p=arrays(float, st.tuples(st.integers(1, 4), st.integers(1, 3), st.integers(2, 4)), elements=probabilities))
def test_expected_bald_is_the_weighted_sum_over_prefixes(p):
    members, n, prefixes = p.shape
    for plan in range(n):
        total, attempted = 0.0, 1.0
        for prefix in range(prefixes):
            column = p[:, plan, prefix]
            mean = sum(column) / members
            total += attempted * (h(mean) - sum(map(h, column)) / members)
            attempted *= mean
        assert expected_bald(p)[plan] == pytest.approx(total, abs=1e-12)


def test_any_layout_of_memory_will_do() -> None:
    p = np.array([[0.1, 0.5], [0.9, 0.5]])
    np.testing.assert_allclose(bald(p[:, ::-1]), bald(p)[::-1])


@pytest.mark.parametrize("score", [entropy, bald, expected_bald])
def test_tensors_are_scored_where_they_lie(score):
    p = np.random.default_rng(0).random((3, 4, 2))
    with pretend_gpu():
        there = score(torch.tensor(p, device="cuda"))
    assert isinstance(there, np.ndarray)
    np.testing.assert_array_equal(there, score(p))
