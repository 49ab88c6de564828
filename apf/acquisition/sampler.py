"""A sampling strategy: where candidates come from, how they are scored, and what is labelled."""

from collections.abc import Sequence

import numpy as np
from pydantic import model_validator

from apf.acquisition.candidates import Candidates, Lengths
from apf.acquisition.scores import ExpectedBald, Model, Score, Scorer
from apf.domain import Domain, Kind, Labelled, Scored
from apf.settings import settings


@settings
class Sampler:
    """One of the paper's strategies, or anybody's: the three choices that make it up."""

    kind: Kind
    """What is labelled and learned: `complete` plans (Theta_comp) or every `subsequence` (Theta_ss)."""
    initial: Lengths
    """The random plans that it starts from, before there is a model to ask."""
    candidates: Candidates
    score: Score

    @model_validator(mode="after")
    def _fits_kind(self) -> "Sampler":
        if isinstance(self.score, ExpectedBald) and self.kind is Kind.COMPLETE:
            raise ValueError("score ExpectedBald needs kind=subsequence: a complete model knows no prefixes")
        return self

    @property
    def max_length(self) -> int:
        """The longest plan it may propose or start from."""
        return max(self.candidates.max_length, self.initial.max)

    def start(self, domain: Domain, n: int, rng: np.random.Generator) -> list[Scored]:
        """Initial plans, the shortest first. Initial plans have no score (NaN).

        Args:
            domain: Of the plans.
            n: How many plans.
            rng: The source of all draws.
        """
        batches = self.initial.draw(n, domain, rng)
        return [Scored(batch[i : i + 1], float("nan")) for batch in batches for i in range(len(batch))]

    def propose(
        self, model: Model, domain: Domain, data: Sequence[Labelled], n: int, rng: np.random.Generator
    ) -> list[Scored]:
        """The most informative plans found, best first.

        Args:
            model: Says what each member predicts of plans.
            domain: Of the plans.
            data: All plans that were labelled so far.
            n: How many plans.
            rng: The source of all draws.
        """
        return self.candidates.best(n, Scorer(self.score, model, rng), domain, data, rng)
