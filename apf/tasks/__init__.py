"""Objectives of the evaluation phase."""

from apf.tasks.base import Task
from apf.tasks.stacking import Overhang, Tallest, Unsupported

__all__ = ["Overhang", "Tallest", "Task", "Unsupported"]
