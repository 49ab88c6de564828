"""An objective V: what a tower that stands is worth."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np


class Task(ABC):
    """An objective function V(a) of the evaluation phase."""

    unit: str
    """Unit of the value, for tables and figures."""

    @abstractmethod
    def value(self, plans: Any) -> np.ndarray:
        """[N] value of each plan if it succeeds; never negative."""
