import math
from collections import Counter
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from hydra.utils import instantiate
from omegaconf import OmegaConf
from pydantic import ValidationError

from apf.acquisition import Bald, ExpectedBald, Lengths, Random, RandomPlans, Sampler, top
from apf.config.values import config_dir
from apf.domain import Kind, Labelled, labels_from
from apf.towers import standing_prefixes

COMPLETE = ["complete", "random_comp"]
SUBSEQUENCE = ["greedy", "incremental", "random_ss", "sequential"]
NAMES = sorted(COMPLETE + SUBSEQUENCE)
CANDIDATES = 40
N = 4


def rng_of(seed):
    return np.random.default_rng(seed)


@cache
def sampler_of(name, candidates=CANDIDATES):
    cfg = OmegaConf.load(Path(config_dir()) / "sampler" / f"{name}.yaml")
    cfg.candidates.n = candidates
    return instantiate(cfg, _convert_="all")


class Recording:
    """A domain that remembers every batch of plans it drew: ("random", length, plans), ("extend", base, plans)."""

    def __init__(self, domain):
        self.domain = domain
        self.calls = []

    def random_plans(self, length, n, rng):
        plans = self.domain.random_plans(length, n, rng)
        self.calls.append(("random", length, plans))
        return plans

    def extend(self, base, rng):
        plans = self.domain.extend(base, rng)
        self.calls.append(("extend", base, plans))
        return plans

    def concatenate(self, parts):
        return self.domain.concatenate(parts)


class Silent:
    """A model that must not be asked."""

    def predict(self, plans):
        raise AssertionError("a random sampler asked the model")


def identity(plans, row=0):
    """One plan as something that can be compared and kept in a set."""
    return tuple(plans.block[row].tolist()), tuple(plans.rotation[row].tolist()), plans.xy[row].tobytes()


def rows(plans):
    return [identity(plans, row) for row in range(len(plans))]


def h(p):
    return -sum(q * math.log(q) for q in (p, 1 - p) if q > 0)


def bald_of(members):
    """BALD of a column of probabilities, one per member, by the definition."""
    return h(sum(members) / len(members)) - sum(map(h, members)) / len(members)


def last_bald(model, plans):
    return [bald_of(column) for column in model.predict(plans)[..., -1].T.tolist()]


def expected_bald(model, plans):
    """For each plan: BALD of each prefix times the chance that all before it stood."""
    scores = []
    for members in np.moveaxis(model.predict(plans), 0, -1).tolist():
        score, attempted = 0.0, 1.0
        for column in members:
            score += attempted * bald_of(column)
            attempted *= sum(column) / len(column)
        scores.append(score)
    return scores


def assert_best(found, pools, scores_of):
    """What was found are the N plans of highest score of all pools, the best first."""
    scored = [pair for pool in pools for pair in zip(scores_of(pool), rows(pool), strict=True)]
    best = sorted(scored, key=lambda pair: -pair[0])[:N]
    assert [identity(scored.plan) for scored in found] == [plan for _, plan in best]
    assert [scored.score for scored in found] == pytest.approx([score for score, _ in best])


@pytest.fixture(scope="module")
def labelled(domain):
    """Towers of two, three and five blocks as a run would have labelled them."""
    data = []
    for length, n in ((2, 30), (3, 30), (5, 400)):
        plans = domain.random_plans(length, n, rng_of(length))
        data.append(Labelled(plans, labels_from(standing_prefixes(plans))))
    return data


@pytest.fixture
def propose(domain, fake_ensemble, labelled):
    """`propose(name)`: what that sampler proposes, the domain that recorded how, and the model it asked."""

    def propose(name, seed=0, data=None, n=N, candidates=CANDIDATES, model=None):
        sampler, recording = sampler_of(name, candidates), Recording(domain)
        model = model or fake_ensemble(sampler.kind)
        found = sampler.propose(model, recording, labelled if data is None else data, n, rng_of(seed))
        return found, recording, model

    return propose


