"""Simulated robots behind the hardware boundary (`apf.panda.hardware`). Each physics has a file of its own."""

from apf.panda.reality.base import Physics, Reality, Rig
from apf.panda.reality.bullet import Bullet

__all__ = ["Bullet", "Physics", "Reality", "Rig"]
