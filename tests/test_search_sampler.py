"""The sampler that searches: against exhaustive search where plans can be counted, and a batch by joint information."""

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hydra.utils import instantiate
from omegaconf import OmegaConf
from pydantic import ValidationError

from apf.acquisition import (
    DiverseBatch,
    ExpectedBald,
    Lengths,
    PrefixSearch,
    Random,
    RandomPlans,
    Sampler,
    Scorer,
    bald,
    expected_bald,
)
from apf.acquisition.batch import most_informative, outcomes
from apf.config.values import config_dir
from apf.domain import Kind

DIGITS, LONGEST, MEMBERS = 3, 4, 6


@dataclass
class Numerals:
    """Plans that can be counted: N numerals of K digits."""

    digits: np.ndarray

    @property
    def length(self):
        return self.digits.shape[1]

    def __len__(self):
        return len(self.digits)

    def __getitem__(self, rows):
        return Numerals(self.digits[rows])


class Counting:
    """The domain of numerals. Random next digits come as often as each other, as far as that can be."""

    def random_plans(self, length, n, rng):
        every = np.array(list(product(range(DIGITS), repeat=length)))
        return Numerals(every[rng.permutation(np.arange(n) % len(every))])

    def extend(self, base, rng):
        place = np.arange(len(base)) % DIGITS
        return Numerals(np.column_stack([base.digits, place]))


class Table:
    """A model that says of each prefix what a table of random numbers says."""

    def __init__(self, seed):
        self.table = np.random.default_rng(seed).beta(0.5, 0.5, (MEMBERS, LONGEST + 1, DIGITS**LONGEST))

    def predict(self, plans):
        number = [plans.digits[:, :k] @ DIGITS ** np.arange(k) for k in range(2, plans.length + 1)]
        return np.stack([self.table[:, k, each] for k, each in enumerate(number, 2)], -1)


def rng():
    return np.random.default_rng(0)


def scorer(seed=0):
    return Scorer(ExpectedBald(), Table(seed), rng())


def every_plan():
    """All numerals, and the score of each."""
    plans = [Numerals(np.array(list(product(range(DIGITS), repeat=k)))) for k in range(2, LONGEST + 1)]
    return {tuple(row): score for each in plans for row, score in zip(each.digits.tolist(), scorer()(each))}


def found_by(search, n=1, seed=0):
    best = search.best(n, scorer(seed), Counting(), [], rng())
    return [(tuple(scored.plan.digits[0].tolist()), scored.score) for scored in best]


def test_with_room_for_all_prefixes_it_finds_what_exhaustive_search_finds():
    all_scores = every_plan()
    best = max(all_scores, key=lambda plan: all_scores[plan])
    ((found, score),) = found_by(PrefixSearch(n=1000, longest=LONGEST, beam=1000, feasible=0.0))
    assert found == best
    assert score == pytest.approx(all_scores[best])


def test_a_narrow_beam_finds_at_most_that_and_more_than_random_plans_of_the_same_number():
    exhaustive, narrow, random = [], [], []
    for seed in range(30):
        exhaustive.append(found_by(PrefixSearch(n=1000, longest=LONGEST, beam=1000, feasible=0.0), seed=seed)[0][1])
        narrow.append(found_by(PrefixSearch(n=27, longest=LONGEST, beam=3, feasible=0.0), seed=seed)[0][1])
        random.append(found_by(RandomPlans(n=27, lengths=Lengths(min=2, max=LONGEST)), seed=seed)[0][1])
    assert (np.array(narrow) <= np.array(exhaustive) + 1e-12).all()
    assert np.mean(random) < np.mean(narrow)


def test_prefixes_that_will_hardly_stand_are_not_extended():
    search, table = PrefixSearch(n=1000, longest=LONGEST, beam=1000, feasible=0.3), Table(0)
    plans = [plan for plan, _ in found_by(search, 1000)]
    assert {len(plan) for plan in plans} == {2, 3, 4}
    for plan in plans:
        for k in range(2, len(plan)):
            prefix = Numerals(np.array([plan[:k]]))
            assert table.predict(prefix).mean(0).prod() >= 0.3
    assert {len(plan) for plan, _ in found_by(PrefixSearch(n=1000, longest=LONGEST, beam=1000, feasible=1.0), 9)} == {2}


