"""Somebody's own sampler and world, in a package and configs of their own, without touching this repository."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from integration.command_line import TINY, call, spawn

CODE = '''
"""My own ideas."""
import numpy as np
from pydantic import PositiveFloat

from apf.acquisition import Score
from apf.settings import settings
from apf.domain import World, labels_from


@settings
class Widest(Score):
    """Towers whose top is far out are interesting."""

    weight: PositiveFloat

    def __call__(self, model, plans, rng):
        return self.weight * np.abs(plans.xy[:, -1]).max(1)


@settings
class Earthquake(World):
    """Nothing of more than so many blocks stands."""

    highest: int

    def execute(self, plans, rng):
        return labels_from(np.tile(np.arange(1, plans.length + 1) <= self.highest, (len(plans), 1)))
'''

SAMPLER = """
defaults: [random_ss]
score:
  _target_: my_ideas.Widest
  weight: 2.0
"""

WORLD = """
_target_: my_ideas.Earthquake
highest: 2
"""


@pytest.fixture
def plugin(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a module and its configs, anywhere on the disk."""
    folder = tmp_path_factory.mktemp("plugin")
    for name, text in (("my_ideas.py", CODE), ("conf/sampler/widest.yaml", SAMPLER), ("conf/world/quake.yaml", WORLD)):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def overrides(plugin: Path) -> tuple[str, ...]:
    return (*TINY, f"hydra.searchpath=[file://{plugin / 'conf'}]", "hydra.run.dir=run")


@pytest.mark.slow
def test_own_sampler_and_world(plugin: Path, tmp_path: Path) -> None:
    chosen = ("sampler=widest", "world=quake", "+world@evaluation.worlds.quake=quake")
    path = os.pathsep.join([str(plugin), os.environ.get("PYTHONPATH", "")])
    spawn(["-m", "apf.main", *overrides(plugin), *chosen], cwd=tmp_path, PYTHONPATH=path).must_work()
    state = yaml.safe_load((tmp_path / "run" / "run.yaml").read_text())
    assert (state["choices"]["sampler"], state["choices"]["world"]) == ("widest", "quake")
    towers = pd.read_parquet(tmp_path / "run" / "plans.parquet")
    for _, tower in towers.groupby("tower"):
        expected = [1, 1, 0, *[None] * 3][: len(tower)]
        assert [None if label is pd.NA else label for label in tower["label"]] == expected
    chosen = towers[towers["step"] > 0].groupby("tower")
    assert len(chosen) == 4
    for _, tower in chosen:
        assert np.isclose(tower["score"].iloc[0], 2 * tower[["x", "y"]].iloc[-1].abs().max())
    regret = pd.read_parquet(tmp_path / "run" / "regret.parquet")
    assert set(regret["world"]) == {"analytic", "noisy", "quake"}
    assert regret[regret["world"] == "quake"]["feasible"].all(), "problems have two blocks"


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("sampler.score.weight=-1", ("sampler.score.weight",)),
        ("+sampler.score.height=1", ("sampler.score.height", "weight")),
        ("world.highest=high", ("world.highest",)),
        ("~world.highest", ("world.highest", "missing")),
    ],
)
def test_own_settings_are_checked_like_all_others(
    plugin: Path, here: Path, monkeypatch: pytest.MonkeyPatch, override: str, words: tuple[str, ...]
) -> None:
    monkeypatch.syspath_prepend(str(plugin))
    call(*overrides(plugin), "sampler=widest", "world=quake", override).must_refuse(*words)
    assert list(here.iterdir()) == []


def test_own_module_that_is_missing(plugin: Path, here: Path) -> None:
    (plugin / "conf" / "world" / "lost.yaml").write_text("_target_: nowhere.Lost\n")
    call(*overrides(plugin), "world=lost").must_refuse("world", "nowhere")
    assert list(here.iterdir()) == []
