"""What tests share: block sets, a domain, towers made by hand, and a model that never learns."""

import importlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import hypothesis
import numpy as np
import pytest

from apf.domain import Kind
from apf.towers import BlockSet, BlockSource, TowerDomain, Towers

sys.path.append(str(Path(__file__).parents[1]))  # `benchmarks` is no part of the package; at the end, so that `apf`
# and `analysis` are those that are installed

hypothesis.settings.register_profile("apf", deadline=None, derandomize=True, max_examples=50)
hypothesis.settings.load_profile("apf")

Placement = tuple[int, int, float, float]
"""Block, rotation, x [m], y [m]."""


class FakeEnsemble:
    """Four members whose answers are a fixed function of the plans: prefix i depends on placements 1..i only."""

    def __init__(self, kind: Kind = Kind.SUBSEQUENCE) -> None:
        self.kind = kind

    def predict(self, plans: Towers) -> np.ndarray:
        """[4, N, K - 1], or [4, N, 1] for a complete model."""
        placement = 0.37 * plans.block + 0.11 * plans.rotation + 5 * plans.xy[..., 0] - 3 * plans.xy[..., 1]
        prefix = np.cumsum(placement, axis=1)
        member = np.arange(1, 5)[:, None, None]
        p = 0.5 + 0.49 * np.sin(prefix + 0.4 * member * np.sin(3 * prefix))
        return p[..., -1:] if self.kind is Kind.COMPLETE else p[..., 1:]


@pytest.fixture(scope="session")
def cubes() -> BlockSet:
    """Six cubes of 1/8 m (exact in binary), mass 1 kg, centre of mass in the middle."""
    return BlockSet(tuple("abcdef"), np.full((6, 3), 0.125), np.zeros((6, 3)), np.ones(6))


@pytest.fixture(scope="session")
def blocks() -> BlockSet:
    """Seven random blocks of the published distribution."""
    return BlockSource(blocks=7, seed=3).load()


@pytest.fixture(scope="session")
def graspable() -> BlockSet:
    """Four blocks that the Panda's gripper can hold, as the robot's experiments have them."""
    return BlockSource(blocks=4, seed=0, side=(0.04, 0.075), mass=(0.06, 0.21), com_share=0.6).load()


@pytest.fixture(scope="session")
def domain() -> TowerDomain:
    """Six training blocks and six others."""
    return TowerDomain(training=BlockSource(blocks=6, seed=0), evaluation=BlockSource(blocks=6, seed=1))


@pytest.fixture(scope="session")
def build() -> Callable[..., Towers]:
    """`build(blocks, tower, ...)`: a batch of towers, each a list of placements (block, rotation, x, y)."""

    def build(blocks: BlockSet, *towers: Sequence[Placement]) -> Towers:
        table = np.array(towers, float)
        return Towers(blocks, table[..., 0].astype(int), table[..., 1].astype(int), table[..., 2:])

    return build


@pytest.fixture(scope="session")
def line(build: Callable[..., Towers]) -> Callable[..., Towers]:
    """`line(blocks, xs)`: one tower of blocks 0, 1, 2, ..., not rotated, at the given x and y = 0."""

    def line(blocks: BlockSet, xs: Sequence[float]) -> Towers:
        return build(blocks, [(i, 0, x, 0.0) for i, x in enumerate(xs)])

    return line


@pytest.fixture(scope="session")
def fake_ensemble() -> Callable[..., FakeEnsemble]:
    """Makes a `FakeEnsemble` of the given kind."""
    return FakeEnsemble


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Metrics take most of the time of a tiny run, and do not always matter."""
    monkeypatch.setattr(importlib.import_module("apf.commands.run"), "save_figures", lambda directory: None)
