"""What a domain of plans must bring (appendix, Method Generalizability), and what all others know of it."""

from apf.domain.domain import Domain, Objects
from apf.domain.oracle import Oracle
from apf.domain.plans import UNOBSERVED, Kind, Labelled, NamedPlans, Plans, Scored
from apf.domain.predictor import Predictor
from apf.domain.task import Task
from apf.domain.world import Outcome, World, are_labels, carry_out, labels_from

__all__ = [
    "UNOBSERVED",
    "Domain",
    "Kind",
    "Labelled",
    "NamedPlans",
    "Objects",
    "Oracle",
    "Outcome",
    "Plans",
    "Predictor",
    "Scored",
    "Task",
    "World",
    "are_labels",
    "carry_out",
    "labels_from",
]
