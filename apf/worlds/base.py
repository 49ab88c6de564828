"""What the experiment asks of a world: carry out plans, say which prefixes stood (detailedPlanEx)."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from apf.data import UNOBSERVED


class World(ABC):
    """Where plans are executed."""

    @abstractmethod
    def execute(self, plans: Any, rng: np.random.Generator) -> np.ndarray:
        """Carry out N plans of K placements. Returns labels [N, K] int8: 1 stood, 0 fell, -1 not attempted."""


def labels_from(stood: np.ndarray) -> np.ndarray:
    """Labels [N, K] of prefixes that stood [N, K] bool: everything after the first fall is unobserved."""
    labels = np.full(stood.shape, UNOBSERVED, np.int8)
    standing = np.ones(len(stood), bool)
    for prefix in range(stood.shape[1]):
        labels[standing, prefix] = stood[standing, prefix]
        standing &= stood[:, prefix]
    return labels
