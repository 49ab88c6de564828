"""What an evaluation says of predictors whose quality is known."""

from collections.abc import Callable

import numpy as np
import pytest

from apf.planning import Evaluator
from apf.planning.evaluation import EvaluationSettings
from apf.planning.planner import MonteCarloPlanner
from apf.predictor import Predictor
from apf.towers import TowerDomain, Towers, stands
from apf.worlds import AnalyticWorld


class Oracle(Predictor):
    """Knows which towers stand, and says something of it."""

    def __init__(self, says: Callable[[np.ndarray], np.ndarray]) -> None:
        self.says = says

    def feasibility(self, plans: Towers, rng: np.random.Generator | None = None) -> np.ndarray:
        return self.says(stands(plans))


@pytest.fixture
def evaluator(domain: TowerDomain) -> Evaluator:
    settings = EvaluationSettings(
        every=10, problems=0, blocks=3, lengths=[2, 3], test_towers=40, seed=0, worlds={"analytic": AnalyticWorld()}
    )
    return Evaluator(settings, domain, MonteCarloPlanner(candidates=10), {})


@pytest.mark.parametrize(
    ("says", "accuracy", "auc"),
    [
        (lambda stood: np.where(stood, 0.9, 0.1), 1.0, 1.0),
        (lambda stood: np.where(stood, 0.3, 0.1), 0.5, 1.0),  # in the right order, but sure of none
        (lambda stood: np.where(stood, 0.1, 0.9), 0.0, 0.0),
        (lambda stood: np.full(len(stood), 0.7), 0.5, 0.5),  # a tie with every other
        (lambda stood: np.where(stood, np.arange(len(stood)) % 2, 0.0), 0.75, 0.75),  # half of those that stand
    ],
)
def test_accuracy_asks_for_the_right_side_of_one_half_and_auc_for_the_right_order(
    evaluator: Evaluator, says: Callable[[np.ndarray], np.ndarray], accuracy: float, auc: float
) -> None:
    table = evaluator.accuracy(Oracle(says), step=3, towers=70)
    assert table["length"].tolist() == [2, 3]
    assert table["accuracy"].tolist() == [accuracy] * 2
    assert table["auc"].tolist() == [auc] * 2
    assert set(table["n"]) == {40}
