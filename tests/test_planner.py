from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf
from pydantic import ValidationError

from apf.config.values import config_dir
from apf.domain import Predictor, Task
from apf.interrupts import time_limit
from apf.planning import MonteCarloPlanner
from apf.towers import AnalyticPredictor, Offset, Overhang, Tallest, Unsupported, random_towers, stands

ENOUGH = 20.0
"""Seconds for a plan that takes milliseconds: a search that gets nowhere fails, and does not hang."""

MANY = settings(max_examples=250)
chunks = st.sampled_from([1, 2, 7, 1024])


@dataclass(frozen=True)
class Plans:
    """Plans that are nothing but their numbers: row [N], chance of each prefix [N, K - 1], value [N]."""

    row: np.ndarray
    chance: np.ndarray
    value: np.ndarray

    def __len__(self):
        return len(self.row)

    @property
    def length(self):
        return self.chance.shape[1] + 1

    def __getitem__(self, rows):
        return Plans(self.row[rows], self.chance[rows], self.value[rows])

    def prefix(self, length):
        return Plans(self.row, self.chance[:, : length - 1], self.value)


class Worth(Task):
    unit = "m"

    def value(self, plans):
        return plans.value


class OtherWorth(Task):
    unit = "m"

    def value(self, plans):
        return plans.value.max() - plans.value + 1


class Whole(Predictor):
    """Knows the chances of whole plans only, and keeps what it was asked."""

    def __init__(self):
        self.asked = []

    def feasibility(self, plans, rng):
        self.asked.extend(plans.row.tolist())
        return plans.chance.prod(1)


class ByPrefix(Predictor):
    """Knows the chances prefix by prefix, and keeps what it was asked: (row, length)."""

    by_prefix = True

    def __init__(self):
        self.asked = []

    def feasibility(self, plans, rng):
        assert len(plans) == 1, "asked for whole plans"
        return plans.chance.prod(1)

    def last_feasibility(self, plans):
        self.asked.extend((int(row), plans.length) for row in plans.row)
        return plans.chance[:, -1]


def rounded(exact):
    """As a network does: the last bits depend on how many plans are scored at once, and on where in the batch."""
    n = len(exact)
    noise = np.sin(1000.0 * n + 7.0 * np.arange(n))
    return exact if n == 1 else (exact * (1 + 1e-7 * noise)).astype(np.float32)


class Members(ByPrefix):
    """Ten members, who agree on 0 and 1, and else spread around the mean; keeps how many were asked about a row."""

    members = 10

    def __init__(self):
        self.asked = {}

    def last_feasibility(self, plans, members=slice(None)):
        for row in plans.row:
            self.asked[int(row)] = self.asked.get(int(row), 0) + len(range(self.members)[members])
        mean = self.chance(plans)
        spread = np.linspace(-1, 1, self.members)[:, None] * np.minimum(mean, 1 - mean)
        return (mean + spread)[members].mean(0)

    def chance(self, plans):
        return plans.chance[:, -1]


class TwoMembers(Members):
    members = 2


class MembersOfWhole(Members):
    by_prefix = False

    def chance(self, plans):
        return plans.chance.prod(1)


class RoundingWhole(Whole):
    def feasibility(self, plans, rng):
        return rounded(super().feasibility(plans, rng))


class RoundingByPrefix(ByPrefix):
    def last_feasibility(self, plans):
        return rounded(super().last_feasibility(plans))


class Drawing(Predictor):
    """Another answer each time: the first time all plans are feasible, then none is."""

    random = True

    def __init__(self):
        self.asked = []

    def feasibility(self, plans, rng):
        self.asked.append(plans.row.tolist())
        return np.full(len(plans), 1.0 if len(self.asked) == 1 else 0.0)


def make(chance, value):
    """Plans of chance [N, K - 1] and value [N]."""
    return Plans(np.arange(len(chance)), np.array(chance, float), np.array(value, float))


