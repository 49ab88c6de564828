"""What experiments teach: plans, the labels of their prefixes, and how a model kind reads them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol

import numpy as np

UNOBSERVED = -1
"""Label of a prefix that was not attempted: those after the first that fell."""


class Kind(StrEnum):
    """What a feasibility model predicts (Section Abstract plan feasibility model)."""

    COMPLETE = "complete"
    """Theta_comp: one probability for the whole plan."""
    SUBSEQUENCE = "subsequence"
    """Theta_ss: one per prefix, given that those before it were feasible; a plan's is their product."""


class Plans(Protocol):
    """A batch of N plans of K placements."""

    def __len__(self) -> int: ...

    @property
    def length(self) -> int: ...

    def __getitem__(self, rows: Any) -> Any: ...

    def prefix(self, length: int) -> Any: ...


class Domain(Protocol):
    """What learning needs to know of plans; `apf.towers.TowerDomain` is the one for block towers."""

    n_features: int
    n_position: int

    def random_plans(self, length: int, n: int, rng: np.random.Generator) -> Any: ...

    def extend(self, plans: Any, rng: np.random.Generator) -> Any: ...

    def concatenate(self, parts: Sequence[Any]) -> Any: ...

    def features(self, plans: Any) -> np.ndarray: ...

    def views(self, plans: Any) -> Iterable[np.ndarray]: ...


@dataclass(frozen=True, eq=False)
class Labelled:
    """N plans of one length and their labels [N, K] int8: 1 feasible, 0 infeasible, -1 unobserved."""

    plans: Any
    labels: np.ndarray


@dataclass(frozen=True, eq=False)
class Examples:
    """M training examples of one length: features x [M, K, F] and labels y [M, P] float32.

    P is K - 1 (one label for every prefix 2..K) or 1 (one for the whole plan).
    """

    x: np.ndarray
    y: np.ndarray

    def __len__(self) -> int:
        return len(self.x)


def examples(labelled: Sequence[Labelled], kind: Kind, domain: Domain) -> list[Examples]:
    """All examples that the labelled plans hold for a model of this kind, from all sides that the domain knows.

    For Theta_ss a plan is cut where it fell: what was never attempted teaches nothing, and every prefix of what
    remains has a label. For Theta_comp it keeps its length and has one label: whether all of it stood.
    """
    parts: dict[int, list[Examples]] = {}
    for group in labelled:
        observed = (group.labels != UNOBSERVED).sum(1)
        whole = kind is Kind.COMPLETE
        for length in [group.plans.length] if whole else [n for n in np.unique(observed) if n > 1]:
            rows = slice(None) if whole else observed == length
            labels = group.labels[rows]
            y = (labels == 1).all(1)[:, None] if whole else labels[:, 1:length] == 1
            plans = group.plans[rows].prefix(length)
            for view in domain.views(plans):
                parts.setdefault(int(length), []).append(Examples(view, y.astype(np.float32)))
    return [
        Examples(np.concatenate([p.x for p in part]), np.concatenate([p.y for p in part]))
        for _, part in sorted(parts.items())
    ]
