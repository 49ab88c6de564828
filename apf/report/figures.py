"""Learning curves as figures of a paper: regret for each task, accuracy for each length."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

PANEL = (2.6, 2.3)
"""How wide and how tall one panel is [inch]."""
MARKERS = "os^DvX"
"""Of the groups in turn: some of their colours are close to each other."""


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


def accuracy_curves(accuracy: pd.DataFrame) -> pd.DataFrame:
    """Mean, least and greatest accuracy over runs, and mean AUC: group, length, plans, mean, min, max, auc, runs."""
    by = accuracy.groupby(["group", "length", "plans"], sort=False)
    curves = by["accuracy"].agg(["mean", "min", "max"])
    curves["auc"] = by["auc"].mean()
    curves["runs"] = by["run"].nunique()
    return curves.reset_index()


def plot_regret(curves: pd.DataFrame, words: Words) -> "Figure":
    """One row for each world, one panel for each task: the median, shaded between the quartiles."""
    tasks = list(dict.fromkeys(curves["task"]))
    titles = {task: words.titles.get(task) or task.replace("_", " ") for task in tasks}
    rows = {f"Regret in world {world}": curves[curves["world"] == world] for world in sorted(set(curves["world"]))}
    figure, panels = _panels(rows, "task", titles, ("median", "q25", "q75"), words)
    panels[0].set_ylim(-0.03, 1.03)
    return figure


def plot_accuracy(curves: pd.DataFrame, words: Words) -> "Figure":
    """One panel for each length: the mean, shaded from the least to the greatest run."""
    lengths = sorted(set(curves["length"]))
    titles = {length: f"{length} {plural(words.object)}" for length in lengths}
    figure, panels = _panels({"Accuracy": curves}, "length", titles, ("mean", "min", "max"), words)
    panels[0].set_ylim(min(0.45, curves["min"].min() - 0.03), 1.01)
    for axes in panels:
        axes.axhline(0.5, color="0.75", linewidth=0.8, linestyle=":", zorder=0)
    return figure


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


def _panels(
    rows: Mapping[str, pd.DataFrame],
    column: str,
    titles: Mapping[Any, str],
    lines: tuple[str, str, str],
    words: Words,
) -> tuple["Figure", list["Axes"]]:
    """Rows of panels over the number of labelled plans, one line with its band for each group.

    A single row of many panels is broken into two.
    """
    import matplotlib as mpl
    import seaborn as sns

    groups = list(dict.fromkeys(group for curves in rows.values() for group in curves["group"]))
    colours = dict(zip(groups, sns.color_palette("colorblind", len(groups)), strict=True))
    cells = [(quantity, curves, value) for quantity, curves in rows.items() for value in titles]
    columns = -(-len(titles) // 2) if len(rows) == 1 and len(titles) > 4 else len(titles)
    style: Any = {"font.size": 8, "axes.titlesize": 9, "axes.labelsize": 8, "legend.fontsize": 8, "pdf.fonttype": 42}
    with sns.axes_style("ticks", {"axes.grid": True, "grid.color": "0.92"}), mpl.rc_context(style):
        figure, panels, abreast = _grid(len(cells), columns, groups)
        for number, ((quantity, curves, value), axes) in enumerate(zip(cells, panels, strict=True)):
            handles = _curves(axes, curves[curves[column] == value], colours, lines)
            if number < len(titles):
                axes.set_title(titles[value], parse_math=False)
            if number >= len(cells) - columns:
                axes.set_xlabel(f"Labelled {plural(words.plan)}")
                axes.tick_params(labelbottom=True)
            if number % columns == 0:
                axes.set_ylabel(quantity, parse_math=False)
        sns.despine(figure)
        if len(groups) > 1:
            legend = figure.legend(handles, groups, loc="outside upper center", ncols=abreast, frameon=False)
            for text in legend.get_texts():  # names that a person gave, a `$` in them too
                text.set_parse_math(False)
    return figure, panels


def _grid(cells: int, columns: int, groups: Sequence[str]) -> tuple["Figure", list["Axes"], int]:
    """A figure, its panels, and how many names of groups its legend has in a row."""
    from matplotlib.figure import Figure  # of no backend: it opens no window, and leaves a program's own figures alone

    wide, tall = PANEL
    depth = -(-cells // columns)
    entry = 0.5 + 0.062 * max(map(len, groups))  # of the legend [inch], about
    abreast = min(6, len(groups), max(1, int(wide * columns / entry)))
    legend_rows = -(-len(groups) // abreast) if len(groups) > 1 else 0
    size = (max(wide * columns, entry) + 0.3, tall * depth + 0.2 * legend_rows)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(depth, columns, sharex=True, sharey=True, squeeze=False)
    for spare in grid.flat[cells:]:
        spare.remove()
    return figure, list(grid.flat)[:cells], abreast


def _curves(
    axes: "Axes", curves: pd.DataFrame, colours: Mapping[str, Any], lines: tuple[str, str, str]
) -> list["Line2D"]:
    """The line and the band of each group, in one panel. Returns the lines."""
    centre, low, high = lines
    outlined = len(colours) > 3  # more bands than that hide each other
    handles = []
    for (group, colour), shape in zip(colours.items(), cycle(MARKERS)):
        line = curves[curves["group"] == group].sort_values("plans")
        marker = shape if len(line) < 15 else None
        handles += axes.plot(line["plans"], line[centre], color=colour, marker=marker, markersize=3.5)
        shade = 0.05 if outlined else 0.18
        axes.fill_between(line["plans"], line[low], line[high], color=colour, alpha=shade, linewidth=0)
        if outlined:
            axes.plot(line["plans"], line[[low, high]], color=colour, linewidth=0.6, linestyle=":")
    return handles
