"""analysis/plot_model.py and film_model.py: what an ensemble believes, whether its chances hold, what was tried."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from PIL import Image

from analysis import film_model
from analysis.beliefs import belief, towers_over_offsets
from analysis.plot_model import chances_of, draw_scores, draw_tried, main, model_figure, tried
from apf.errors import InputError
from apf.planning.measures import MEASURES
from apf.report.figures import Words
from apf.report.runs import Run, find_runs
from apf.towers import BlockSet, stands
from apf.trained import config_of, load_ensemble
from integration.command_line import TINY, call

pytestmark = pytest.mark.usefixtures("no_figures")
RUN = Run(Path("run"), {}, {}, Words("tower", "block"))

BLOCKS = BlockSet(
    ("a", "b", "c"),
    dims=np.array([[0.10, 0.12, 0.05], [0.08, 0.06, 0.05], [0.06, 0.06, 0.05]]),
    com=np.array([[0.0, 0.0, 0.0], [0.01, -0.02, 0.0], [0.0, 0.01, 0.0]]),
    mass=np.array([1.0, 1.0, 1.0]),
)


def test_the_top_of_two_blocks_stands_where_its_centre_of_mass_is_above_both() -> None:
    """The centre of mass lies at x + 0.01 and y - 0.02; the lower block reaches 0.05 and 0.06 to each side."""
    towers, x, y = towers_over_offsets(BLOCKS, 2, grid=181)
    assert (x[0], x[-1]) == (pytest.approx(-0.09), pytest.approx(0.09))
    stood = stands(towers).reshape(181, 181)
    for row, column in np.ndindex(stood.shape):
        distances = 0.05 - abs(x[column] + 0.01), 0.06 - abs(y[row] - 0.02)
        if min(map(abs, distances)) > 1e-9:
            assert stood[row, column] == (min(distances) > 0)


def test_what_is_below_the_top_of_three_blocks_stands_and_stays() -> None:
    towers, x, y = towers_over_offsets(BLOCKS, 3, grid=11)
    assert stands(towers.prefix(2)).all()
    np.testing.assert_allclose(towers.xy[:, 1], np.tile([-0.01, 0.02], (121, 1)))
    offset = (towers.xy[:, 2] - towers.xy[:, 1]).reshape(11, 11, 2)
    np.testing.assert_allclose(offset[3, :, 0], x)
    np.testing.assert_allclose(offset[:, 4, 1], y)
    assert stands(towers).any()
    assert not stands(towers).all()


def test_one_row_for_each_plan() -> None:
    table = pd.DataFrame(
        {
            "tower": [0, 0, 1, 1, 1, 2, 2],
            "step": [0, 0, 1, 1, 1, 1, 1],
            "score": [np.nan, np.nan, 0.5, 0.5, 0.5, 0.25, 0.25],
            "label": pd.array([1, 1, 1, 0, None, 1, 0], "Int8"),
        }
    )
    found = tried(table, "tower")
    assert found["length"].tolist() == [2, 3, 2]
    assert found["succeeded"].tolist() == [True, False, False]
    assert found["step"].tolist() == [0, 1, 1]
    assert found["score"].tolist()[1:] == [0.5, 0.25]


def test_bars_are_shares_of_the_plans_of_a_step() -> None:
    """Four initial plans, three of which stand; then two, one of each outcome, of other lengths."""
    plans = pd.DataFrame(
        {"step": [0] * 4 + [1] * 2, "length": [2] * 4 + [3, 4], "succeeded": [True] * 3 + [False, True, False]}
    ).assign(score=np.nan)
    _, ax = plt.subplots()
    draw_tried(ax, plans, {2: "C0", 3: "C1", 4: "C2"}, RUN)
    bars = {(round(b.get_x()), round(b.get_y(), 3), round(b.get_height(), 3)) for b in ax.patches if b.get_height()}
    assert bars == {(0, 0.0, 0.75), (0, 0.0, -0.25), (4, 0.0, 0.5), (4, 0.0, -0.5)}
    plt.close()


def test_long_runs_have_few_bars_and_every_plan_is_in_one() -> None:
    plans = pd.DataFrame({"step": np.repeat(np.arange(93), 2), "length": 2, "succeeded": True}).assign(score=np.nan)
    _, ax = plt.subplots()
    draw_tried(ax, plans, {2: "C0"}, RUN)
    up = [bar for bar in ax.patches if bar.get_height() > 0]
    assert len(up) <= 25
    assert sum(bar.get_width() / 0.94 for bar in up) == pytest.approx(len(plans))
    plt.close()


def test_scores_that_no_model_gave_are_not_drawn() -> None:
    plans = pd.DataFrame({"step": [0, 1], "length": 2, "succeeded": True, "score": np.nan})
    _, ax = plt.subplots()
    draw_scores(ax, plans, RUN)
    assert [text.get_text() for text in ax.texts] == ["chosen without a score"]
    assert not ax.collections
    plt.close()


@pytest.fixture
def run(here: Path) -> Path:
    call(*TINY, "evaluation.lengths=[2,3]", "evaluation.test_plans=20", "hydra.run.dir=run").must_work()
    return here / "run"


def test_chances_are_those_that_the_run_was_judged_by(run: Path) -> None:
    config = config_of(run)
    table = pd.read_parquet(run / "accuracy.parquet")
    for step in (1, 2):
        found = chances_of(config, load_ensemble(run, step, config.predictor.odds), step)  # type: ignore[union-attr]
        for length, (probability, labels) in found.items():
            (row,) = table[(table["step"] == step) & (table["length"] == length)].to_dict("records")
            for name, measure in MEASURES.items():
                assert measure(probability, labels) == row[name]


def test_beliefs_are_the_ensembles(run: Path) -> None:
    ensemble = load_ensemble(run)
    found = belief(ensemble, BLOCKS, 3, grid=9)
    towers, x, _ = towers_over_offsets(BLOCKS, 3, grid=9)
    one = 2 * 9 + 5
    assert found.chance[2, 5] == pytest.approx(ensemble.feasibility(towers[one : one + 1])[0])
    assert found.stands[2, 5] == stands(towers)[one]
    assert found.bald.shape == (9, 9)
    assert 0 <= found.bald.min() <= found.bald.max() <= np.log(2)
    np.testing.assert_array_equal(found.x, x)


def test_the_script(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["plot_model.py", str(run)])
    main()
    assert (run / "figures" / "model.png").read_bytes().startswith(b"\x89PNG")
    monkeypatch.setattr(sys, "argv", ["plot_model.py", str(run), "--step", "7", "--out", "out.pdf"])
    with pytest.raises(SystemExit, match=r"error: step is 7; .* keeps the ensembles of steps 1, 2"):
        main()
    assert not Path("out.pdf").exists()


def test_packings_have_no_maps(here: Path) -> None:
    call(*TINY, "domain=packing", "hydra.run.dir=run").must_work()
    (found,), _ = find_runs([here / "run"])
    titles = {axes.get_title() for axes in model_figure(found, None).axes}
    assert titles == {"Reliability", "", "Acquisition scores", "What was tried"}


def test_who_does_not_learn_believes_nothing(here: Path) -> None:
    call(*TINY, "predictor=analytic", "hydra.run.dir=run").must_work()
    (found,), _ = find_runs([here / "run"])
    with pytest.raises(InputError, match="keeps no weights: its predictor does not learn"):
        model_figure(found, None)


def test_a_film_has_a_picture_for_each_ensemble(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["film_model.py", str(run), "--out", "new/learning.gif"])
    film_model.main()
    with Image.open("new/learning.gif") as film:
        assert film.n_frames == 2  # type: ignore[attr-defined]
        assert film.size == (700, 250)


def test_regret_of_a_film_is_the_mean_over_tasks_and_problems(run: Path) -> None:
    (found,), _ = find_runs([run])
    table = pd.read_parquet(run / "regret.parquet")
    regret, world = film_model.regret_of(found)
    assert world == "noisy"
    for step in (1, 2):
        rows = table[(table["world"] == "noisy") & (table["step"] == step)]
        assert regret["regret"][step] == pytest.approx(rows["regret"].mean(), nan_ok=True)
        assert regret["plans"][step] == rows["plans"].iloc[0]


def test_a_film_of_what_cannot_be_shown_is_refused(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    call(*TINY, "domain=packing", "hydra.run.dir=run").must_work()
    for arguments, words in (
        (["run"], "error: run is a run of PackingDomain; the maps are of towers"),
        (["run", "--out", "film.mp4"], r"error: --out film.mp4: it must end in .gif"),
        (["nowhere"], "error: nowhere: no such directory"),
    ):
        monkeypatch.setattr(sys, "argv", ["film_model.py", *arguments])
        with pytest.raises(SystemExit, match=words):
            film_model.main()