def exhaustive(plans):
    """The first row of highest P x V, and that: every candidate is looked at."""
    best, best_row = -1.0, -1
    for row in range(len(plans)):
        p = 1.0
        for chance in plans.chance[row]:
            p *= chance
        if p * plans.value[row] > best:
            best, best_row = p * plans.value[row], row
    return best_row, best


def plan(plans, predictor, chunk=1024):
    planner = MonteCarloPlanner(candidates=len(plans), chunk=chunk)
    with time_limit(ENOUGH):
        return planner.plan(Worth(), planner.pool(plans, predictor, np.random.default_rng(0)))


@st.composite
def coarse_cases(draw):
    """Few different chances and values, exact in binary: plenty of exact ties, zeros and ones."""
    n, prefixes = draw(st.integers(1, 25)), draw(st.integers(1, 4))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    chance = rng.choice([0.0, 0.25, 0.5, 0.75, 1.0, 1.0, 1.0], (n, prefixes))
    return make(chance, rng.choice([0.0, 0.5, 1.0, 1.5, 3.0], n))


@st.composite
def fine_cases(draw):
    """Any chances and values, some of them near-equal within a few millionths."""
    n, prefixes = draw(st.integers(1, 60)), draw(st.integers(1, 4))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    chance = rng.beta(draw(st.sampled_from([0.3, 1.0, 8.0])), 0.5, (n, prefixes))
    value = rng.uniform(0.1, 0.5, n)
    copies = rng.integers(n, size=n)
    near = rng.random(n) < 0.3
    chance[near] = chance[copies][near]
    value[near] = value[copies][near] * (1 + 1e-6 * rng.normal(size=near.sum()))
    return make(chance, value)


@pytest.mark.parametrize("predictor", [ByPrefix, Whole, Members, TwoMembers, MembersOfWhole])
@pytest.mark.parametrize("chunk", [1, 3, 1024])
def test_every_search_ends(predictor, chunk):
    rng = np.random.default_rng(0)
    for share in (0.0, 0.5, 1.0):
        plans = make(np.where(rng.random((40, 3)) < share, 1.0, 0.5), rng.uniform(1, 2, 40))
        row, expected = exhaustive(plans)
        choice = plan(plans, predictor(), chunk)
        assert (choice.index, choice.expected) == (row, pytest.approx(expected))


@MANY
@given(plans=coarse_cases(), kind=st.sampled_from([ByPrefix, Whole]), chunk=chunks)
def test_the_first_of_the_best_is_chosen(plans, kind, chunk):
    choice = plan(plans, kind(), chunk)
    row, expected = exhaustive(plans)
    assert (choice.index, choice.expected, choice.value) == (row, expected, plans.value[row])


@MANY
@given(plans=fine_cases(), kind=st.sampled_from([ByPrefix, Whole]), chunk=chunks)
def test_the_best_is_chosen_also_if_others_are_almost_as_good(plans, kind, chunk):
    choice = plan(plans, kind(), chunk)
    row, expected = exhaustive(plans)
    assert choice.index == row
    assert choice.expected == pytest.approx(expected, rel=1e-12)
    assert choice.value == plans.value[row]


@MANY
@given(plans=st.one_of(coarse_cases(), fine_cases()), kind=st.sampled_from([RoundingByPrefix, RoundingWhole]))
def test_rounding_that_depends_on_the_batch_does_not_move_the_choice(plans, kind):
    row, expected = exhaustive(plans)
    for chunk in (1, 2, 7, 1024):
        choice = plan(plans, kind(), chunk)
        assert choice.index == row
        assert choice.expected == pytest.approx(expected, rel=1e-5)


