"""Which classes a config may name, place by place."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from omegaconf import OmegaConf
from pydantic import Field

from apf.config.build import build
from apf.config.parts import Part, find, make
from apf.domain import Task, World
from apf.errors import InputError
from apf.models import EnsembleNetwork
from apf.settings import settings
from apf.towers import AnalyticWorld, NoisyWorld, Tallest

ANALYTIC = {"_target_": "apf.towers.AnalyticWorld"}
TALLEST = {"_target_": "apf.towers.Tallest"}
TGN = {"_target_": "apf.models.TGN", "_partial_": True, "hidden": 8}
PICKLE = {"_target_": "pandas.read_pickle"}


@settings
class Everything:
    """A place of each kind."""

    one: World | None = None
    any_of: World | Task | None = None
    listed: list[World] = Field(default_factory=list)
    some: Sequence[Task] = ()
    pair: tuple[World, Task] | None = None
    named: dict[str, dict[str, Task]] = Field(default_factory=dict)
    later: Callable[..., EnsembleNetwork] | None = None
    path: Path | None = None
    array: np.ndarray | None = None
    anything: Any = None
    text: str = ""
    inner: "Everything | None" = None


def built(**given: Any) -> Any:
    return build(OmegaConf.create(given), Everything)


def test_what_fits_is_made() -> None:
    made = built(
        one={"_target_": "apf.towers.NoisyWorld", "noise": 0.5},
        any_of=TALLEST,
        listed=[ANALYTIC, ANALYTIC],
        some=[TALLEST],
        pair=[ANALYTIC, TALLEST],
        named={"a": {"b": TALLEST}},
        later=TGN,
        text="plain",
        anything={"plain": [1]},
        inner={"one": ANALYTIC},
    )
    assert made.one == NoisyWorld(noise=0.5)
    assert isinstance(made.any_of, Tallest)
    assert made.listed == [AnalyticWorld()] * 2
    assert isinstance(made.pair[1], Tallest)
    assert isinstance(made.named["a"]["b"], Tallest)
    assert isinstance(made.later, partial)
    assert made.later.keywords == {"hidden": 8}
    assert made.anything == {"plain": [1]}
    assert made.inner.one == AnalyticWorld()


@pytest.mark.parametrize(
    ("given", "key"),
    [
        ({"one": TALLEST}, "one._target_"),
        ({"one": {"_target_": "apf.domain.World.execute"}}, "one._target_"),
        ({"one": ANALYTIC | {"_partial_": True}}, "one._partial_"),
        ({"any_of": PICKLE}, "any_of._target_"),
        ({"listed": [ANALYTIC, TALLEST]}, "listed.1._target_"),
        ({"some": [ANALYTIC]}, "some.0._target_"),
        ({"named": {"a": TALLEST}}, "named.a._target_"),
        ({"named": {"a": {"b": ANALYTIC}}}, "named.a.b._target_"),
        ({"later": ANALYTIC | {"_partial_": True}}, "later._target_"),
        ({"later": TGN | {"_partial_": False}}, "later._partial_"),
        ({"later": TGN | {"more": PICKLE}}, "later.more._target_"),
        ({"path": {"_target_": "pathlib.PosixPath"}}, "path._target_"),
        ({"array": {"_target_": "numpy.memmap", "filename": "mine", "mode": "w+", "shape": 1}}, "array._target_"),
        ({"anything": ANALYTIC}, "anything._target_"),
        ({"anything": [[PICKLE]]}, "anything.0.0._target_"),
        ({"text": ANALYTIC}, "text._target_"),
        ({"inner": {"one": TALLEST}}, "inner.one._target_"),
        ({"inner": {"inner": {"text": PICKLE}}}, "inner.inner.text._target_"),
        ({"one": ANALYTIC | {"_args_": [1]}}, "one._args_"),
        ({"one": ANALYTIC | {"_recursive_": False}}, "one._recursive_"),
        ({"one": ANALYTIC | {"_convert_": "all"}}, "one._convert_"),
        ({"one": {"_partial_": True}}, "one._partial_"),
        ({"_target_": "apf.towers.AnalyticWorld"}, "_target_"),
        ({"unknown": PICKLE}, "unknown._target_"),
    ],
)
def test_what_does_not_fit_is_refused_by_its_key(given: dict[str, Any], key: str) -> None:
    with pytest.raises(InputError) as caught:
        built(**given)
    assert str(caught.value).startswith((f"{key} ", f"{key}:")), caught.value


def test_all_is_checked_before_anything_is_called(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    monkeypatch.setattr(AnalyticWorld, "__init__", lambda self: made.append("a world"))
    with pytest.raises(InputError, match=r"inner\.one"):
        built(one=ANALYTIC, inner={"one": PICKLE})
    assert made == []
    built(one=ANALYTIC)
    assert made == ["a world"]


def test_finding_calls_nothing() -> None:
    found = find({"one": ANALYTIC, "later": TGN}, [Everything])
    assert isinstance(found["one"], Part)
    assert found["one"].cls is AnalyticWorld
    assert found["later"].partial
    assert make(found["one"]) == AnalyticWorld()
