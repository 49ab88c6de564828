"""How a configurable class states its settings: a frozen dataclass whose fields pydantic checks."""

from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

settings = dataclass(
    frozen=True, kw_only=True, config=ConfigDict(extra="forbid", arbitrary_types_allowed=True, allow_inf_nan=False)
)
"""Decorator: types and ranges of the fields are checked, unknown keys are refused, values cannot change.

A plug-in that uses it gets the same one-line messages for a wrong value as the classes of this package.
"""
