"""A batch of plans that do not all tell the same: joint mutual information, as in BatchBALD.

Kirsch, van Amersfoort and Gal, BatchBALD: Efficient and Diverse Batch Acquisition for Deep Bayesian Active Learning,
NeurIPS 2019.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from apf.acquisition.scores import Model, predicted
from apf.domain import Scored
from apf.settings import Many, settings


@settings
class DiverseBatch:
    """Of the best plans that were found, those whose outcomes together tell most about the model."""

    pool: Many
    """The best plans, of which the batch is chosen."""
    samples: Many = 1000
    """Joint outcomes of the plans chosen so far, drawn from the members' predictions, that information is a mean of."""

    def choose(self, n: int, found: Sequence[Scored], model: Model, rng: np.random.Generator) -> list[Scored]:
        """The plans of the batch, in the order in which they join it.

        Args:
            n: How many plans.
            found: The pool.
            model: Says what each member predicts of plans.
            rng: The source of all draws.
        """
        chances = [outcomes(predicted(model, each.plan)) for each in found]
        longest = max(chance.shape[-1] for chance in chances)
        padded = [np.pad(chance, ((0, 0), (0, 0), (0, longest - chance.shape[-1]))) for chance in chances]
        return [found[row] for row in most_informative(n, np.concatenate(padded, 1), self.samples, rng)]


def outcomes(p: ArrayLike) -> np.ndarray:
    """[E, N, P + 1] each member's chance that output 1..P is the first to be a failure, or that none is.

    Args:
        p: [E, N, P] each member's probability of each output, given that those before it were successes.
    """
    p = np.asarray(p)
    reached = np.cumprod(np.concatenate([np.ones_like(p[..., :1]), p], -1), -1)
    return np.concatenate([reached[..., :-1] * (1 - p), reached[..., -1:]], -1)


def most_informative(n: int, outcome: np.ndarray, samples: int, rng: np.random.Generator) -> list[int]:
    """Rows of the plans of highest joint mutual information between their outcomes and the member, found greedily.

    Each next plan is the one that adds most: eq. 8 of BatchBALD. The joint entropy is a mean over sampled outcomes of
    the plans that were chosen before, Section 3.3 there; the first plan's is exact.

    Args:
        n: How many plans.
        outcome: [E, N, O] each member's chance of each of O outcomes of N plans.
        samples: How many joint outcomes are drawn.
        rng: The source of all draws.
    """
    members, plans, kinds = outcome.shape
    own = _entr(outcome).sum(-1).mean(0)
    drawn_from = np.arange(samples) % members
    likelihood = np.ones((samples, members))  # of each sample's joint outcome so far, for each member
    chosen: list[int] = []
    left = np.ones(plans, bool)
    for _ in range(min(n, plans)):
        joint = (likelihood @ outcome.reshape(members, -1) / members).reshape(samples, plans, kinds)
        added = (_entr(joint).sum(-1) / likelihood.mean(1, keepdims=True)).mean(0) - own
        row = int(np.where(left, added, -np.inf).argmax())
        left[row] = False
        chosen.append(row)
        below = np.cumsum(outcome[drawn_from, row], -1) < rng.random((samples, 1))
        drawn = below[:, :-1].sum(-1)
        likelihood *= outcome[:, row, :].T[drawn]
    return chosen


def _entr(p: np.ndarray) -> np.ndarray:
    """-p log p, and 0 at p = 0."""
    return -p * np.log(p, where=p > 0, out=np.zeros_like(p))
