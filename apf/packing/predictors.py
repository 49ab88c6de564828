"""Predictors that know the rule: the baselines that a learned one is compared with."""

from typing import Annotated

import numpy as np
from pydantic import Field

from apf.domain import Predictor
from apf.packing.domain import PackingDomain
from apf.packing.packings import Packings
from apf.packing.rule import packed, packed_prefixes
from apf.settings import Deviation, Few, settings


@settings
class AnalyticPredictor(Predictor):
    """Feasible if the packing succeeds in a world without noise."""

    for_domain = PackingDomain
    by_prefix = True

    def feasibility(self, plans: Packings, rng: np.random.Generator) -> np.ndarray:
        """[N] of 0 and 1."""
        return packed(plans).astype(float)

    def last_feasibility(self, plans: Packings, members: slice = slice(None)) -> np.ndarray:
        """[N] of 0 and 1: as `feasibility`, since what holds a prefix that failed has failed."""
        return packed(plans).astype(float)


@settings
class SimulationPredictor(Predictor):
    """Feasible only if the packing succeeds under every one of several perturbations."""

    for_domain = PackingDomain
    random = True

    perturbations: Few = 10
    noise: Annotated[Deviation, Field(gt=0)] = 0.005
    """Standard deviation of each box's x and y [m]."""

    def feasibility(self, plans: Packings, rng: np.random.Generator) -> np.ndarray:
        """[N] of 0 and 1. Each packing has perturbations of its own; one that failed is not tried again."""
        feasible = np.ones(len(plans))
        for _ in range(self.perturbations):
            tried = np.flatnonzero(feasible)
            part = plans[tried]
            xy = part.xy + rng.normal(0.0, self.noise, part.xy.shape)
            feasible[tried] = packed_prefixes(part, xy)[:, -1]
        return feasible
