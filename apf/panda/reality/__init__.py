"""Simulated robots behind the hardware boundary (`apf.panda.hardware`)."""

from apf.panda.reality.base import Bullet, Physics, Reality

__all__ = ["Bullet", "Physics", "Reality"]
