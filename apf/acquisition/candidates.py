"""Where candidates come from: A-hat, and how the best of them are found (Section Sampling Strategies)."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydantic import model_validator

from apf.acquisition.scores import Scorer
from apf.domain import Domain, Labelled, Scored
from apf.settings import Length, Many, settings


@settings
class Lengths:
    """Plans of `min` to `max` placements, equally many of each."""

    min: Length
    max: Length

    @model_validator(mode="after")
    def _ordered(self) -> "Lengths":
        if self.min > self.max:
            raise ValueError(f"min is {self.min}; it must not exceed max, {self.max}")
        return self

    def draw(self, n: int, domain: Domain, rng: np.random.Generator) -> list[Any]:
        """Random plans: one batch per length, of as equal sizes as possible.

        Args:
            n: How many plans.
            domain: Of the plans.
            rng: The source of all draws.
        """
        lengths = range(self.min, self.max + 1)
        shares = np.array_split(np.arange(n), len(lengths))
        return [domain.random_plans(k, len(part), rng) for k, part in zip(lengths, shares, strict=True) if len(part)]


class Candidates(ABC):
    """A way to look for the most informative plans."""

    @property
    @abstractmethod
    def max_length(self) -> int:
        """The longest plan it may find."""

    @abstractmethod
    def best(
        self, n: int, score: Scorer, domain: Domain, data: Sequence[Labelled], rng: np.random.Generator
    ) -> list[Scored]:
        """The best plans found, best first.

        Args:
            n: How many plans.
            score: Plans of one length -> [N] scores; knows the model.
            domain: Of the plans.
            data: All plans that were labelled so far.
            rng: The source of all draws.
        """


def top(n: int, pools: Sequence[Any], score: Scorer) -> list[Scored]:
    """The plans of highest score among all pools, best first; ties go to the earlier plan.

    Args:
        n: How many plans.
        pools: Batches of plans, each of one length.
        score: Plans of one length -> [N] scores.
    """
    return best_of(n, pools, [score(pool) for pool in pools])


def best_of(n: int, pools: Sequence[Any], scores: Sequence[np.ndarray]) -> list[Scored]:
    """As `top`, of plans whose scores are known.

    Args:
        n: How many plans.
        pools: Batches of plans, each of one length.
        scores: [N] of each batch.
    """
    pool_of = np.repeat(np.arange(len(pools)), [len(s) for s in scores])
    row_of = np.concatenate([np.arange(len(s)) for s in scores])
    flat = np.concatenate(scores)
    order = np.argsort(-flat, kind="stable")[:n]
    return [Scored(pools[pool_of[i]][row_of[i] : row_of[i] + 1], float(flat[i])) for i in order]


@settings
class RandomPlans(Candidates):
    """Complete plans, drawn at random from A."""

    n: Many
    lengths: Lengths

    @property
    def max_length(self) -> int:
        """As `Candidates.max_length`."""
        return self.lengths.max

    def best(
        self, n: int, score: Scorer, domain: Domain, data: Sequence[Labelled], rng: np.random.Generator
    ) -> list[Scored]:
        """As `Candidates.best`."""
        return top(n, self.lengths.draw(max(n, self.n), domain, rng), score)


@settings
class GreedyExtensions(Candidates):
    """Plans built one placement at a time, each the best next one given that all before it are in place.

    The search starts from the best two-placement plans. Every plan then gets its share of `n` random next placements
    and keeps the one of highest score, whether or not the plan up to there is feasible.
    """

    n: Many
    longest: Length

    @property
    def max_length(self) -> int:
        """As `Candidates.max_length`."""
        return self.longest

    def best(
        self, n: int, score: Scorer, domain: Domain, data: Sequence[Labelled], rng: np.random.Generator
    ) -> list[Scored]:
        """As `Candidates.best`."""
        found = top(n, [domain.random_plans(2, max(n, self.n), rng)], score)
        branches = max(1, self.n // n)
        for _ in range(2, self.longest):
            plans = domain.concatenate([scored.plan for scored in found])
            extended = domain.extend(plans[np.repeat(np.arange(n), branches)], rng)
            scores = score(extended).reshape(n, branches)
            best = scores.argmax(1)
            chosen = extended[np.arange(n) * branches + best]
            found = [Scored(chosen[i : i + 1], float(scores[i, best[i]])) for i in range(n)]
        return sorted(found, key=lambda scored: -scored.score)


@settings
class FeasiblePrefixExtensions(Candidates):
    """One random placement after a prefix that was seen to succeed: (a_1..a_n-1, phi = 1) in D.

    A single placement succeeds by assumption, so new plans can begin. Each length gets the same share of the `n`
    candidates, as far as the data hold prefixes of it.
    """

    n: Many
    longest: Length

    @property
    def max_length(self) -> int:
        """As `Candidates.max_length`."""
        return self.longest

    def best(
        self, n: int, score: Scorer, domain: Domain, data: Sequence[Labelled], rng: np.random.Generator
    ) -> list[Scored]:
        """As `Candidates.best`."""
        bases = {1: domain.random_plans(1, max(n, self.n), rng)}
        for length in range(2, self.longest):
            stood = [g.plans[g.labels[:, length - 1] == 1].prefix(length) for g in data if g.plans.length >= length]
            if sum(map(len, stood)):
                bases[length] = domain.concatenate(stood)
        shares = np.array_split(np.arange(max(n, self.n)), len(bases))
        picks = [
            base[rng.integers(len(base), size=len(share))] for base, share in zip(bases.values(), shares, strict=True)
        ]
        return top(n, [domain.extend(pick, rng) for pick in picks if len(pick)], score)
