"""Where plans are carried out and labelled."""

from apf.worlds.analytic import AnalyticWorld
from apf.worlds.base import World, labels_from
from apf.worlds.noisy import NoisyWorld

__all__ = ["AnalyticWorld", "NoisyWorld", "World", "labels_from"]
