"""What to try next: BALD, where candidates come from, and the samplers made of them."""

from apf.acquisition.bald import bald, entropy, expected_bald
from apf.acquisition.candidates import (
    Candidates,
    FeasiblePrefixExtensions,
    GreedyExtensions,
    Lengths,
    RandomPlans,
    top,
)
from apf.acquisition.sampler import Sampler
from apf.acquisition.scores import Bald, ExpectedBald, Random, Score

__all__ = [
    "Bald",
    "Candidates",
    "ExpectedBald",
    "FeasiblePrefixExtensions",
    "GreedyExtensions",
    "Lengths",
    "Random",
    "RandomPlans",
    "Sampler",
    "Score",
    "bald",
    "entropy",
    "expected_bald",
    "top",
]
