"""Using a predictor: the planner, and how well it does with it."""

from apf.planning.evaluation import ACCURACY_COLUMNS, REGRET_COLUMNS, EvaluationSettings, Evaluator
from apf.planning.planner import Choice, MonteCarloPlanner

__all__ = [
    "ACCURACY_COLUMNS",
    "REGRET_COLUMNS",
    "Choice",
    "EvaluationSettings",
    "Evaluator",
    "MonteCarloPlanner",
]
