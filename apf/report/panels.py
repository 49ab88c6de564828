"""Panels of learning curves: groups of runs in one panel if they are few, else each in panels of its own."""

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle
from typing import TYPE_CHECKING, Any

import pandas as pd

from apf.report.names import colours_of, in_order, name_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

PANEL = (2.6, 2.3)
"""How wide and how tall a panel of several groups is [inch]."""
SMALL = (1.25, 1.3)
"""A panel of one group among many [inch]."""
TOGETHER = 3
"""Groups in one panel at most: more bands than that hide each other."""
ABREAST = 6
"""Panels of single groups in a row at most."""
MARKERS = "os^DvX"
"""Of the groups in turn, for those who do not tell the colours apart."""
DASHES = ("--", "-.")
"""Of the lines of groups that have no curve, in turn."""
LINEAR = 0.05
"""A narrow axis is linear up to here, and logarithmic above."""
TICKS = (0.0, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Of a narrow axis."""
STYLE: Any = {
    **{"font.size": 8, "axes.titlesize": 9, "axes.labelsize": 8, "legend.fontsize": 8, "pdf.fonttype": 42},
    **{"axes.linewidth": 0.7, "xtick.major.width": 0.7, "ytick.major.width": 0.7, "lines.linewidth": 1.5},
}
"""Of every figure."""


@dataclass(frozen=True)
class Row:
    """One quantity over the number of labelled plans.

    label: of the axis. curves: rows with group, plans, runs, and the columns of `lines`: the centre of a curve and the
    ends of its band. limits: of the axis. narrow: give more room to what is small (`LINEAR`). reference: where a dotted
    line is. rises: do good curves go up? levels: of each group that has no curve, where its line is in the panel of
    each value.
    """

    label: str
    curves: pd.DataFrame
    lines: tuple[str, str, str]
    limits: tuple[float, float]
    narrow: bool = False
    reference: float | None = None
    rises: bool = False
    levels: Mapping[str, Mapping[Any, float]] = field(default_factory=dict)


def draw_rows(rows: Sequence[Row], column: str, titles: Mapping[Any, str], across: str) -> "Figure":
    """Panels over the number of labelled plans, each with its number of runs, n.

    Up to `TOGETHER` groups are drawn in one panel: a row of panels for each row, or two if it is one row of many. More
    groups have a column each: their own curve and band in colour, the curves of the others in grey.

    Args:
        rows: The quantities.
        column: Of the curves, whose values have a panel each.
        titles: Of the panels, by these values.
        across: Label of the horizontal axis.
    """
    import matplotlib as mpl
    import seaborn as sns

    groups = in_order(dict.fromkeys(group for row in rows for group in row.curves["group"]))
    cells = [(row, value) for row in rows for value in titles]
    draw = _together if len(groups) <= TOGETHER else _apart
    with sns.axes_style("ticks", {"axes.grid": True, "grid.color": "0.92"}), mpl.rc_context(STYLE):
        figure = draw(cells, column, titles, across, colours_of(groups))
        sns.despine(figure)
    return figure


def _together(
    cells: Sequence[tuple[Row, Any]], column: str, titles: Mapping[Any, str], across: str, colours: Mapping[str, str]
) -> "Figure":
    """All groups in each panel; a legend if there are several."""
    from matplotlib.figure import Figure  # of no backend: it opens no window, and leaves a program's own figures alone

    one_row = len(cells) == len(titles)
    columns = -(-len(titles) // 2) if one_row and len(titles) > 4 else len(titles)
    depth = -(-len(cells) // columns)
    flat = _flat(cells)
    names = [name_of(group) for group in (*colours, *flat)]
    entry = 0.5 + 0.062 * max(map(len, names), default=0)  # of the legend [inch], about
    abreast = min(len(names), max(1, int(PANEL[0] * columns / entry)))
    legend_rows = -(-len(names) // abreast) if len(names) > 1 else 0
    size = (max(PANEL[0] * columns, entry) + 0.3, PANEL[1] * depth + 0.2 * legend_rows)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(depth, columns, sharex=True, squeeze=False)
    handles: list[Line2D] = []
    for number, (row, value) in enumerate(cells):
        axes, curves = grid.flat[number], row.curves[row.curves[column] == value]
        handles = [
            _curve(axes, curves[curves["group"] == group], row.lines, colour, marker)
            for (group, colour), marker in zip(colours.items(), cycle(MARKERS))
        ]
        handles += _levels(axes, row, value, flat)
        counts = [curves["runs"][curves["group"] == group].max() for group in colours]
        _finish(axes, row, counts if len(set(counts)) > 1 else counts[:1])
        if number < len(titles):
            axes.set_title(titles[value], parse_math=False)
        if number >= len(cells) - columns:
            axes.set_xlabel(across)
            axes.tick_params(labelbottom=True)
        if number % columns == 0:
            axes.set_ylabel(textwrap.fill(row.label, 34), parse_math=False)
        else:
            axes.tick_params(labelleft=False)
    for spare in grid.flat[len(cells) :]:
        spare.remove()
    if len(names) > 1:
        _legend(figure, handles, names, abreast)
    return figure


def _apart(
    cells: Sequence[tuple[Row, Any]], column: str, titles: Mapping[Any, str], across: str, colours: Mapping[str, str]
) -> "Figure":
    """A column of panels for each group; at most `ABREAST` columns, then further rows below."""
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    groups = list(colours)
    handles: list[Line2D] = []
    columns = min(ABREAST, len(groups))
    tiers = -(-len(groups) // columns)
    depth = len(cells) * tiers
    flat = _flat(cells)
    size = (SMALL[0] * columns + 0.8, SMALL[1] * depth + 0.3 + 0.2 * (tiers + len(flat)))
    layout = ConstrainedLayoutEngine(w_pad=0.02, h_pad=0.03)
    figure = Figure(figsize=size, layout=layout)
    grid = figure.subplots(depth, columns, sharex=True, squeeze=False)
    for line, of_line in enumerate(grid):
        tier, (row, value) = line // len(cells), cells[line % len(cells)]
        curves = row.curves[row.curves[column] == value]
        here = groups[tier * columns : (tier + 1) * columns]
        for axes, group in zip(of_line, here):
            for other in groups:
                others = curves[curves["group"] == other].sort_values("plans")
                axes.plot(others["plans"], others[row.lines[0]], color="0.8", linewidth=0.7, zorder=1)
            mine = curves[curves["group"] == group]
            _curve(axes, mine, row.lines, colours[group], None)
            handles = _levels(axes, row, value, flat)
            _finish(axes, row, [mine["runs"].max()])
            axes.tick_params(labelsize=7, labelleft=group == here[0])
            if line % len(cells) == 0:
                axes.set_title(textwrap.fill(name_of(group), 21), fontsize=8, color=colours[group], parse_math=False)
            if line % len(cells) == len(cells) - 1:
                axes.set_xlabel(across, fontsize=7)
                axes.tick_params(labelbottom=True)
        label = f"{titles[value]}\n" + ",\n".join(textwrap.fill(part, 24) for part in row.label.split(", "))
        of_line[0].set_ylabel(label, fontsize=7, parse_math=False)
        for spare in of_line[len(here) :]:
            spare.remove()
    if flat:
        _legend(figure, handles, [name_of(group) for group in flat], 1)
    return figure


def _flat(cells: Sequence[tuple[Row, Any]]) -> list[str]:
    """The groups that have levels in place of curves."""
    return in_order(dict.fromkeys(group for row, _ in cells for group in row.levels))


def _levels(axes: "Axes", row: Row, value: Any, flat: Sequence[str]) -> "list[Line2D]":
    """The lines of groups without a curve in the panel of a value."""
    return [
        axes.axhline(row.levels.get(group, {}).get(value, math.nan), color="0.35", linewidth=1, linestyle=style)
        for group, style in zip(flat, cycle(DASHES))
    ]


def _legend(figure: "Figure", handles: "Sequence[Line2D]", names: Sequence[str], abreast: int) -> None:
    """A legend above all panels, with so many entries abreast."""
    legend = figure.legend(handles, names, loc="outside upper center", ncols=abreast, frameon=False)
    for text in legend.get_texts():  # names that a person gave, a `$` in them too
        text.set_parse_math(False)


def _curve(
    axes: "Axes", curves: pd.DataFrame, lines: tuple[str, str, str], colour: str, marker: str | None
) -> "Line2D":
    """The line and the band of one group. Returns the line."""
    centre, low, high = lines
    curve = curves.sort_values("plans")
    (line,) = axes.plot(
        curve["plans"], curve[centre], color=colour, marker=marker if len(curve) < 15 else None, markersize=3.5
    )
    axes.fill_between(curve["plans"], curve[low], curve[high], color=colour, alpha=0.18, linewidth=0)
    return line


def _finish(axes: "Axes", row: Row, counts: Sequence[float]) -> None:
    """Axis, reference and number of runs of a panel; counts: of each group, or of all."""
    if row.narrow:
        axes.set_yscale("symlog", linthresh=LINEAR, linscale=0.4)
        ticks = [tick for tick in TICKS if tick <= row.limits[1]]
        axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.set_yticks([], minor=True)
    axes.set_ylim(*row.limits)
    if row.reference is not None:
        axes.axhline(row.reference, color="0.6", linewidth=0.8, linestyle=":", zorder=0)
    said = ", ".join("0" if pd.isna(n) else f"{n:.0f}" for n in counts)
    place = 0.02 if row.rises else 0.97
    axes.text(
        0.97,
        place,
        f"n = {said}",
        transform=axes.transAxes,
        ha="right",
        va="bottom" if row.rises else "top",
        fontsize=7,
        color="0.35",
    )