def test_as_many_as_wanted_even_of_fewer_candidates(domain, fake_ensemble):
    cfg = OmegaConf.load(Path(config_dir()) / "sampler" / "search.yaml")
    cfg.candidates.n = 3
    sampler = instantiate(cfg, _convert_="all")
    model = fake_ensemble(Kind.SUBSEQUENCE)
    found, again = (sampler.propose(model, domain, [], 7, rng()) for _ in range(2))
    assert len(found) == 7
    assert [s.plan.xy.tolist() for s in found] == [s.plan.xy.tolist() for s in again]
    assert sampler.max_length == 5


class TestBatch:
    def test_outcomes_are_the_first_failure_or_none(self):
        np.testing.assert_allclose(outcomes([[[0.9, 0.5, 0.25]]]), [[[0.1, 0.45, 0.9 * 0.5 * 0.75, 0.9 * 0.5 * 0.25]]])

    def test_the_first_plan_has_the_highest_information(self):
        p = np.random.default_rng(3).random((MEMBERS, 50, 1))
        assert most_informative(1, outcomes(p), 10, rng()) == [int(bald(p[..., 0]).argmax())]

    def test_a_copy_of_a_plan_waits_for_one_that_tells_something_else(self):
        one, other = [0.95, 0.95, 0.05, 0.05], [0.9, 0.1, 0.9, 0.1]
        p = np.array([one, one, one, other]).T[:, :, None]
        assert set(most_informative(2, outcomes(p), 2000, rng())) == {0, 3}
        assert np.argsort(-bald(p[..., 0]))[:2].tolist() != [0, 3]

    def test_joint_information_is_that_of_all_outcomes_counted(self):
        """The greedy choice of three plans agrees with mutual information by enumeration."""
        p = np.random.default_rng(5).beta(0.3, 0.3, (MEMBERS, 8, 2))
        outcome = outcomes(p)

        def information(rows):
            joint = np.stack(
                [
                    np.prod([outcome[:, row, o] for row, o in zip(rows, os)], 0)
                    for os in product(range(3), repeat=len(rows))
                ]
            )
            mean = joint.mean(1)
            return -(mean * np.log(mean)).sum() + (joint * np.log(joint)).sum() / MEMBERS

        greedy: list[int] = []
        for _ in range(3):
            rest = [row for row in range(8) if row not in greedy]
            greedy.append(max(rest, key=lambda row: information([*greedy, row])))
        assert most_informative(3, outcome, 20_000, rng()) == greedy

    def test_it_chooses_from_the_best_plans_alone(self):
        wide = PrefixSearch(n=1000, longest=LONGEST, beam=1000, feasible=0.0)
        best = {plan for plan, _ in found_by(wide, 12)}
        found = wide.best(12, scorer(), Counting(), [], rng())
        chosen = DiverseBatch(pool=12).choose(4, found, Table(0), rng())
        batch = [(tuple(scored.plan.digits[0].tolist()), scored.score) for scored in chosen]
        assert len(batch) == 4
        assert {plan for plan, _ in batch} <= best
        scores = every_plan()
        assert [score for _, score in batch] == pytest.approx([scores[plan] for plan, _ in batch])


def test_expected_bald_of_numerals_is_what_the_formula_says():
    plans = Numerals(np.array([[0, 1, 2]]))
    assert scorer()(plans) == pytest.approx(expected_bald(Table(0).predict(plans)))


def test_a_diverse_batch_needs_a_model_to_ask() -> None:
    with pytest.raises(ValidationError, match="batch needs a model, which score Random does not ask"):
        Sampler(
            kind=Kind.SUBSEQUENCE,
            initial=Lengths(min=2, max=2),
            candidates=RandomPlans(n=10, lengths=Lengths(min=2, max=3)),
            score=Random(),
            batch=DiverseBatch(pool=5),
        )
