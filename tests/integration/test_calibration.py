"""analysis/calibration.py: maps of chances, fitted to what was held out."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis import calibration
from analysis.calibration import Told, held_out, mapped, maps_of
from apf.trained import config_of, load_ensemble
from integration.command_line import TINY, call

pytestmark = pytest.mark.usefixtures("no_figures")


def test_a_map_moves_logits() -> None:
    """Odds of 1 and 1/3, times 3: 3 and 1, so 0.75 and 0.5. With slope 2: odds of 1 and 1/9."""
    p = np.array([[[0.5, 0.25]]])
    assert mapped(p, (np.ones(2), np.full(2, np.log(3)))) == pytest.approx(0.75 * 0.5)
    assert mapped(p, (np.full(4, 2.0), np.zeros(4))) == pytest.approx(0.5 * 0.1)


def told_of(x: np.ndarray, y: np.ndarray) -> Told:
    """Of one member: logits [N] and labels [N] of prefixes of two placements."""
    return Told(np.zeros(len(x), int), x[None], y, np.ones(len(x), bool))


@pytest.mark.parametrize(("slope", "offset"), [(1.0, 0.7), (0.5, -1.0), (2.0, 0.3)])
def test_the_map_by_which_labels_were_drawn_is_found(slope: float, offset: float) -> None:
    rng = np.random.default_rng(0)
    x = rng.normal(0, 2, 20_000)
    y = (rng.random(20_000) < 1 / (1 + np.exp(-(slope * x + offset)))).astype(int)
    told = told_of(x, y)
    assert told.fitted(slope=True) == pytest.approx((slope, offset), abs=0.1)
    assert told.fitted(slope=False)[0] == 1.0


def test_few_labels_of_one_kind_give_no_infinite_map() -> None:
    assert all(abs(value) < 50 for value in told_of(np.array([1.0, 2.0]), np.array([1, 1])).fitted(slope=True))
    assert told_of(np.array([]), np.array([], int)).fitted(slope=True) == (1.0, 0.0)


def test_maps_of_random_plans_are_fitted_to_them_alone() -> None:
    """Random plans always succeed, the others never do."""
    random = np.tile([True, True, False, False], 10)
    told = Told(np.tile([0, 1], 20), np.zeros((3, 40)), random.astype(int), random)
    maps = maps_of(told, prefixes=2)
    assert (maps["offset, random"][1] > 1).all()
    assert maps["offset, all"][1] == pytest.approx(0, abs=1e-3)
    assert maps["odds x 3"][1] == pytest.approx(np.log(3))
    assert maps["slope and offset of each prefix, all"][0].shape == (2,)


@pytest.fixture
def run(here: Path) -> Path:
    call(*TINY, "hydra.run.dir=run", "sampler.initial.max=4").must_work()
    return here / "run"


def test_every_labelled_prefix_is_held_out_once(run: Path) -> None:
    told = held_out(run, step=2)
    table = pd.read_parquet(run / "plans.parquet")
    attempted = table[(table["position"] > 0) & table["label"].notna()]
    assert told.logits.shape == (2, len(attempted))
    assert told.label.sum() == attempted["label"].sum()
    assert told.random.sum() == (attempted["step"] == 0).sum()


def test_the_study_of_a_run(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Odds x 1 is what the ensemble says."""
    arguments = ["calibration.py", str(run), "--step", "2", "--problems", "2", "--out", "new/calibration.csv"]
    monkeypatch.setattr(sys, "argv", arguments)
    calibration.main()
    table = pd.read_csv("new/calibration.csv")
    assert set(table["measure"]) == {"accuracy", "nll", "ece", "regret", "standing"}
    assert table["map"].nunique() == 9
    config, accuracy = config_of(run), pd.read_parquet(run / "accuracy.parquet")
    assert config.predictor.odds == 1.5  # type: ignore[union-attr]
    here = accuracy[accuracy["step"] == 2]
    for measure in ("accuracy", "nll", "ece"):
        (row,) = table[(table["map"] == "odds x 1.5") & (table["measure"] == measure)].to_dict("records")
        assert row["mean"] == pytest.approx(here[measure].mean(), abs=1e-4)
    assert load_ensemble(run, 2).members == 2
