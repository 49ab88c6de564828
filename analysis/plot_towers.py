"""The towers that the last evaluation of a run chose: a gallery, a row for each task (appendix, Towers).

python -m analysis.plot_towers runs/first --world noisy --number 10 --out gallery.png

A tower that stood is solid; the blocks from the first that fell on are outlines. Below each tower are its value, the
chance that the predictor gave it, and what came of it.
"""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.commands import draw_each, parser_of
from apf.errors import InputError
from apf.report.runs import Run
from apf.towers import Towers, read_towers
from apf.towers.picture import FELL, draw_in_perspective

PANEL = (1.25, 1.95)
"""Width and height of the panel of one tower [inch]."""


def gallery(run: Run, world: str | None, number: int) -> Figure:
    """The towers of a run's last evaluation in one world.

    Args:
        run: A run of towers.
        world: One of the run's `evaluation.worlds`; None: its first.
        number: Problems to show for each task, at most.

    Raises:
        InputError: The run chose no towers, or was not evaluated in this world.
    """
    path = run.directory / "evaluation_plans.parquet"
    table = run.table("evaluation_plans")
    if "tower" not in table or not len(table):
        raise InputError(f"{path}: holds no towers")
    worlds = list(dict.fromkeys(table["world"]))
    world = worlds[0] if world is None else world
    if world not in worlds:
        raise InputError(f"world is {world}; {path} has {', '.join(worlds)}")
    rows = table[(table["step"] == table["step"].max()) & (table["world"] == world)]
    towers = {name: each.plans[i : i + 1] for each in read_towers(path) for i, name in enumerate(each.names)}
    tasks = list(dict.fromkeys(rows["task"]))
    shown = min(number, rows["problem"].nunique())
    figure = Figure(figsize=(PANEL[0] * shown + 0.5, PANEL[1] * len(tasks) + 0.3), layout="constrained")
    axes = figure.subplots(len(tasks), shown, squeeze=False)
    for task, of_task in zip(tasks, axes, strict=True):
        chosen = rows[rows["task"] == task].groupby("problem", sort=True)
        for ax, (_, tower) in zip(of_task, chosen, strict=False):
            _draw(ax, tower, towers)
        title = run.words.titles.get(task, task)
        stood = chosen["label"].min().fillna(0).eq(1)
        of_task[0].text(
            -0.05,
            0.5,
            f"{title}\n{int(stood.sum())} of {len(stood)} stood",
            transform=of_task[0].transAxes,
            rotation=90,
            ha="right",
            va="center",
            fontsize=8,
        )
    figure.suptitle(f"Chosen in step {rows['step'].max()}, world {world}", fontsize=9)
    return figure


def _draw(ax: Axes, rows: pd.DataFrame, towers: Mapping[object, Towers]) -> None:
    """One tower, of whose placements there is a row each."""
    tower = towers[rows["tower"].iloc[0]]
    stood = int((rows["label"] == 1).sum())
    draw_in_perspective(ax, tower, stood=stood, names=False)
    fell = stood < len(rows)
    said = f"V {rows['value'].iloc[0]:.3g}, P {rows['chance'].iloc[-1]:.2f}\n{'fell' if fell else 'stood'}"
    ax.set_title(said, fontsize=6.5, color=FELL if fell else "black", y=-0.18)


def main() -> None:
    """Draw the galleries of the runs on the command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--world", help="one of evaluation.worlds; the first by default")
    parser.add_argument("--number", type=int, default=10, help="towers of each task, at most")
    parser.add_argument("--out", type=Path, help="file of the picture; by default figures/towers.png in the run")
    arguments = parser.parse_args()
    draw_each(arguments, "towers.png", lambda run: gallery(run, arguments.world, arguments.number), dpi=150)


if __name__ == "__main__":
    main()
