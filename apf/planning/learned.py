"""The predictor of a run that learns."""

from apf.planning.planner import Odds
from apf.settings import settings


@settings
class Learned:
    """Stands for the ensemble that the run itself trains."""

    odds: Odds
    """Factor for the odds of each placement when plans are judged. Acquisition does not use this factor."""
