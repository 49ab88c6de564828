"""How a configurable class states its settings: a frozen dataclass whose fields pydantic checks."""

from dataclasses import field
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, dataclass_transform, get_args, get_origin

from pydantic import BeforeValidator, ConfigDict, Field, Strict
from pydantic.dataclasses import dataclass
from pydantic_core import PydanticCustomError


def _no_other(value: Any) -> Any:
    """The value, unless it is one that Python or pydantic would take for a number."""
    if isinstance(value, bool | str | bytes):
        raise PydanticCustomError("number_type", "it should be a number")
    return value


def _whole(value: Any) -> Any:
    """As `_no_other`; a whole number that was written with a point or an exponent, as one without."""
    return int(value) if isinstance(_no_other(value), float) and value.is_integer() else value


Whole = Annotated[int, BeforeValidator(_whole)]
"""A whole number, also written as 1e3; not `true`, and no text."""
Number = Annotated[float, BeforeValidator(_no_other)]
"""A number; not `true`, and no text."""
Switch = Annotated[bool, Strict()]
"""`true` or `false`; not 1, 0, `yes` or `no`."""

Seed = Annotated[Whole, Field(ge=0, le=10**18)]
Few = Annotated[Whole, Field(ge=1, le=1000)]
"""How many of what is kept side by side, or is tried again."""
Count = Annotated[Whole, Field(ge=1, le=1_000_000)]
"""How many of what is made one by one."""
CountOrNone = Annotated[Whole, Field(ge=0, le=1_000_000)]
"""As `Count`, or 0."""
Many = Annotated[Whole, Field(ge=1, le=100_000_000)]
"""How many of what is computed in large arrays; whether they fit into memory is checked apart."""
Width = Annotated[Whole, Field(ge=1, le=4096)]
"""Of a layer of a network."""
Length = Annotated[Whole, Field(ge=2, le=100)]
"""Placements of a plan."""
Metres = Annotated[Number, Field(gt=0, le=10)]
"""A size or a distance [m]."""
Coordinate = Annotated[Number, Field(ge=-10, le=10)]
"""A place on one axis [m]."""
Deviation = Annotated[Number, Field(ge=0, le=1)]
"""A standard deviation of a place [m]: of 1 m, nothing is where it should be."""
Degrees = Annotated[Number, Field(gt=0, le=180)]
Seconds = Annotated[Number, Field(ge=0.001, le=10_000_000)]
"""From a millisecond to four months."""
Name = Annotated[str, Field(min_length=1, max_length=100, pattern=r"^[^\x00-\x1f\x7f]*$")]
"""Text of one line, which may become part of a file's name."""

T = TypeVar("T")
STRICT: dict[Any, Any] = {int: Whole, float: Number, bool: Switch}


def strict(annotation: Any) -> Any:
    """The type of a field, with every number and switch in it taken at its word."""
    if annotation in (int, float, bool):
        return STRICT[annotation]
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return Annotated[(strict(arguments[0]), *arguments[1:])]
    if origin in (Union, UnionType):
        return Union[tuple(map(strict, arguments))]  # noqa: UP007
    if origin in (list, tuple, dict, set, frozenset):
        return origin[tuple(map(strict, arguments))]
    return annotation


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(Field, field))
def settings(cls: type[T]) -> type[T]:
    """Decorator: types and ranges of the fields are checked, unknown keys are refused, values cannot change.

    `true` or a text where a number is asked is refused, though Python or pydantic would take it for one. A plug-in that
    uses it gets the same one-line messages for a wrong value as the classes of this package; the types above bound
    numbers to what a machine can hold.
    """
    cls.__annotations__ = {name: strict(annotation) for name, annotation in cls.__annotations__.items()}
    config = ConfigDict(extra="forbid", arbitrary_types_allowed=True, allow_inf_nan=False)
    return dataclass(frozen=True, kw_only=True, config=config)(cls)  # type: ignore[return-value]


def from_low_to_high(bounds: tuple[float, float]) -> tuple[float, float]:
    """The bounds of a range as they are. Raises ValueError if the upper one comes first."""
    if bounds[0] > bounds[1]:
        raise ValueError(f"is {bounds[0]:g} to {bounds[1]:g}; the lower bound comes first")
    return bounds
