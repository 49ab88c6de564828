"""Predictors that know the physics: the baselines that a learned one is compared with (Section Real Robot)."""

from typing import Annotated

import numpy as np
from pydantic import Field

from apf.domain import Predictor
from apf.settings import Deviation, Few, settings
from apf.towers.domain import TowerDomain
from apf.towers.stability import standing_prefixes, stands
from apf.towers.towers import Towers


@settings
class AnalyticPredictor(Predictor):
    """Feasible if the tower stands in a world without noise: the paper's Analytical model."""

    for_domain = TowerDomain

    by_prefix = True

    def feasibility(self, plans: Towers, rng: np.random.Generator) -> np.ndarray:
        """[N] of 0 and 1."""
        return stands(plans).astype(float)

    def last_feasibility(self, plans: Towers, members: slice = slice(None)) -> np.ndarray:
        """[N] of 0 and 1: as `feasibility`, since what holds a fallen prefix has fallen."""
        return stands(plans).astype(float)


@settings
class SimulationPredictor(Predictor):
    """The paper's Simulation model: feasible only if the tower stands under every one of several perturbations."""

    for_domain = TowerDomain

    perturbations: Few = 10
    noise: Annotated[Deviation, Field(gt=0)] = 0.005
    """Standard deviation of each block's x and y [m]."""

    random = True

    def feasibility(self, plans: Towers, rng: np.random.Generator) -> np.ndarray:
        """[N] of 0 and 1. Each tower has perturbations of its own; one that fell is not tried again."""
        alive = np.arange(len(plans))
        for _ in range(self.perturbations):
            towers = plans[alive]
            xy = towers.xy + rng.normal(0.0, self.noise, towers.xy.shape)
            alive = alive[standing_prefixes(towers, xy)[:, -1]]
        feasible = np.zeros(len(plans))
        feasible[alive] = 1.0
        return feasible
