"""How informative is each candidate? The acquisition functions f: A -> R."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from torch import Tensor

from apf.acquisition.bald import bald, expected_bald
from apf.settings import settings

CHUNK = 16_384
"""Plans scored at once: what the members say of them is kept only so long, and memory stays small."""


class Model(Protocol):
    """What a score asks of a model."""

    def predict(self, plans: Any) -> Tensor | np.ndarray:
        """[E, N, P] each member's probabilities, on any device; see `apf.models.Ensemble.predict`."""
        ...


class Score(ABC):
    """An acquisition function."""

    asks_model: bool = True
    """Does it ask the model? If not, none is trained before plans are proposed."""

    @abstractmethod
    def __call__(self, model: Model, plans: Any, rng: np.random.Generator) -> np.ndarray:
        """[N] score of each plan, higher is better."""


@settings
class Bald(Score):
    """BALD of the last outcome: of the whole plan under Theta_comp, of the last prefix under Theta_ss."""

    def __call__(self, model: Model, plans: Any, rng: np.random.Generator) -> np.ndarray:
        """As `Score.__call__`."""
        return _in_chunks(lambda p: bald(p[..., -1]), model, plans)


@settings
class ExpectedBald(Score):
    """BALD summed over all prefixes, each weighted by the chance that it is attempted (Theta_ss only)."""

    def __call__(self, model: Model, plans: Any, rng: np.random.Generator) -> np.ndarray:
        """As `Score.__call__`."""
        return _in_chunks(expected_bald, model, plans)


@settings
class Random(Score):
    """No opinion: a random choice among the candidates."""

    asks_model = False

    def __call__(self, model: Model, plans: Any, rng: np.random.Generator) -> np.ndarray:
        """As `Score.__call__`."""
        return rng.random(len(plans))


@dataclass(frozen=True)
class Scorer:
    """An acquisition function together with whom it asks: plans of one length -> [N] scores."""

    score: Score
    model: Model
    rng: np.random.Generator

    def __call__(self, plans: Any) -> np.ndarray:
        """[N] score of each plan, higher is better."""
        return self.score(self.model, plans, self.rng)


def predicted(model: Model, plans: Any) -> np.ndarray:
    """[E, N, P] what each member predicts, in the memory of the CPU; see `apf.models.Ensemble.predict`."""
    p = model.predict(plans)
    return p.numpy(force=True) if isinstance(p, Tensor) else p


def _in_chunks(score: Callable[[Tensor | np.ndarray], np.ndarray], model: Model, plans: Any) -> np.ndarray:
    """[N] the score of what the members predict."""
    starts = range(0, max(len(plans), 1), CHUNK)
    return np.concatenate([score(model.predict(plans[start : start + CHUNK])) for start in starts])
