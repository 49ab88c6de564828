"""BALD: how much the outcome of an experiment would tell about the model (Section Entropy reduction).

Probabilities are arrays, or tensors on any device, which then does the arithmetic.
"""

import math

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor


def entropy(p: ArrayLike | Tensor) -> np.ndarray:
    """Entropy [nats] of a Bernoulli variable with probability p, any shape; exact 0 at p = 0 and p = 1."""
    return _entropy(_doubles(p)).numpy(force=True)


def bald(p: ArrayLike | Tensor) -> np.ndarray:
    """Mutual information between outcome and model, eq. (final-criterion): [E, ...] -> [...], in [0, ln 2] nats.

    p: each member's probability of success. The score is the entropy of the members' mean less the mean of their
    entropies: zero where all agree, ln 2 where half are sure of success and half of failure.
    """
    return _bald(_doubles(p)).numpy(force=True)


def expected_bald(p: ArrayLike | Tensor) -> np.ndarray:
    """What executing a plan is expected to tell: [E, N, K - 1] -> [N], the objective of `sequential`.

    p: each member's probability that prefix 2..K is feasible given that those before it were. The information
    of each prefix counts with the probability that it is attempted: that all prefixes before it stood,
    eq. (theta-ss).
    """
    p = _doubles(p)
    stood = p.mean(0).cumprod(-1)
    attempted = torch.cat([torch.ones_like(stood[..., :1]), stood[..., :-1]], -1)
    return (attempted * _bald(p)).sum(-1).numpy(force=True)


def _bald(p: Tensor) -> Tensor:
    return (_entropy(p.mean(0)) - _entropy(p).mean(0)).clamp_(0.0, math.log(2))


def _entropy(p: Tensor) -> Tensor:
    return torch.special.entr(p) + torch.special.entr(1 - p)


def _doubles(p: ArrayLike | Tensor) -> Tensor:
    return p.double() if isinstance(p, Tensor) else torch.as_tensor(np.ascontiguousarray(p), dtype=torch.float64)
