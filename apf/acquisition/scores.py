"""How informative is each candidate? The acquisition functions f: A -> R."""

from abc import ABC, abstractmethod
from typing import Any, Protocol

import numpy as np

from apf.acquisition.bald import bald, expected_bald
from apf.settings import settings


class Model(Protocol):
    """What a score asks of a model."""

    def predict(self, plans: Any) -> np.ndarray:
        """[E, N, P] each member's probabilities; see `apf.models.Ensemble.predict`."""
        ...


class Score(ABC):
    """An acquisition function."""

    @abstractmethod
    def __call__(self, model: Model, plans: Any, rng: np.random.Generator) -> np.ndarray:
        """[N] score of each plan, higher is better."""


@settings
class Bald(Score):
    """BALD of the last outcome: of the whole plan under Theta_comp, of the last prefix under Theta_ss."""

    def __call__(self, model: Model, plans: Any, rng: np.random.Generator) -> np.ndarray:
        return bald(model.predict(plans)[..., -1])


@settings
class ExpectedBald(Score):
    """BALD summed over all prefixes, each weighted by the chance that it is attempted (Theta_ss only)."""

    def __call__(self, model: Model, plans: Any, rng: np.random.Generator) -> np.ndarray:
        return expected_bald(model.predict(plans))


@settings
class Random(Score):
    """No opinion: a random choice among the candidates."""

    def __call__(self, model: Model, plans: Any, rng: np.random.Generator) -> np.ndarray:
        return rng.random(len(plans))
