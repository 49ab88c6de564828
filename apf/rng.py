"""Named random streams: every draw comes from (seed, purpose, counters), never from global state."""

import hashlib

import numpy as np
import torch


def stream(seed: int, purpose: str, *counters: int) -> np.random.Generator:
    """A generator of its own for one purpose, e.g. `stream(seed, "world", step, index)`.

    Streams with different names or counters are independent, and adding a new one moves no other. A purpose always
    takes the same number of counters: a single 0 is not told from none.
    """
    name = int.from_bytes(hashlib.sha256(purpose.encode()).digest()[:8], "little")
    return np.random.default_rng(np.random.SeedSequence([seed, name, *counters]))


def torch_generator(rng: np.random.Generator) -> torch.Generator:
    """A CPU torch generator seeded by the next draw of `rng`."""
    return torch.Generator().manual_seed(int(rng.integers(2**63)))