@given(
    plans=coarse_cases(),
    kind=st.sampled_from([ByPrefix, Whole, RoundingByPrefix, RoundingWhole]),
    chunk=chunks,
)
def test_tasks_that_share_a_pool_do_not_disturb_each_other(plans, kind, chunk):
    planner = MonteCarloPlanner(candidates=len(plans), chunk=chunk)
    pool = planner.pool(plans, kind(), np.random.default_rng(0))
    first, second, first_again = (planner.plan(task, pool) for task in (Worth(), OtherWorth(), Worth()))
    assert (first.index, first.expected) == (first_again.index, first_again.expected)
    assert first.index == exhaustive(plans)[0]
    assert second.index == exhaustive(Plans(plans.row, plans.chance, OtherWorth().value(plans)))[0]


@pytest.mark.parametrize("predictor", [ByPrefix, Whole])
class TestEdges:
    def test_nothing_is_feasible(self, predictor):
        plans = make(np.zeros((9, 3)), np.arange(1, 10))
        choice = plan(plans, predictor(), chunk=2)
        assert (choice.index, choice.value, choice.expected) == (0, 1.0, 0.0)

    def test_everything_is_feasible(self, predictor):
        plans = make(np.ones((9, 3)), [1, 5, 2, 7, 7, 3, 7, 0, 1])
        choice = plan(plans, predictor(), chunk=2)
        assert (choice.index, choice.value, choice.expected) == (3, 7.0, 7.0)

    def test_nothing_is_worth_anything(self, predictor):
        asked = predictor()
        choice = plan(make(np.ones((4, 2)), np.zeros(4)), asked)
        assert (choice.index, choice.value, choice.expected) == (0, 0.0, 0.0)
        assert set(asked.asked) <= {0}, "of worthless plans, only the chosen one needs a look"

    def test_a_single_candidate(self, predictor):
        choice = plan(make([[0.5, 0.25]], [8]), predictor())
        assert (choice.index, choice.value, choice.expected) == (0, 8.0, 1.0)

    def test_chance_outweighs_value(self, predictor):
        # 10 * 0.25 = 2.5, 4 * 0.75 = 3, 3 * 1 = 3: the first of the two best, not the most valuable
        choice = plan(make([[0.5, 0.5], [0.75, 1], [1, 1]], [10, 4, 3]), predictor())
        assert (choice.index, choice.value, choice.expected) == (1, 4.0, 3.0)


