"""Learning curves as tables and figures of a paper: regret for each task, accuracy and its like for each length."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from apf.errors import InputError
from apf.planning.measures import MEASURES
from apf.report.names import world_of
from apf.report.panels import Row, draw_rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

QUANTITIES = {
    "accuracy": "Accuracy",
    "auc": "Area under the ROC curve",
    "nll": "Negative log-likelihood [nats]",
    "ece": "Expected calibration error",
}
"""What the measures of an evaluation are called on an axis."""
CHANCE = {"accuracy": 0.5, "auc": 0.5, "nll": math.log(2)}
"""What a predictor reaches that says 1/2 of every plan, where that is a mark to compare with."""


@dataclass(frozen=True)
class Words:
    """The words of a domain in figures: for a plan, for an object that is placed, and for each task, by its name."""

    plan: str = "plan"
    object: str = "placement"
    titles: Mapping[str, str] = field(default_factory=dict)

    @staticmethod
    def common(words: Sequence["Words"]) -> "Words":
        """The words that all runs share; where they differ, general words. The titles of all tasks."""
        plans, objects = {w.plan for w in words}, {w.object for w in words}
        titles = {name: title for w in words for name, title in w.titles.items()}
        same = {"plan": plans, "object": objects}
        return Words(**{name: found.pop() for name, found in same.items() if len(found) == 1}, titles=titles)


def regret_curves(regret: pd.DataFrame) -> pd.DataFrame:
    """Median and quartiles over problems and runs: group, world, task, plans, median, q25, q75, runs, problems."""
    by = regret.dropna(subset=["regret"]).groupby(["group", "world", "task", "plans"], sort=False)
    values = by["regret"]
    curves = pd.DataFrame({"median": values.median(), "q25": values.quantile(0.25), "q75": values.quantile(0.75)})
    curves["runs"] = by["run"].nunique()
    curves["problems"] = by.size()
    return curves.reset_index()[["group", "world", "task", "plans", "median", "q25", "q75", "runs", "problems"]]


def accuracy_curves(accuracy: pd.DataFrame, metric: str = "accuracy") -> pd.DataFrame:
    """One measure over runs: group, length, plans, mean, min, max, then the means of the other measures, runs.

    Args:
        accuracy: Rows of `accuracy.parquet`, with columns run and group. Tables of earlier versions lack some measures.
        metric: One of `MEASURES`.

    Raises:
        InputError: No run has this measure.
    """
    known = [name for name in MEASURES if name in accuracy]
    if metric not in known:
        raise InputError(f"the runs are of an earlier version, which did not measure {metric}; have {', '.join(known)}")
    by = accuracy.dropna(subset=[metric]).groupby(["group", "length", "plans"], sort=False)
    curves = by[metric].agg(["mean", "min", "max"])
    for name in known:
        if name != metric:
            curves[name] = by[name].mean()
    curves["runs"] = by["run"].nunique()
    return curves.reset_index()


def plot_regret(curves: pd.DataFrame, words: Words) -> "Figure":
    """One row for each world, one panel for each task: the median, shaded between the quartiles.

    A group that labelled nothing, such as `predictor=oracle`, is a dashed line at its median.
    """
    titles = {task: words.titles.get(task) or task.replace("_", " ") for task in dict.fromkeys(curves["task"])}
    learning, still = split(curves)
    low = min([0.0, learning["q25"].min(), *still["median"]])
    high = max([learning["q75"].max(), *still["median"]])
    narrow = bool((learning["median"] < 0.25).mean() > 0.5)
    limits = (low - (0.002 if narrow else 0.03), max(1.0, high) * (1.15 if narrow else 1.03))
    if narrow and high < 0.25:
        limits = (limits[0], high * 1.15)
    lines = ("median", "q25", "q75")
    rows = [
        Row(
            f"Regret, {world_of(world)}",
            learning[learning["world"] == world],
            lines,
            limits,
            narrow,
            levels=levels_of(still[still["world"] == world], "task", "median"),
        )
        for world in sorted(set(curves["world"]))
    ]
    return draw_rows(rows, "task", titles, f"Labelled {plural(words.plan)}")


def split(curves: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The curves of what learns, and the rows of groups that labelled nothing, which are levels beside the curves.

    If there are no curves, the rows of groups that labelled nothing are drawn in the place of curves.
    """
    learning = curves["plans"].groupby(curves["group"]).transform("max") > 0
    return (curves[learning], curves[~learning]) if learning.any() else (curves, curves[learning])


def levels_of(still: pd.DataFrame, column: str, value: str) -> dict[str, dict[Any, float]]:
    """Where the line of each group that labelled nothing lies, in the panel of each value of a column.

    Args:
        still: Of `split`.
        column: Whose values have a panel each.
        value: The column that holds the level.
    """
    return {str(group): dict(zip(part[column], part[value])) for group, part in still.groupby("group", sort=False)}


def plot_accuracy(curves: pd.DataFrame, words: Words, metric: str = "accuracy") -> "Figure":
    """One panel for each length: the mean of a measure over runs, shaded from the least to the greatest run.

    Args:
        curves: What `accuracy_curves` gives of the measure.
        words: Of the domain.
        metric: One of `MEASURES`.
    """
    return plot_measures({metric: curves}, words)


def plot_measures(curves: Mapping[str, pd.DataFrame], words: Words) -> "Figure":
    """One row for each measure, one panel for each length, as in `plot_accuracy`."""
    lengths = sorted({length for table in curves.values() for length in table["length"]})
    titles = {length: f"{length} {plural(words.object)}" for length in lengths}
    rows = [_row(metric, table) for metric, table in curves.items()]
    return draw_rows(rows, "length", titles, f"Labelled {plural(words.plan)}")


def _row(metric: str, curves: pd.DataFrame) -> Row:
    """The row of a measure. Accuracy and AUC end at 1; NLL and ECE begin at 0, on a narrow axis if all are small."""
    learning, still = split(curves)
    high, low = (float(f([f(learning[end]), *still["mean"]])) for f, end in ((max, "max"), (min, "min")))
    best_is_high = metric in ("accuracy", "auc")
    narrow = not best_is_high and high < 0.25
    limits = (min(0.4, low - 0.1), 1.01) if best_is_high else (0.0, high * 1.15 or 1.0)
    lines, levels = ("mean", "min", "max"), levels_of(still, "length", "mean")
    return Row(QUANTITIES[metric], learning, lines, limits, narrow, CHANCE.get(metric), best_is_high, levels)


def plural(word: str) -> str:
    """The plural of an English noun, also of one that ends in s, x, ch or sh."""
    return word + ("es" if word.endswith(("s", "x", "ch", "sh")) else "s")


def save(figure: "Figure", table: pd.DataFrame, stem: Path) -> list[Path]:
    """Write STEM.pdf, STEM.png and the plotted table, STEM.csv. Returns the paths.

    Args:
        figure: What was plotted.
        table: The data of the plot.
        stem: The path without its ending.
    """
    stem.parent.mkdir(parents=True, exist_ok=True)
    paths = [stem.with_name(stem.name + ending) for ending in (".pdf", ".png", ".csv")]
    figure.savefig(paths[0], metadata={"CreationDate": None})
    figure.savefig(paths[1], dpi=200)
    table.to_csv(paths[2], index=False)
    return paths
