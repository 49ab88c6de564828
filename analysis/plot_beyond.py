"""Several ways to learn and to plan: mean regret with its 95 % interval over runs, for all tasks and for each.

python -m analysis.plot_beyond "Monte Carlo=runs/strategies" "Search=runs/beyond" "Oracle=runs/oracle" --out beyond

Each argument names a group of finished runs. A group that does not learn, such as `predictor=oracle`, is a dashed line.
Regret is that against the best of the random candidates, so that a planner which finds better plans has less than 0.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from analysis.commands import by_name, check_world, finished_runs, one_line_errors, parser_of
from analysis.intervals import over_runs
from apf.report.figures import Words, levels_of, plural, save, split
from apf.report.names import world_of
from apf.report.panels import Row, draw_rows
from apf.report.runs import Run, gather

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ALL = "all tasks"
"""In place of a task: the mean over tasks."""


def mean_curves(regret: pd.DataFrame, world: str) -> pd.DataFrame:
    """Mean regret over problems and runs: group, task, plans, mean, low, high, worst, standing, chance, runs.

    low, high: 95 % interval of the mean by bootstrap over runs; of a single run NaN. worst: of the runs' means.
    standing: share of chosen plans that succeeded. chance: mean of what was predicted of these plans.

    Args:
        regret: Rows of `regret.parquet`, with columns run and group.
        world: Where chosen plans were executed.
    """
    here = regret[regret["world"] == world].astype({"feasible": float})
    quantities = ["regret", "feasible", "chance"]
    of_runs = here.groupby(["group", "plans", "run", "task"], sort=False)[quantities].mean().reset_index()
    of_all = of_runs.groupby(["group", "plans", "run"], sort=False)[quantities].mean().reset_index()
    both = pd.concat([of_all.assign(task=ALL), of_runs], ignore_index=True)
    rows = []
    for (group, task, plans), part in both.groupby(["group", "task", "plans"], sort=False):
        values = part["regret"].to_numpy()
        low, high = over_runs(values)
        said = part["feasible"].mean(), part["chance"].mean()
        rows.append((group, task, plans, values.mean(), low, high, values.max(), *said, len(values)))
    columns = ["group", "task", "plans", "mean", "low", "high", "worst", "standing", "chance", "runs"]
    return pd.DataFrame(rows, columns=columns)


def plot(curves: pd.DataFrame, words: Words, world: str) -> "Figure":
    """A panel for all tasks together, then one for each.

    Args:
        curves: Of `mean_curves`.
        words: Of the domain.
        world: Where chosen plans were executed.
    """
    tasks = dict.fromkeys(curves["task"])
    titles = {task: words.titles.get(task) or str(task).replace("_", " ").capitalize() for task in tasks}
    learning, still = split(curves)
    limits = (min(0.0, curves["low"].min(), curves["mean"].min()) - 0.03, min(1.0, learning["high"].max()) + 0.03)
    row = Row(
        f"Mean regret, {world_of(world)}",
        learning,
        ("mean", "low", "high"),
        limits,
        reference=0.0,
        levels=levels_of(still, "task", "mean"),
    )
    return draw_rows([row], "task", titles, f"Labelled {plural(words.plan)}")


def gathered(groups: Mapping[str, Sequence[Path]]) -> tuple[list[Run], pd.DataFrame]:
    """The runs of all groups, and one table of their regret whose column group has the groups' names.

    Args:
        groups: Folders by the name of the group.
    """
    runs: list[Run] = []
    tables = []
    for name, directories in groups.items():
        of_group = finished_runs(directories)
        table = gather(of_group, "regret").assign(group=name)
        tables.append(table.assign(run=table["run"] + len(runs)))
        runs += of_group
    return runs, pd.concat(tables, ignore_index=True)


def main() -> None:
    """Draw the runs on the command line, and print what was drawn."""
    parser = parser_of(__doc__, names="needed")
    parser.add_argument("--world", default="noisy", help="where chosen plans were executed (default: %(default)s)")
    parser.add_argument("--out", type=Path, required=True, help="where to write: STEM.pdf, STEM.png, STEM.csv")
    arguments = parser.parse_args()
    with one_line_errors():
        runs, regret = gathered(by_name(arguments.directories, optional=False))
        check_world(arguments.world, regret)
        curves = mean_curves(regret, arguments.world)
        words = Words.common([run.words for run in runs])
        paths = save(plot(curves, words, arguments.world), curves.round(4), arguments.out)
    print(curves[curves["task"] == ALL].drop(columns="task").round(3).to_string(index=False))
    print(*paths, sep="\n")


if __name__ == "__main__":
    main()