class TestPruning:
    def test_plans_of_too_little_value_are_never_looked_at(self):
        # the first is worth 5 for sure; only what is worth more is looked at
        plans = make([[1.0, 1.0]] + [[0.5, 0.5]] * 4, [5, 6, 4.9, 4, 1])
        predictor = ByPrefix()
        assert plan(plans, predictor, chunk=1).index == 0
        assert {row for row, _ in predictor.asked} == {0, 1}

    def test_a_prefix_that_is_unlikely_ends_the_search_for_its_plan(self):
        # 7 * 0.5 = 3.5 is less than 5: once the first plan is known, the second's longer prefixes do not matter
        plans = make([[1.0, 0.5, 1.0], [0.5, 1.0, 1.0]], [10, 7])
        predictor = ByPrefix()
        assert plan(plans, predictor, chunk=1).index == 0
        assert {length for row, length in predictor.asked if row == 1} == {2}

    def test_members_are_asked_only_as_long_as_the_plan_may_win(self):
        # the first is found to be worth 8 * 0.75 = 6; once two of ten say 0 of the second, 7 * 0.8 is less than that
        plans = make([[0.75], [0.0], [1.0]], [8, 7, 5])
        predictor = Members()
        assert plan(plans, predictor, chunk=1).index == 0
        assert predictor.asked == {0: 10, 1: 2}

    @MANY
    @given(plans=coarse_cases(), kind=st.sampled_from([Members, TwoMembers, MembersOfWhole]), chunk=chunks)
    def test_asking_some_members_first_changes_nothing(self, plans, kind, chunk):
        choice = plan(plans, kind(), chunk)
        row, expected = exhaustive(plans)
        assert (choice.index if expected > 0 else 0, choice.expected) == (row, pytest.approx(expected, rel=1e-12))

    def test_no_prefix_is_asked_about_twice(self):
        rng = np.random.default_rng(0)
        plans = make(rng.uniform(0.8, 1, (50, 3)), rng.uniform(1, 1.1, 50))
        predictor = ByPrefix()
        planner = MonteCarloPlanner(candidates=50, chunk=7)
        pool = planner.pool(plans, predictor, np.random.default_rng(0))
        for task in (Worth(), OtherWorth(), Worth()):
            planner.plan(task, pool)
        assert len(predictor.asked) == len(set(predictor.asked)) > 50

    @pytest.mark.parametrize(("kind", "asked"), [(ByPrefix, 252), (Members, 692), (MembersOfWhole, 684), (Whole, 144)])
    def test_how_much_is_asked_of_a_problem(self, kind, asked):
        """A golden number: fewer are better; more, and the search has lost something of its economy."""
        rng = np.random.default_rng(0)
        plans = make(rng.beta(1, 0.3, (3000, 3)), rng.uniform(1, 2, 3000))
        predictor = kind()
        planner = MonteCarloPlanner(candidates=3000, first=16, chunk=500)
        planner.plan(Worth(), planner.pool(plans, predictor, np.random.default_rng(0)))
        of_members = isinstance(predictor, Members)
        assert (sum(predictor.asked.values()) if of_members else len(predictor.asked)) == asked

    def test_most_candidates_are_not_looked_at(self, blocks):
        towers = random_towers(blocks, 5, 20_000, np.random.default_rng(0), Offset(sd=0.25))

        class Counting(AnalyticPredictor):
            seen = 0

            def last_feasibility(self, plans):
                Counting.seen += len(plans)
                return super().last_feasibility(plans)

        planner = MonteCarloPlanner(candidates=20_000, chunk=100)
        choice = planner.plan(Tallest(), planner.pool(towers, Counting(), np.random.default_rng(0)))
        assert choice.index == int((stands(towers) * Tallest().value(towers)).argmax())
        assert 0 < Counting.seen < 5000


class TestPredictorsThatDraw:
    def test_all_candidates_are_asked_about_at_once(self):
        predictor = Drawing()
        plan(make(np.ones((5, 2)), [1, 2, 3, 4, 5]), predictor, chunk=2)
        assert predictor.asked == [[0, 1, 2, 3, 4]]

    def test_they_are_not_asked_again_about_plans_that_tie(self):
        predictor = Drawing()
        choice = plan(make(np.ones((5, 2)), [1, 3, 2, 3, 3]), predictor)
        assert predictor.asked == [[0, 1, 2, 3, 4]]
        assert (choice.index, choice.value, choice.expected) == (1, 3.0, 3.0)


@pytest.mark.parametrize("task", [Tallest(), Overhang(), Unsupported()], ids=lambda task: type(task).__name__)
@pytest.mark.parametrize("chunk", [3, 1024])
def test_with_towers_the_plan_is_the_best_that_stands(blocks, task, chunk):
    for seed in range(5):
        towers = random_towers(blocks, 4, 3000, np.random.default_rng(seed))
        planner = MonteCarloPlanner(candidates=3000, chunk=chunk)
        pool = planner.pool(towers, AnalyticPredictor(), np.random.default_rng(0))
        choice = planner.plan(task, pool)
        reward = np.where(stands(towers), task.value(towers), 0.0)
        assert choice.index == int(reward.argmax())
        assert choice.value == choice.expected == reward.max() > 0


def test_without_a_config_waves_are_those_of_the_default_config():
    default = OmegaConf.load(Path(config_dir()) / "planner" / "monte_carlo.yaml")
    planner = MonteCarloPlanner(candidates=default.candidates)
    assert (planner.candidates, planner.first, planner.chunk) == (default.candidates, default.first, default.chunk)


@pytest.mark.parametrize("wrong", [{"candidates": 0}, {"candidates": 10, "chunk": 0}, {"n": 10}])
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ValidationError):
        MonteCarloPlanner(**wrong)
