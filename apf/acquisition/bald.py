"""BALD: how much the outcome of an experiment would tell about the model (Section Entropy reduction)."""

import numpy as np
import torch


def entropy(p: np.ndarray) -> np.ndarray:
    """Entropy [nats] of a Bernoulli variable with probability p, any shape; exact 0 at p = 0 and p = 1."""
    q = torch.as_tensor(np.ascontiguousarray(p), dtype=torch.float64)
    return torch.special.entr(q).add_(torch.special.entr(1 - q)).numpy()


def bald(p: np.ndarray) -> np.ndarray:
    """Mutual information between outcome and model, eq. (final-criterion): [E, ...] -> [...], in [0, ln 2] nats.

    p: each member's probability of success. The score is the entropy of the members' mean less the mean of their
    entropies: zero where all agree, ln 2 where half are sure of success and half of failure.
    """
    return np.clip(entropy(p.mean(0)) - entropy(p).mean(0), 0.0, np.log(2))


def expected_bald(p: np.ndarray) -> np.ndarray:
    """What executing a plan is expected to tell: [E, N, K - 1] -> [N], the objective of `sequential`.

    p: each member's probability that prefix 2..K is feasible given that those before it were. The information
    of each prefix counts with the probability that it is attempted: that all prefixes before it stood,
    eq. (theta-ss).
    """
    stood = np.cumprod(p.mean(0), axis=-1)
    attempted = np.concatenate([np.ones_like(stood[..., :1]), stood[..., :-1]], axis=-1)
    return (attempted * bald(p)).sum(-1)