def test_the_papers_six_strategies_are_there_and_one_of_its_future_work():
    files = (Path(config_dir()) / "sampler").glob("*.yaml")
    assert {path.stem for path in files} == {*NAMES, "search"}


class TestStart:
    @pytest.mark.parametrize("name", SUBSEQUENCE)
    def test_subsequence_samplers_start_from_two_placements(self, domain, name):
        assert sampler_of(name).kind is Kind.SUBSEQUENCE
        start = sampler_of(name).start(domain, 7, rng_of(0))
        assert [scored.plan.length for scored in start] == [2] * 7

    @pytest.mark.parametrize("name", COMPLETE)
    def test_complete_samplers_start_from_two_to_five(self, domain, name):
        assert sampler_of(name).kind is Kind.COMPLETE
        start = sampler_of(name).start(domain, 40, rng_of(0))
        assert [scored.plan.length for scored in start] == [2] * 10 + [3] * 10 + [4] * 10 + [5] * 10

    @pytest.mark.parametrize("name", NAMES)
    def test_plans_are_single_different_unscored_and_fixed_by_the_seed(self, domain, name):
        first, again, other = (sampler_of(name).start(domain, 10, rng_of(seed)) for seed in (0, 0, 1))
        assert all(len(scored.plan) == 1 and math.isnan(scored.score) for scored in first)
        plans = [identity(scored.plan) for scored in first]
        assert len(set(plans)) == 10
        assert plans == [identity(scored.plan) for scored in again]
        assert plans != [identity(scored.plan) for scored in other]


@pytest.mark.parametrize("name", NAMES)
class TestAnySampler:
    def test_as_many_as_wanted_best_first(self, propose, name):
        for n in (1, 4, 10):
            found, _, _ = propose(name, n=n)
            assert len(found) == n
            assert all(len(scored.plan) == 1 for scored in found)
            scores = [scored.score for scored in found]
            assert scores == sorted(scores, reverse=True)

    def test_no_longer_than_it_says(self, propose, name):
        longest = sampler_of(name).max_length
        assert longest == 5
        assert all(2 <= scored.plan.length <= longest for scored in propose(name, n=10)[0])

    def test_a_seed_fixes_the_proposals(self, propose, name):
        first, again, other = (propose(name, seed=seed)[0] for seed in (3, 3, 4))
        assert [(identity(s.plan), s.score) for s in first] == [(identity(s.plan), s.score) for s in again]
        assert [identity(s.plan) for s in first] != [identity(s.plan) for s in other]

    def test_fewer_candidates_than_plans_wanted_is_no_problem(self, propose, name):
        assert len(propose(name, n=6, candidates=3)[0]) == 6


class TestComplete:
    def test_proposes_the_random_plans_of_highest_bald(self, propose):
        found, recording, model = propose("complete")
        pools = [plans for _, _, plans in recording.calls]
        assert [(how, length, len(plans)) for how, length, plans in recording.calls] == [
            ("random", length, 10) for length in (2, 3, 4, 5)
        ]
        assert_best(found, pools, partial(last_bald, model))


class TestSequential:
    def test_proposes_the_random_plans_of_highest_expected_bald(self, propose):
        found, recording, model = propose("sequential")
        pools = [plans for _, _, plans in recording.calls]
        assert [(how, length, len(plans)) for how, length, plans in recording.calls] == [
            ("random", length, 10) for length in (2, 3, 4, 5)
        ]
        assert_best(found, pools, partial(expected_bald, model))


