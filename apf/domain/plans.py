"""Plans, and the labels of their prefixes."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol

import numpy as np

UNOBSERVED = -1
"""Label of a prefix that was not attempted: those after the first that failed."""


class Kind(StrEnum):
    """What a feasibility model predicts (Section Abstract plan feasibility model)."""

    COMPLETE = "complete"
    """Theta_comp: one probability for the whole plan."""
    SUBSEQUENCE = "subsequence"
    """Theta_ss: one per prefix, given that those before it were feasible; a plan's is their product."""
    WHOLE = "whole"
    """Theta_ss, too, but it learns one label from each plan: whether all of it succeeded."""


class Plans(Protocol):
    """A batch of N plans of K placements."""

    def __len__(self) -> int: ...

    @property
    def length(self) -> int:
        """K, the number of placements."""
        ...

    def __getitem__(self, rows: Any) -> Any: ...

    def prefix(self, length: int) -> Any:
        """The first `length` placements of each plan."""
        ...


@dataclass(frozen=True, eq=False)
class Labelled:
    """N plans of one length and their labels [N, K] int8: 1 feasible, 0 infeasible, -1 unobserved."""

    plans: Any
    labels: np.ndarray


@dataclass(frozen=True, eq=False)
class NamedPlans:
    """The plans of one length in a file: the file's own name of each [N], and where it came in the file [N]."""

    plans: Any
    names: tuple[Any, ...]
    order: tuple[int, ...]


@dataclass(frozen=True)
class Scored:
    """One plan (a batch of one), and how much its execution is worth to the one who chose it."""

    plan: Any
    score: float
