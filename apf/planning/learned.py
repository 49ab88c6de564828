"""The predictor of a run that learns, and that of a run which asks what another has learned."""

from pathlib import Path

from apf.planning.planner import Odds
from apf.settings import CountOrNone, settings


@settings
class Learned:
    """Stands for the ensemble that the run itself trains."""

    odds: Odds
    """Factor for the odds of each placement when plans are judged. Acquisition does not use this factor."""


@settings
class Trained:
    """Stands for the ensemble that another run has trained."""

    run: Path
    """Directory of that run. Plans are made of the objects that it keeps."""
    step: CountOrNone | None = None
    """An evaluated step of that run; None: the last one."""
    odds: Odds = 1.5
    """Factor for the odds of each placement when plans are judged."""
