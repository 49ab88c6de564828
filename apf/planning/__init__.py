"""Planning with a predictor, and the evaluation of predictors."""

from apf.planning.alternatives import alternatives
from apf.planning.evaluation import EvaluationSettings, Evaluator, regret_table
from apf.planning.learned import Learned, Trained
from apf.planning.monte_carlo import MonteCarloPlanner
from apf.planning.planner import Choice, Planner, Problem
from apf.planning.search import SearchPlanner

__all__ = [
    "Choice",
    "EvaluationSettings",
    "Evaluator",
    "Learned",
    "MonteCarloPlanner",
    "Planner",
    "Problem",
    "SearchPlanner",
    "Trained",
    "alternatives",
    "regret_table",
]
