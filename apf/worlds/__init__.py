"""Where plans are carried out and labelled."""

from apf.worlds.analytic import AnalyticWorld
from apf.worlds.base import Outcome, World, are_labels, carry_out, labels_from
from apf.worlds.noisy import NoisyWorld

__all__ = ["AnalyticWorld", "NoisyWorld", "Outcome", "World", "are_labels", "carry_out", "labels_from"]
