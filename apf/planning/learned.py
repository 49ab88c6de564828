"""The predictor of a run that learns."""

from typing import Annotated

from pydantic import Field

from apf.settings import Number, settings


@settings
class Learned:
    """Stands for the ensemble that the run itself trains."""

    odds: Annotated[Number, Field(gt=0, le=1000)]
    """Factor for the odds of each placement when plans are judged. Acquisition does not use this factor."""