class TestGreedy:
    def test_all_plans_have_the_longest_length(self, propose):
        assert [scored.plan.length for scored in propose("greedy", n=8)[0]] == [5] * 8

    def test_starts_from_the_best_plans_of_two(self, propose):
        _, recording, model = propose("greedy")
        (how, length, pool), (_, base, _) = recording.calls[:2]
        assert (how, length, len(pool)) == ("random", 2, CANDIDATES)
        best = np.argsort(-np.array(last_bald(model, pool)), kind="stable")[:N]
        assert rows(base) == [identity(pool, row) for row in best for _ in range(CANDIDATES // N)]

    def test_each_placement_is_the_best_of_its_branch(self, propose):
        found, recording, model = propose("greedy")
        extensions = recording.calls[1:]
        branches = CANDIDATES // N
        assert [how for how, _, _ in extensions] == ["extend"] * 3
        assert [plans.length for _, _, plans in extensions] == [3, 4, 5]
        chosen = []
        for step, (_, base, plans) in enumerate(extensions):
            if step:
                assert rows(base) == [plan for plan, _ in chosen for _ in range(branches)]
            chosen = []
            for branch in range(N):
                of_branch = range(branch * branches, (branch + 1) * branches)
                assert len({identity(base, row) for row in of_branch}) == 1
                scores = last_bald(model, plans[np.array(of_branch)])
                best = int(np.argmax(scores))
                chosen.append((identity(plans, of_branch[best]), scores[best]))
        final = sorted(chosen, key=lambda pair: -pair[1])
        assert [identity(scored.plan) for scored in found] == [plan for plan, _ in final]
        assert [scored.score for scored in found] == pytest.approx([score for _, score in final])

    def test_of_fewer_candidates_than_plans_each_plan_has_one_branch(self, propose):
        found, recording, _ = propose("greedy", n=6, candidates=3)
        assert [len(plans) for _, _, plans in recording.calls] == [6, 6, 6, 6]
        assert len(found) == 6

    def test_what_was_seen_to_stand_does_not_matter(self, propose):
        with_data, without = propose("greedy")[0], propose("greedy", data=[])[0]
        assert [identity(s.plan) for s in with_data] == [identity(s.plan) for s in without]


class TestIncremental:
    def test_builds_on_prefixes_that_stood_only(self, propose, labelled):
        stood = set()
        for group in labelled:
            for length in range(2, group.plans.length + 1):
                stood |= {
                    identity(group.plans.prefix(length), row)
                    for row in range(len(group.plans))
                    if group.labels[row, length - 1] == 1
                }
        found, recording, _ = propose("incremental", n=40, candidates=400)
        for scored in found:
            if scored.plan.length > 2:
                assert identity(scored.plan.prefix(scored.plan.length - 1)) in stood
        for how, base, plans in recording.calls[1:]:
            assert how == "extend"
            assert rows(plans.prefix(base.length)) == rows(base)
            assert base.length == 1 or set(rows(base)) <= stood
        # longer towers that fell at a later placement, and prefixes of three and four, are built on as well
        lengths = [base.length for _, base, _ in recording.calls[1:]]
        assert lengths == [1, 2, 3, 4]

    def test_new_towers_begin_with_random_placements(self, propose):
        _, recording, _ = propose("incremental")
        (how, length, drawn), (_, base, _) = recording.calls[:2]
        assert (how, length, len(drawn), base.length) == ("random", 1, CANDIDATES, 1)
        assert set(rows(base)) <= set(rows(drawn))

    def test_lengths_without_a_share_are_left_out(self, propose):
        _, recording, _ = propose("incremental", n=2, candidates=2)
        assert [(base.length, len(plans)) for how, base, plans in recording.calls if how == "extend"] == [
            (1, 1),
            (2, 1),
        ]

    def test_each_length_has_its_share_of_candidates(self, propose):
        _, recording, _ = propose("incremental", candidates=40)
        assert [len(plans) for how, _, plans in recording.calls if how == "extend"] == [10, 10, 10, 10]

    def test_proposes_the_candidates_of_highest_bald(self, propose):
        found, recording, model = propose("incremental")
        pools = [plans for how, _, plans in recording.calls if how == "extend"]
        assert_best(found, pools, partial(last_bald, model))

    def test_bases_are_drawn_evenly(self, propose, labelled):
        _, recording, _ = propose("incremental", candidates=40_000)
        base = next(base for how, base, _ in recording.calls if how == "extend" and base.length == 2)
        stood = sum(int((group.labels[:, 1] == 1).sum()) for group in labelled)
        uses = Counter(rows(base))
        mean = 10_000 / stood
        assert len(uses) == stood
        assert max(abs(count - mean) for count in uses.values()) < 5 * math.sqrt(mean)

    def test_without_data_it_starts_new_towers(self, propose):
        found, recording, _ = propose("incremental", data=[])
        assert [scored.plan.length for scored in found] == [2] * N
        assert [len(plans) for how, _, plans in recording.calls if how == "extend"] == [CANDIDATES]

    def test_towers_that_all_fell_are_not_built_on(self, propose, domain):
        plans = domain.random_plans(3, 20, rng_of(0))
        fell_at_once = Labelled(plans, np.tile(np.array([1, 0, -1], np.int8), (20, 1)))
        assert {scored.plan.length for scored in propose("incremental", data=[fell_at_once])[0]} == {2}
        fell_at_third = Labelled(plans, np.tile(np.array([1, 1, 0], np.int8), (20, 1)))
        found, recording, _ = propose("incremental", data=[fell_at_third], n=30)
        assert {base.length for how, base, _ in recording.calls if how == "extend"} == {1, 2}
        assert {scored.plan.length for scored in found} == {2, 3}

    def test_towers_of_the_longest_length_are_not_built_on(self, propose, domain):
        plans = domain.random_plans(5, 20, rng_of(0))
        stood = Labelled(plans, np.ones((20, 5), np.int8))
        _, recording, _ = propose("incremental", data=[stood])
        assert [base.length for how, base, _ in recording.calls if how == "extend"] == [1, 2, 3, 4]


@pytest.mark.parametrize("name", ["random_comp", "random_ss"])
class TestRandom:
    def test_the_model_is_never_asked(self, propose, name):
        found, _, _ = propose(name, model=Silent())
        assert len(found) == N

    def test_picks_among_random_plans_of_two_to_five(self, propose, name):
        found, recording, _ = propose(name)
        assert [(how, length, len(plans)) for how, length, plans in recording.calls] == [
            ("random", length, 10) for length in (2, 3, 4, 5)
        ]
        drawn = {plan for _, _, plans in recording.calls for plan in rows(plans)}
        assert {identity(scored.plan) for scored in found} <= drawn

    def test_every_length_is_as_likely(self, propose, name):
        lengths = [scored.plan.length for seed in range(100) for scored in propose(name, seed=seed, n=10)[0]]
        # 1000 plans, 250 of each length; sd sqrt(1000 * 0.25 * 0.75) = 13.7
        assert np.abs(np.bincount(lengths, minlength=6)[2:] - 250).max() < 5 * 13.7


GOLDEN = {
    "complete": [
        ([0, 4], [9, 11], 0.087466),
        ([5, 0, 1, 2], [7, 18, 21, 1], 0.086888),
        ([0, 2, 5, 1], [7, 23, 8, 2], 0.085705),
        ([4, 3, 5, 0, 2], [4, 12, 23, 2, 16], 0.085576),
    ],
    "greedy": [
        ([0, 4, 1, 3, 5], [7, 15, 2, 3, 20], 0.085687),
        ([4, 0, 2, 1, 3], [2, 0, 13, 2, 5], 0.083508),
        ([0, 4, 3, 1, 5], [1, 17, 23, 6, 23], 0.069303),
        ([3, 0, 5, 4, 1], [3, 12, 1, 5, 13], 0.048168),
    ],
    "incremental": [
        ([4, 1, 3, 0, 2], [3, 7, 21, 12, 14], 0.087158),
        ([0, 4, 2, 5, 1], [15, 7, 3, 10, 0], 0.087145),
        ([2, 3, 4], [12, 22, 13], 0.086266),
        ([3, 1, 5, 0], [19, 20, 10, 13], 0.086081),
    ],
    "random_comp": [
        ([1, 3, 5], [7, 22, 14], 0.99701),
        ([0, 4, 1, 2, 5], [17, 7, 7, 17, 8], 0.943678),
        ([1, 5], [13, 17], 0.933769),
        ([5, 0, 2, 3], [17, 13, 20, 9], 0.898824),
    ],
    "random_ss": [
        ([1, 3, 5], [7, 22, 14], 0.99701),
        ([0, 4, 1, 2, 5], [17, 7, 7, 17, 8], 0.943678),
        ([1, 5], [13, 17], 0.933769),
        ([5, 0, 2, 3], [17, 13, 20, 9], 0.898824),
    ],
    "sequential": [
        ([5, 0, 3, 1], [16, 1, 0, 18], 0.119358),
        ([4, 0, 1], [0, 7, 20], 0.114039),
        ([5, 0, 1, 2], [7, 18, 21, 1], 0.111106),
        ([0, 4], [9, 11], 0.087466),
    ],
}
"""Blocks, rotations and score of each proposal for seed 0, best first."""


@pytest.mark.parametrize("name", NAMES)
def test_golden_proposals(propose, name):
    found, _, _ = propose(name)
    shown = [(s.plan.block[0].tolist(), s.plan.rotation[0].tolist(), round(s.score, 6)) for s in found]
    assert shown == GOLDEN[name]


def test_of_equal_scores_the_earlier_plan_is_better(domain):
    pools = [domain.random_plans(length, 40, rng_of(length)) for length in (2, 3)]
    found = top(50, pools, lambda plans: np.where(np.arange(40) == 30, 1.0, 0.5))
    expected = [*rows(pools[0]), *rows(pools[1])]
    expected = [expected.pop(30), expected.pop(69), *expected][:50]
    assert [identity(scored.plan) for scored in found] == expected


class TestSettings:
    def test_expected_bald_needs_prefixes(self):
        parts = {"initial": {"min": 2, "max": 5}, "candidates": RandomPlans(n=10, lengths={"min": 2, "max": 5})}
        Sampler(kind="subsequence", score=ExpectedBald(), **parts)
        Sampler(kind="complete", score=Bald(), **parts)
        with pytest.raises(ValidationError, match="ExpectedBald needs kind=subsequence"):
            Sampler(kind="complete", score=ExpectedBald(), **parts)

    @pytest.mark.parametrize(
        "wrong", [{"min": 3, "max": 2}, {"min": 1, "max": 5}, {"min": 2}, {"min": 2, "max": 5, "n": 1}]
    )
    def test_wrong_lengths_are_refused(self, wrong):
        with pytest.raises(ValidationError):
            Lengths(**wrong)

    def test_wrong_kind_is_refused(self):
        candidates = RandomPlans(n=10, lengths={"min": 2, "max": 5})
        with pytest.raises(ValidationError, match="kind"):
            Sampler(kind="both", initial={"min": 2, "max": 2}, candidates=candidates, score=Random())

    def test_lengths_share_plans_as_evenly_as_can_be(self, domain):
        drawn = Lengths(min=2, max=5).draw(10, domain, rng_of(0))
        assert [(plans.length, len(plans)) for plans in drawn] == [(2, 3), (3, 3), (4, 2), (5, 2)]
        assert [plans.length for plans in Lengths(min=2, max=5).draw(3, domain, rng_of(0))] == [2, 3, 4]

    def test_max_length_is_that_of_candidates_or_start(self):
        def of(initial, longest):
            candidates = RandomPlans(n=10, lengths={"min": 2, "max": longest})
            return Sampler(kind="complete", initial={"min": 2, "max": initial}, candidates=candidates, score=Random())

        assert of(2, 5).max_length == 5
        assert of(6, 5).max_length == 6
