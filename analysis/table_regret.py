"""Regret and success of one or many runs, at each evaluation or the last, as a table.

python -m analysis.table_regret runs/strategies runs/predictors --out results/regret.csv --plans 200
"""

from pathlib import Path

import numpy as np
import pandas as pd
from rich.table import Table

from analysis.commands import check_world, finished_runs, one_line_errors, parser_of
from analysis.intervals import over_runs_and_problems
from apf.errors import InputError
from apf.report.runs import gather
from apf.terminal import console

WIDTH = 140


def table_of(regret: pd.DataFrame) -> pd.DataFrame:
    """One row for each group, world, task and number of plans: quartiles, mean, plans that succeeded and all, runs.

    Regret is that of problems in which a candidate stands; standing and chosen count all problems. mean_low, mean_high
    and share_low, share_high: 95 % intervals of the mean regret and of the share that succeeded.
    """
    by = regret.groupby(["group", "world", "task", "plans"], sort=False)
    table = by["regret"].quantile(np.array([0.25, 0.5, 0.75])).unstack().set_axis(["q25", "median", "q75"], axis=1)
    table["mean"] = by["regret"].mean()
    table["standing"] = by["feasible"].sum()
    table["chosen"] = by.size()
    table["runs"] = by["run"].nunique()
    for name, column in (("mean", "regret"), ("share", "feasible")):
        ends = [over_runs_and_problems(part, column) for _, part in by]
        table[f"{name}_low"], table[f"{name}_high"] = np.transpose(ends)
    return table.reset_index()


def at(table: pd.DataFrame, plans: int | None) -> pd.DataFrame:
    """The rows of each group's last evaluation, or of the last with at most so many plans."""
    if plans is not None:
        table = table[table["plans"] <= plans]
    return table[table["plans"] == table.groupby("group")["plans"].transform("max")]


def main() -> None:
    """Write and show the table for the runs on the command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=Path, help="CSV to write")
    parser.add_argument("--world", help="only where plans were executed in this world")
    parser.add_argument("--plans", type=int, help="show each group's last evaluation with at most so many plans")
    arguments = parser.parse_args()
    with one_line_errors():
        regret = gather(finished_runs(arguments.directories), "regret")
        if arguments.world is not None:
            check_world(arguments.world, regret)
            regret = regret[regret["world"] == arguments.world]
        table = table_of(regret)
        shown = at(table, arguments.plans)
        if shown.empty:
            raise InputError("the runs hold no regret at so few plans")
        if arguments.out:
            arguments.out.parent.mkdir(parents=True, exist_ok=True)
            table.to_csv(arguments.out, index=False, float_format="%.4f")
    lines = Table("group", "plans", "world", "task", "median", "quartiles", "mean", "standing", "runs", box=None)
    for row in shown.to_dict("records"):
        quartiles = f"{row['q25']:.3f} to {row['q75']:.3f}"
        mean = f"{row['mean']:.3f} ({row['mean_low']:.3f} to {row['mean_high']:.3f})"
        numbers = (f"{row['median']:.3f}", quartiles, mean, f"{row['standing']} of {row['chosen']}")
        lines.add_row(row["group"], str(row["plans"]), row["world"], row["task"], *numbers, str(row["runs"]))
    console(width=WIDTH).print(lines)


if __name__ == "__main__":
    main()
