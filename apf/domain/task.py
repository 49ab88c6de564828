"""An objective V: what a plan that succeeds is worth."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np

from apf.domain.domain import Domain


class Task(ABC):
    """An objective function V(a) of the evaluation phase."""

    for_domain: ClassVar[type[Domain] | None] = None
    """The domain whose plans the task can value; None: any domain."""

    title: ClassVar[str] = ""
    """The task's name in figures; by default its name in the config."""

    unit: str
    """Unit of the value, for tables and figures."""

    @abstractmethod
    def value(self, plans: Any) -> np.ndarray:
        """[N] value of each plan if it succeeds; never negative."""
