"""A sampling strategy: where candidates come from, how they are scored, and what is labelled."""

from collections.abc import Sequence

import numpy as np
from pydantic import model_validator

from apf.acquisition.batch import DiverseBatch
from apf.acquisition.candidates import Candidates, Lengths
from apf.acquisition.scores import ExpectedBald, Model, Score, Scorer
from apf.domain import Domain, Kind, Labelled, Scored
from apf.settings import settings


@settings
class Sampler:
    """One of the paper's strategies, or anybody's: the choices that make it up."""

    kind: Kind
    """What is labelled and learned: `complete` plans (Theta_comp) or every `subsequence` (Theta_ss)."""
    initial: Lengths
    """The random plans that it starts from, before there is a model to ask."""
    candidates: Candidates
    score: Score
    batch: DiverseBatch | None = None
    """How the plans to try are chosen of the best that were found; None: the very best."""

    @model_validator(mode="after")
    def _fits_kind(self) -> "Sampler":
        if isinstance(self.score, ExpectedBald) and self.kind is Kind.COMPLETE:
            raise ValueError("score ExpectedBald needs kind=subsequence: a complete model knows no prefixes")
        if self.batch and not self.score.asks_model:
            raise ValueError(f"batch needs a model, which score {type(self.score).__name__} does not ask")
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
        """The most informative plans found, best first; those of a diverse batch in the order in which they join it.

        Args:
            model: Says what each member predicts of plans.
            domain: Of the plans.
            data: All plans that were labelled so far.
            n: How many plans.
            rng: The source of all draws.
        """
        pool = max(n, self.batch.pool) if self.batch else n
        found = self.candidates.best(pool, Scorer(self.score, model, rng), domain, data, rng)
        return self.batch.choose(n, found, model, rng) if self.batch else found
