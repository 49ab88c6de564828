"""The figure that compares ways to learn and to plan: what it computes, and what it says of wrong input."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis.intervals import over_runs
from analysis.plot_beyond import ALL, mean_curves, plot
from apf.report.figures import Words
from integration.command_line import ANALYSIS

SCRIPT = ANALYSIS / "plot_beyond.py"


def regret_of(*values: float, group: str = "one", plans: int = 100) -> pd.DataFrame:
    """Two tasks, one problem each; a run for each value: regret of this value and of twice the value."""
    rows = [
        (group, run, world, task, plans, times * value, value < 0.3, 0.5)
        for run, value in enumerate(values)
        for world in ("noisy", "analytic")
        for task, times in (("tallest", 1), ("overhang", 2))
    ]
    return pd.DataFrame(rows, columns=["group", "run", "world", "task", "plans", "regret", "feasible", "chance"])


def test_means_are_over_problems_then_over_tasks_then_over_runs() -> None:
    curves = mean_curves(regret_of(0.1, 0.2, 0.6), "noisy").set_index("task")
    assert curves["mean"].to_dict() == pytest.approx({ALL: 0.45, "tallest": 0.3, "overhang": 0.6})
    assert curves["worst"].to_dict() == pytest.approx({ALL: 0.9, "tallest": 0.6, "overhang": 1.2})
    assert curves["standing"].to_dict() == pytest.approx(dict.fromkeys((ALL, "tallest", "overhang"), 2 / 3))
    assert (curves["runs"] == 3).all()
    assert (curves["chance"] == 0.5).all()
    assert (curves["low"] < curves["mean"]).all()
    assert (curves["mean"] < curves["high"]).all()


def test_an_interval_covers_the_mean_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    found = [over_runs(rng.normal(size=16)) for _ in range(300)]
    assert 0.88 < np.mean([low < 0 < high for low, high in found]) < 0.98
    assert all(np.isnan(over_runs(np.array([0.3]))))


def test_a_group_that_labelled_nothing_is_a_line_at_its_mean() -> None:
    both = pd.concat([regret_of(0.2, 0.4), regret_of(0.1, group="Oracle", plans=0)])
    figure = plot(mean_curves(both, "noisy"), Words("tower", "block"), "noisy")
    drawn = [[line.get_ydata()[0] for line in axes.lines if line.get_linestyle() == "--"] for axes in figure.axes]
    assert np.ravel(drawn) == pytest.approx([0.15, 0.1, 0.2]), "all tasks, then each"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["one", "Oracle"]


@pytest.mark.slow
def test_named_groups_and_levels(sweep: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    runs = sorted((sweep / "runs" / "mine").glob("*seed*"))
    sequential = [run for run in runs if run.name.startswith("sequential")]
    arguments = [f"Ours={sequential[0]}", f"Ours={sequential[1]}", f"Theirs={sweep / 'runs' / 'mine'}"]
    monkeypatch.setattr(sys, "argv", [SCRIPT.name, *arguments, "--out", str(tmp_path / "figure")])
    runpy.run_path(str(SCRIPT), run_name="__main__")
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
    table = pd.read_csv(tmp_path / "figure.csv")
    assert table.groupby("group")["runs"].max().to_dict() == {"Ours": 2, "Theirs": len(runs)}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["runs"], "runs: write NAME=DIR"),
        (["Ours=nowhere"], "nowhere: no such directory"),
        (["=nowhere"], "write NAME=DIR"),
    ],
)
def test_bad_input(arguments: list[str], words: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [SCRIPT.name, *arguments, "--out", "figure"])
    with pytest.raises(SystemExit, match=words):
        runpy.run_path(str(SCRIPT), run_name="__main__")
