"""What to try next: BALD, where candidates come from, and the samplers made of them."""

from apf.acquisition.bald import bald, entropy, expected_bald
from apf.acquisition.batch import DiverseBatch
from apf.acquisition.candidates import (
    Candidates,
    FeasiblePrefixExtensions,
    GreedyExtensions,
    Lengths,
    RandomPlans,
    top,
)
from apf.acquisition.sampler import Sampler
from apf.acquisition.scores import Bald, ExpectedBald, Random, Score, Scorer
from apf.acquisition.search import PrefixSearch

__all__ = [
    "Bald",
    "Candidates",
    "DiverseBatch",
    "ExpectedBald",
    "FeasiblePrefixExtensions",
    "GreedyExtensions",
    "Lengths",
    "PrefixSearch",
    "Random",
    "RandomPlans",
    "Sampler",
    "Score",
    "Scorer",
    "bald",
    "entropy",
    "expected_bald",
    "top",
]
