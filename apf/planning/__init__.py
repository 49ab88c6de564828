"""Planning with a predictor, and the evaluation of predictors."""

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
