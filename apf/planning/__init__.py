"""Planning with a predictor, and the evaluation of predictors."""

from apf.planning.evaluation import EvaluationSettings, Evaluator, regret_table
from apf.planning.learned import Learned
from apf.planning.monte_carlo import MonteCarloPlanner
from apf.planning.planner import Choice, Planner, Problem

__all__ = [
    "Choice",
    "EvaluationSettings",
    "Evaluator",
    "Learned",
    "MonteCarloPlanner",
    "Planner",
    "Problem",
    "regret_table",
]
