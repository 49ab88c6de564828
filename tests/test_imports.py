"""What a start loads, and what it leaves for later."""

import subprocess
import sys

import pytest

from apf.imports import put_off

TRAIN = """
import sys, numpy as np
import apf.main
from functools import partial
import torch
from apf.domain import Kind, Labelled
from apf.models import Ensemble, EnsembleSettings, TowersGraphNetwork, Training
from apf.towers import TowerDomain, standing_prefixes
domain = TowerDomain()
plans = domain.random_plans(3, 20, np.random.default_rng(0))
settings = EnsembleSettings(members=2, network=partial(TowersGraphNetwork, hidden=8))
model = Ensemble(settings, Kind.SUBSEQUENCE, domain, Training(updates=2), torch.device("cpu"))
model.fit([Labelled(plans, standing_prefixes(plans))], [], np.random.default_rng(0))
model.predict(plans)
print("torch._dynamo" in sys.modules, torch._dynamo.OptimizedModule.__name__)
"""


def test_neither_a_start_nor_training_loads_the_compiler_and_it_can_be_loaded_later() -> None:
    process = subprocess.run([sys.executable, "-c", TRAIN], capture_output=True, text=True, check=True)
    assert process.stdout.split() == ["False", "OptimizedModule"]


def test_what_is_put_off_is_not_loaded() -> None:
    sys.modules.pop("this", None)
    with put_off("this"):
        import this  # it prints a poem
    assert not vars(this).keys() & {"s", "d"}
    assert "this" not in sys.modules


def test_what_is_loaded_already_stays() -> None:
    with put_off("pytest"):
        import pytest as imported
    assert imported is pytest and sys.modules["pytest"] is pytest


def test_after_an_error_nothing_is_left() -> None:
    with pytest.raises(ImportError), put_off("this.that"):
        import no_such_module  # noqa: F401
    assert "this.that" not in sys.modules
