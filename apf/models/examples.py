"""Training examples: the features of labelled plans, and their labels as Theta_ss or Theta_comp."""

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
    """The examples that labelled plans give a model, in all views of the domain.

    For Theta_ss a plan is cut after its first failure: every remaining prefix has a label, and prefixes that were never
    attempted have none. For Theta_comp, and for Theta_ss that learns from whole plans, a plan keeps its length and has
    one label: whether the whole plan succeeded.

    Args:
        labelled: groups of labelled plans.
        kind: what the model predicts and learns.
        domain: computes features and views.

    Returns:
        One group of examples for each length, the shortest first.
    """
    parts: dict[int, list[Examples]] = {}
    for group in labelled:
        observed = (group.labels != UNOBSERVED).sum(1)
        whole = kind is not Kind.SUBSEQUENCE
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
