"""From run directories to curves: the two plot scripts, and how runs are grouped."""

import runpy
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from apf.errors import InputError
from apf.report.figures import Words
from apf.report.runs import Run, find_runs, gather, label_runs
from integration.command_line import ANALYSIS, spawn

SCRIPTS = {"regret": ANALYSIS / "plot_regret.py", "accuracy": ANALYSIS / "plot_accuracy.py"}
WORDS = Words("tower", "block")
SAMPLERS = ("sequential", "random_ss")
TABLE, CLAIMS, KEEP = (ANALYSIS / f"{name}.py" for name in ("table_regret", "claims", "keep"))


def plot(monkeypatch: pytest.MonkeyPatch, name: str, *arguments: str | Path) -> None:
    """The script in this process."""
    monkeypatch.setattr(sys, "argv", [SCRIPTS[name].name, *map(str, arguments)])
    runpy.run_path(str(SCRIPTS[name]), run_name="__main__")


def must_be_pictures(stem: Path) -> None:
    assert stem.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    assert stem.with_suffix(".pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.slow
def test_plot_regret(sweep: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(sweep / "runs" / "mine", tmp_path / "sweep")
    result = spawn([SCRIPTS["regret"], folder], cwd=tmp_path).must_work()
    assert "sequential: 2 runs" in result.out
    assert "random_ss: 2 runs" in result.out
    assert str(folder / "regret.pdf") in result.out
    must_be_pictures(folder / "regret")
    drawn = pd.read_csv(folder / "regret.csv")
    assert list(drawn.columns) == ["group", "world", "task", "plans", "median", "q25", "q75", "runs", "problems"]
    assert len(drawn) == 2 * 2 * 3 * 2
    for sampler in ("sequential", "random_ss"):
        tables = [pd.read_parquet(run / "regret.parquet") for run in folder.glob(f"{sampler}-*")]
        assert len(tables) == 2
        values = pd.concat(tables).dropna(subset=["regret"])
        keys = ["world", "task", "plans"]
        for _, row in drawn[drawn["group"] == sampler].iterrows():
            mine = values[(values[keys] == row[keys]).all(axis=1)]["regret"].to_numpy()
            expected = [np.median(mine), *np.percentile(mine, [25, 75])]
            assert np.allclose(row[["median", "q25", "q75"]].astype(float), expected)
            assert row[["runs", "problems"]].tolist() == [2, len(mine)]


@pytest.mark.slow
def test_plot_accuracy(sweep: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    folder = sweep / "runs" / "mine"
    plot(monkeypatch, "accuracy", folder, "--out", tmp_path / "figures" / "curve")
    must_be_pictures(tmp_path / "figures" / "curve")
    drawn = pd.read_csv(tmp_path / "figures" / "curve.csv")
    assert list(drawn.columns) == ["group", "length", "plans", "mean", "min", "max", "auc", "nll", "ece", "runs"]
    assert len(drawn) == 2 * 2 * 2
    for sampler in ("sequential", "random_ss"):
        values = pd.concat(pd.read_parquet(run / "accuracy.parquet") for run in folder.glob(f"{sampler}-*"))
        for length in (2, 3):
            for towers in (10, 12):
                row = drawn[(drawn["group"] == sampler) & (drawn["length"] == length) & (drawn["plans"] == towers)]
                mine = values[(values["length"] == length) & (values["plans"] == towers)]["accuracy"].to_numpy()
                assert len(mine) == 2
                assert np.allclose(row[["mean", "min", "max"]].iloc[0], [mine.mean(), mine.min(), mine.max()])
                assert row["runs"].iloc[0] == 2
                others = values[(values["length"] == length) & (values["plans"] == towers)]
                for name in ("auc", "nll", "ece"):
                    assert np.isclose(row[name].iloc[0], others[name].mean())


@pytest.mark.slow
def test_another_measure_than_accuracy(sweep: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    folder = shutil.copytree(sweep / "runs" / "mine", tmp_path / "sweep")
    plot(monkeypatch, "accuracy", folder, "--metric", "ece")
    must_be_pictures(folder / "ece")
    drawn = pd.read_csv(folder / "ece.csv")
    assert list(drawn.columns) == ["group", "length", "plans", "mean", "min", "max", "accuracy", "auc", "nll", "runs"]
    values = pd.concat(pd.read_parquet(run / "accuracy.parquet") for run in folder.glob("sequential-*"))
    for _, row in drawn[drawn["group"] == "sequential"].iterrows():
        mine = values[(values["length"] == row["length"]) & (values["plans"] == row["plans"])]["ece"]
        assert np.allclose(row[["mean", "min", "max"]].astype(float), [mine.mean(), mine.min(), mine.max()])
    for path in folder.glob("*/accuracy.parquet"):
        pd.read_parquet(path).drop(columns=["nll", "ece"]).to_parquet(path)
    plot(monkeypatch, "accuracy", folder)
    with pytest.raises(SystemExit) as stop:
        plot(monkeypatch, "accuracy", folder, "--metric", "nll")
    assert stop.value.code == (
        "error: the runs are of an earlier version, which did not measure nll; have accuracy, auc"
    )


@pytest.mark.slow
def test_one_panel_for_each_task_and_length(sweep: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import apf.report.figures

    figures = {}
    save = apf.report.figures.save

    def keeping(figure: Any, table: pd.DataFrame, stem: Path) -> list[Path]:
        figures[stem.name] = ([axes.get_title() for axes in figure.axes], [len(axes.lines) for axes in figure.axes])
        legends[stem.name] = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
        return save(figure, table, stem)

    legends: dict[str, list[str]] = {}
    monkeypatch.setattr(apf.report.figures, "save", keeping)
    monkeypatch.delitem(sys.modules, "analysis.curves", raising=False)
    for name in SCRIPTS:
        plot(monkeypatch, name, sweep / "runs" / "mine", "--out", tmp_path / name)
    titles = ["Tallest tower", "Longest overhang", "Maximum unsupported area"]
    assert figures["regret"] == ([*titles, "", "", ""], [2] * 6)
    assert figures["accuracy"][0] == ["2 blocks", "3 blocks"]
    for name in SCRIPTS:
        assert legends[name] == ["Sequential", "Random, by prefix"]


def regret_of(groups: Sequence[str], median: float = 0.5) -> pd.DataFrame:
    """Curves of regret: two worlds, one task, at 100 and 200 plans."""
    rows = [(g, w, "tallest", p, median) for g in groups for w in ("analytic", "noisy") for p in (100, 200)]
    curves = pd.DataFrame(rows, columns=["group", "world", "task", "plans", "median"])
    return curves.assign(q25=median / 2, q75=median * 1.2, runs=4, problems=10)


def test_many_groups_have_panels_of_their_own() -> None:
    from apf.report.figures import plot_regret

    few = plot_regret(regret_of(["greedy", "sequential", "complete"]), WORDS)
    assert [len(axes.collections) for axes in few.axes] == [3, 3], "bands"
    assert [axes.get_ylabel() for axes in few.axes] == ["Regret, placed without noise", "Regret, placed with noise"]
    many = plot_regret(regret_of(["greedy", "sequential", "complete", "random_ss"]), WORDS)
    assert [len(axes.collections) for axes in many.axes] == [1] * 8
    assert [axes.get_title() for axes in many.axes[:4]] == ["Sequential", "Complete", "Greedy", "Random, by prefix"]
    assert not many.legends
    for figure in (few, many):
        assert all([text.get_text() for text in axes.texts] == ["n = 4"] for axes in figure.axes)
    bands = {axes.get_title(): axes.collections[0].get_facecolor()[0][:3].tolist() for axes in many.axes[:4]}
    drawn = {tuple(band.get_facecolor()[0][:3].tolist()) for band in few.axes[0].collections}
    assert drawn == {tuple(bands[name]) for name in ("Sequential", "Complete", "Greedy")}, "colours stay"


@pytest.mark.parametrize(("median", "scale", "top"), [(0.6, "linear", 1.03), (0.1, "symlog", 0.138)])
def test_small_regret_has_an_axis_that_shows_it(median: float, scale: str, top: float) -> None:
    from apf.report.figures import plot_regret

    for axes in plot_regret(regret_of(["greedy"], median), WORDS).axes:
        assert axes.get_yscale() == scale
        assert axes.get_ylim()[1] == pytest.approx(top)


def with_floor(groups: Sequence[str], level: float = 0.2) -> pd.DataFrame:
    """The curves of `regret_of`, and a group that was evaluated once, before any plan was labelled."""
    still = regret_of(["oracle"], level)
    return pd.concat([regret_of(groups), still[still["plans"] == 100].assign(plans=0, runs=1)], ignore_index=True)


@pytest.mark.parametrize("groups", [["greedy", "sequential"], ["greedy", "sequential", "complete", "random_ss"]])
def test_who_knows_the_chances_is_a_line_in_every_panel(groups: list[str]) -> None:
    from apf.report.figures import plot_regret

    figure = plot_regret(with_floor(groups), WORDS)
    for axes in figure.axes:
        (line,) = [line for line in axes.lines if line.get_linestyle() == "--"]
        assert list(line.get_ydata()) == [0.2, 0.2]
        assert axes.get_xlim()[0] > 50, "no curve begins at 0 plans"
        assert [text.get_text() for text in axes.texts] == ["n = 4"]
    assert [text.get_text() for text in figure.legends[0].get_texts()][-1] == "Who knows the chances: the floor"


def test_a_level_lies_inside_the_axis_and_may_be_missing_in_a_panel() -> None:
    from apf.report.figures import plot_regret

    curves = with_floor(["greedy"], -0.4)
    noisy, analytic = (curves[curves["world"] == world] for world in ("noisy", "analytic"))
    figure = plot_regret(pd.concat([analytic, noisy[noisy["plans"] > 0]]), WORDS)
    assert all(axes.get_ylim()[0] < -0.4 for axes in figure.axes)
    drawn = [[list(line.get_ydata()) for line in axes.lines if line.get_linestyle() == "--"] for axes in figure.axes]
    assert drawn[0] == [[-0.4, -0.4]]
    assert np.isnan(drawn[1]).all()


def test_runs_that_do_not_learn_alone_are_curves() -> None:
    from apf.report.figures import plot_regret

    both = with_floor(["greedy"])
    still = both[both["group"] == "oracle"]
    assert [len(axes.collections) for axes in plot_regret(still, WORDS).axes] == [1, 1], "bands"


def test_accuracy_has_levels_too() -> None:
    from apf.report.figures import accuracy_curves, plot_accuracy

    table = pd.DataFrame({"group": ["greedy", "greedy", "oracle"], "run": [0, 0, 1], "plans": [100, 200, 0]})
    table = table.assign(length=2, accuracy=[0.7, 0.8, 0.95], auc=0.9)
    (axes,) = plot_accuracy(accuracy_curves(table), WORDS).axes
    assert [0.95, 0.95] in [list(line.get_ydata()) for line in axes.lines if line.get_linestyle() == "--"]


def test_groups_of_different_sizes_say_so() -> None:
    from apf.report.figures import plot_regret

    curves = regret_of(["greedy", "sequential"])
    curves.loc[curves["group"] == "greedy", "runs"] = 2
    assert {text.get_text() for axes in plot_regret(curves, WORDS).axes for text in axes.texts} == {"n = 4, 2"}


@pytest.mark.parametrize("labels", [["a", "b"], [f"training.learning_rate=1e-{i}, model.hidden=64" for i in range(3)]])
def test_a_legend_fits_its_figure(labels: list[str]) -> None:
    from apf.report.figures import accuracy_curves, plot_accuracy

    table = pd.DataFrame({"group": labels, "run": range(len(labels))})
    table = table.assign(length=2, plans=100, accuracy=0.9, auc=0.9)
    figure = plot_accuracy(accuracy_curves(table), WORDS)
    figure.canvas.draw()
    box, (legend,) = figure.bbox, figure.legends
    drawn = legend.get_window_extent()
    assert box.x0 <= drawn.x0 < drawn.x1 <= box.x1
    assert box.y0 <= drawn.y0 < drawn.y1 <= box.y1


@pytest.mark.slow
def test_curves_can_end_early(sweep: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    whole, short = tmp_path / "whole", tmp_path / "short"
    plot(monkeypatch, "accuracy", sweep / "runs" / "mine", "--out", whole)
    plot(monkeypatch, "accuracy", sweep / "runs" / "mine", "--out", short, "--until", "10")
    drawn = pd.read_csv(whole.with_suffix(".csv"))
    pd.testing.assert_frame_equal(
        pd.read_csv(short.with_suffix(".csv")), drawn[drawn["plans"] == 10].reset_index(drop=True)
    )
    with pytest.raises(SystemExit) as stop:
        plot(monkeypatch, "accuracy", sweep / "runs" / "mine", "--out", short, "--until", "9")
    assert stop.value.code == "error: --until 9: the first evaluation came at 10 plans"


@pytest.mark.slow
def test_single_runs_can_be_given_and_count_once(
    sweep: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, tmp_path: Path
) -> None:
    folder = sweep / "runs" / "mine"
    (one,) = folder.glob("sequential-*seed0-*")
    (other,) = folder.glob("sequential-*seed1-*")
    plot(monkeypatch, "regret", one, other, one, "--out", tmp_path / "curve")
    assert "sequential: 2 runs" in capsys.readouterr().out
    plot(monkeypatch, "regret", folder, one, "--out", tmp_path / "curve")
    assert "sequential: 2 runs" in capsys.readouterr().out
    plot(monkeypatch, "regret", one, "--out", tmp_path / "curve")
    assert "sequential: 1 run\n" in capsys.readouterr().out


@pytest.mark.slow
def test_runs_that_have_not_finished_are_left_out_and_named(
    sweep: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, tmp_path: Path
) -> None:
    folder = shutil.copytree(sweep / "runs" / "mine", tmp_path / "sweep")
    (half,) = folder.glob("sequential-*seed0-*")
    state = yaml.safe_load((half / "run.yaml").read_text())
    (half / "run.yaml").write_text(yaml.safe_dump(state | {"finished": False}))
    plot(monkeypatch, "accuracy", folder)
    printed = capsys.readouterr()
    assert "sequential: 1 run;" in printed.out or "sequential: 1 run\n" in printed.out
    assert "random_ss: 2 runs" in printed.out
    assert f"left out, not finished: {half}" in printed.err


@pytest.mark.parametrize("name", SCRIPTS)
def test_folders_without_runs(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, tmp_path: Path
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "half").mkdir()
    state = {"name": "half", "hash": "", "sweep": None, "choices": {}, "words": {"plan": "tower", "object": "block"}}
    state |= {"titles": {}, "versions": {}, "finished": False, "seconds": 0}
    (tmp_path / "half" / "run.yaml").write_text(yaml.safe_dump(state))
    for folder, words in (
        ("empty", ("no finished run",)),
        ("half", ("no finished run", "1", "not finished")),
        ("nowhere", ("no such directory",)),
    ):
        with pytest.raises(SystemExit) as end:
            plot(monkeypatch, name, tmp_path / folder)
        line = str(end.value.code)
        assert line.startswith("error: ")
        assert len(line.splitlines()) == 1
        assert folder in line
        assert all(word in line for word in words)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty", "half"]
    assert list((tmp_path / "empty").iterdir()) == []


@pytest.mark.slow
def test_in_a_process_of_its_own_an_error_is_one_line(tmp_path: Path) -> None:
    spawn([SCRIPTS["regret"], tmp_path], cwd=tmp_path).must_refuse("no finished run", str(tmp_path))


@pytest.mark.slow
def test_a_run_that_lacks_a_table_is_named(sweep: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    folder = shutil.copytree(sweep / "runs" / "mine", tmp_path / "sweep")
    (broken,) = folder.glob("sequential-*seed0-*")
    for damage in ("missing", "no parquet file"):
        if damage == "missing":
            (broken / "regret.parquet").unlink()
        else:
            (broken / "regret.parquet").write_text("half a file")
        with pytest.raises(SystemExit) as end:
            plot(monkeypatch, "regret", folder)
        assert str(end.value.code).startswith("error: ")
        assert broken.name in str(end.value.code)


def run(name: str, config: dict[str, Any], **choices: Any) -> Run:
    """A run as `find_runs` would give it. A config has the keys that count here, and a seed."""
    return Run(
        Path(name), {"seed": 0, "plans": 400, **config}, {"sampler": "sequential", "model": "tgn", **choices}, Words()
    )


def test_seeds_share_a_label() -> None:
    assert label_runs([run("a", {"seed": 0}), run("b", {"seed": 1}), run("c", {"seed": 2})]) == ["sequential"] * 3


def test_a_choice_names_the_group() -> None:
    runs = [
        run("a", {"sampler": {"kind": "subsequence", "n": 10}}, sampler="sequential"),
        run("b", {"sampler": {"kind": "complete", "n": 10}}, sampler="complete"),
        run("c", {"seed": 1, "sampler": {"kind": "complete", "n": 10}}, sampler="complete"),
    ]
    assert label_runs(runs) == ["sequential", "complete", "complete"]


def test_a_nested_value_names_the_group() -> None:
    runs = [run(str(seed), {"seed": seed, "world": {"noise": noise}}) for noise in (0.003, 0.01) for seed in (0, 1)]
    assert label_runs(runs) == ["world.noise=0.003"] * 2 + ["world.noise=0.01"] * 2


def test_values_are_named_as_on_the_command_line() -> None:
    trainings = {"early_stopping": True, "patience": 200}, {"early_stopping": True, "patience": None}
    runs = [run(str(number), {"training": training}) for number, training in enumerate(trainings)]
    assert label_runs(runs) == ["training.patience=200", "training.patience=null"]
    runs = [run(str(stops), {"training": {"early_stopping": stops}}) for stops in (False, True)]
    assert label_runs(runs) == ["training.early_stopping=false", "training.early_stopping=true"]


def test_a_value_that_varies_within_an_option_is_named_beside_it() -> None:
    runs = [
        run("a", {"sampler": {"n": 10}}, sampler="greedy"),
        run("b", {"sampler": {"n": 20}}, sampler="greedy"),
        run("c", {"sampler": {"n": 10}}, sampler="complete"),
    ]
    assert label_runs(runs) == [
        "greedy, sampler.n=10",
        "greedy, sampler.n=20",
        "complete, sampler.n=10",
    ]


def test_tasks_name_the_group() -> None:
    target = {"_target_": "apf.towers.Tallest"}
    one = run("a", {"task": {"tallest": target}}, task=["tallest"])
    two = run("b", {"task": {"tallest": target, "overhang": target}}, task=["tallest", "overhang"])
    assert label_runs([one, two]) == ["tallest", "tallest+overhang"]


def test_two_choices_name_the_group() -> None:
    runs = [
        run("a", {"model": {"layers": 3}}, model="lstm", sampler="greedy"),
        run("b", {"model": {"hidden": 64}}, model="tgn", sampler="complete"),
    ]
    assert [set(label.split(", ")) for label in label_runs(runs)] == [{"lstm", "greedy"}, {"tgn", "complete"}]


def test_a_choice_at_another_place_names_the_group() -> None:
    runs = [
        run(name, {"evaluation": {"worlds": {"it": {"_target_": name}}}}, **{"world@evaluation.worlds.it": name})
        for name in ("analytic", "noisy")
    ]
    assert label_runs(runs) == ["analytic", "noisy"]


def seeded(seed: int, training: int) -> Run:
    return run(f"{seed}-{training}", {"seed": seed, "domain": {"training": {"seed": training}}})


def test_a_seed_of_something_else_is_a_difference() -> None:
    same = [seeded(seed, training) for seed in (0, 1) for training in (0, 1)]
    assert label_runs(same) == ["domain.training.seed=0", "domain.training.seed=1"] * 2
    assert label_runs([seeded(0, 0), seeded(1, 0), seeded(2, 1)])[1:] == [
        "domain.training.seed=0",
        "domain.training.seed=1",
    ]


def test_a_seed_that_follows_from_the_runs_own_is_none() -> None:
    assert label_runs([seeded(seed, 100 + seed) for seed in (10, 11, 11)]) == ["sequential"] * 3


def test_a_number_is_the_same_with_and_without_a_point() -> None:
    assert label_runs([run("a", {"training": {"decay": 40}}), run("b", {"training": {"decay": 40.0}})]) == [
        "sequential",
        "sequential",
    ]


def test_runs_that_do_not_learn_are_labelled_by_themselves() -> None:
    """By predictor and planner; what they would learn by, and when they would be evaluated, does not count."""
    learned = [run(name, {"sampler": {"kind": name}}, sampler=name, predictor="learned") for name in ("greedy", "own")]
    oracle = run("c", {"domain": {"stretch": False}, "evaluation": {"also": [80]}}, predictor="oracle", planner="mc")
    assert label_runs([learned[0], oracle, learned[1]]) == ["greedy", "oracle", "own"]
    search = run("d", {"domain": {"stretch": True}}, predictor="oracle", planner="search", sampler="greedy")
    assert label_runs([oracle, learned[0], search]) == ["oracle, mc", "greedy", "oracle, search"]


def test_what_does_not_change_the_results_does_not_set_runs_apart() -> None:
    """Device, threads, the name of the sweep, and where a run was mirrored to."""
    runs = [
        run("a", {"device": "cpu", "threads": 1, "sweep": "x", "tracker": {"mode": "offline"}}, tracker="wandb"),
        run("b", {"seed": 1, "device": "cuda", "threads": 4, "sweep": "y", "tracker": {}}, tracker="none"),
    ]
    assert label_runs(runs) == ["sequential", "sequential"]


def test_lists_are_shown_whole() -> None:
    runs = [run(str(n), {"evaluation": {"lengths": list(range(2, n))}}) for n in (4, 5)]
    assert label_runs(runs) == ["evaluation.lengths=2+3", "evaluation.lengths=2+3+4"]


@pytest.mark.slow
def test_find_runs_and_gather(sweep: Path, tmp_path: Path) -> None:
    runs, unfinished = find_runs([sweep])
    assert len(runs) == 4
    assert unfinished == []
    table = gather(runs, "accuracy")
    measures = ["accuracy", "auc", "nll", "ece"]
    assert list(table.columns) == ["run", "group", "step", "plans", "length", *measures, "n"]
    assert table.groupby("group")["run"].nunique().to_dict() == {"sequential": 2, "random_ss": 2}
    with pytest.raises(InputError, match="no finished run"):
        find_runs([tmp_path])


@pytest.mark.slow
def test_table_regret(sweep: Path, tmp_path: Path) -> None:
    folder = sweep / "runs" / "mine"
    result = spawn([TABLE, folder, "--out", tmp_path / "regret.csv", "--plans", "11"], cwd=tmp_path).must_work()
    table = pd.read_csv(tmp_path / "regret.csv")
    assert len(table) == 2 * 2 * 3 * 2
    assert set(table["chosen"]) == {2 * 3}  # runs x problems
    regret = pd.concat(pd.read_parquet(run / "regret.parquet") for run in folder.glob("sequential-*"))
    keys = ["world", "task", "plans"]
    for _, row in table[table["group"] == "sequential"].iterrows():
        mine = regret[(regret[keys] == row[keys]).all(axis=1)]
        assert row["standing"] == mine["feasible"].sum()
        expected = [*mine["regret"].quantile([0.25, 0.5, 0.75]), mine["regret"].mean()]
        assert np.allclose(row[["q25", "median", "q75", "mean"]].astype(float), expected, atol=1e-4, equal_nan=True)
    shown = [line.split()[1] for line in result.out.splitlines() if line.split()[0] in ("sequential", "random_ss")]
    assert shown == ["10"] * 2 * 2 * 3
    spawn([TABLE, folder, "--plans", "3"], cwd=tmp_path).must_refuse("no regret")


@pytest.mark.slow
def test_claims_of_runs(sweep: Path, tmp_path: Path) -> None:
    """From run directories; the claims about what was not run say so."""
    folder = sweep / "runs" / "mine"
    result = spawn([CLAIMS, folder, "--out", tmp_path / "claims.csv", "--draws", "5"], cwd=tmp_path).must_work()
    table = pd.read_csv(tmp_path / "claims.csv").set_index("claim")
    assert str(tmp_path / "claims.csv") in result.out
    row = table.loc["6. Sequential beats random_ss"]
    assert row["runs"] == "2 + 2"
    parts = {name: pd.concat(map(pd.read_parquet, folder.glob(f"{name}-*/regret.parquet"))) for name in SAMPLERS}
    means = {
        name: part[part["world"] == "analytic"].groupby(["task", "plans"])["regret"].mean().mean()
        for name, part in parts.items()
    }
    assert row["value"] == pytest.approx(means["random_ss"] - means["sequential"], abs=1e-3)
    assert table.loc["6. Random_ss beats greedy", "verdict"] == "undecided"
    assert "greedy" in table.loc["6. Random_ss beats greedy", "note"]
    spawn([CLAIMS, tmp_path], cwd=tmp_path).must_refuse("no finished run")


@pytest.mark.slow
def test_what_is_kept_of_runs_gives_the_same_tables_and_names_no_path(sweep: Path, tmp_path: Path) -> None:
    runs, kept = sweep / "runs" / "mine", tmp_path / "kept"
    spawn([KEEP, runs, "--out", kept], cwd=tmp_path).must_work()
    for source, name in ((runs, "before"), (kept, "after")):
        spawn([TABLE, source, "--out", f"{name}.csv"], cwd=tmp_path).must_work()
    assert (tmp_path / "before.csv").read_bytes() == (tmp_path / "after.csv").read_bytes()
    originals = {path.name for path in runs.iterdir() if path.is_dir()}
    assert {path.name for path in (kept / "mine").iterdir()} == originals
    for run in (kept / "mine").iterdir():
        files = ["accuracy.parquet", "config.yaml", "regret.parquet", "run.yaml"]
        assert sorted(path.name for path in run.iterdir()) == files
        assert str(sweep) not in (run / "run.yaml").read_text()
