"""Using a predictor: the planner, and how well it does with it."""

from apf.planning.evaluation import EvaluationSettings, Evaluator
from apf.planning.learned import Learned
from apf.planning.planner import Choice, MonteCarloPlanner

__all__ = [
    "Choice",
    "EvaluationSettings",
    "Evaluator",
    "Learned",
    "MonteCarloPlanner",
]
