"""What a model learns from: the features of labelled plans, as its kind reads their labels."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from apf.domain import UNOBSERVED, Domain, Kind, Labelled


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
