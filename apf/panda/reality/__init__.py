"""Simulated robots behind the hardware boundary (`apf.panda.hardware`)."""

from apf.panda.reality.base import Bullet, Mujoco, Physics, Reality

__all__ = ["Bullet", "Mujoco", "Physics", "Reality"]
