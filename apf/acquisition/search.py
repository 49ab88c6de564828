"""Acquisition by search: prefixes that are grown where the model expects to learn (Section Conclusion, future work)."""

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from apf.acquisition.candidates import Candidates, best_of
from apf.acquisition.scores import Model, Scorer, predicted
from apf.domain import Domain, Labelled, Scored
from apf.settings import Length, Many, Number, settings


@settings
class PrefixSearch(Candidates):
    """Beam search over prefixes, which is pruned by their predicted feasibility.

    At each length, the prefixes of highest score are extended by random next placements. A prefix that will hardly be
    there to build on is not extended, whatever its score: what comes after a prefix can be learned only if the prefix
    stands. All prefixes that the search has scored are candidates.
    """

    n: Many
    """Prefixes that are scored, equally many of each length."""
    longest: Length
    beam: Many
    """Prefixes of each length that are extended, each by equally many next placements."""
    feasible: Annotated[Number, Field(ge=0, le=1)]
    """Least predicted chance of a prefix that is extended."""

    @property
    def max_length(self) -> int:
        """As `Candidates.max_length`."""
        return self.longest

    def best(
        self, n: int, score: Scorer, domain: Domain, data: Sequence[Labelled], rng: np.random.Generator
    ) -> list[Scored]:
        """As `Candidates.best`."""
        each = max(n, self.n // max(1, self.longest - 1))
        pools = [domain.random_plans(min(2, self.longest), each, rng)]
        scores = [score(pools[0])]
        while pools[-1].length < self.longest:
            order = np.argsort(-scores[-1], kind="stable")
            likely = order[chances(score.model, pools[-1])[order] >= self.feasible][: self.beam]
            if not len(likely):
                break
            branches = max(1, each // len(likely))
            pools.append(domain.extend(pools[-1][np.repeat(likely, branches)], rng))
            scores.append(score(pools[-1]))
        return best_of(n, pools, scores)


def chances(model: Model, plans: Any) -> np.ndarray:
    """[N] predicted chance of each plan: the mean over members for each output, then their product, eq. (theta-ss)."""
    return predicted(model, plans).mean(0).prod(-1)
