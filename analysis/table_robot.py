"""What a robot did in runs: towers, pick-and-places, plans, time, placement errors and interventions, as a table.

python -m analysis.table_robot runs/panda_experiment --out results/robot/statistics.csv
"""

from pathlib import Path

import pandas as pd
from rich.table import Table

from analysis.commands import finished_runs, one_line_errors, parser_of
from apf.errors import InputError
from apf.report.runs import Run
from apf.terminal import console

HELP = "intervention"
"""The purpose of a row that is no pick-and-place."""


def statistics(entries: pd.DataFrame) -> dict[str, float]:
    """Counts, times [s, h] and placement errors [mm] of the rows of a `world.parquet`."""
    tried = entries[entries["purpose"] != HELP]
    done = tried[tried["outcome"] == "done"]
    building = tried["purpose"] == "build"
    return {
        "towers": entries["tower"].nunique(),
        "pick-and-places": len(tried),
        "to build": int(building.sum()),
        "to clear up": int((~building).sum()),
        "failed": len(tried) - len(done),
        "interventions": len(entries) - len(tried),
        "plans": int(entries["plans"].sum()),
        "replans": int(entries["replans"].sum()),
        "regrasps": int(entries["regrasps"].sum()),
        "simulated time [h]": entries["simulated"].sum() / 3600,
        "simulated time of one, median [s]": done["simulated"].median(),
        "wall time of one, median [s]": done["wall"].median(),
        "planning in it, median [s]": done["planning"].median(),
        "placement error, median [mm]": 1000 * done["error"].median(),
        "placement error, 90th percentile [mm]": 1000 * float(done["error"].quantile(0.9)),
    }


def table_of(run: Run) -> pd.DataFrame:
    """One row for each statistic. Raises InputError if the run has no report of a robot."""
    if not (run.directory / "world.parquet").exists():
        raise InputError(f"{run.directory}: has no world.parquet: its world reports nothing")
    rows = statistics(run.table("world")).items()
    return pd.DataFrame(rows, columns=["statistic", "value"]).assign(run=run.directory.name)


def main() -> None:
    """Write and show the table for the runs on the command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=Path, help="CSV to write")
    arguments = parser.parse_args()
    with one_line_errors():
        table = pd.concat([table_of(run) for run in finished_runs(arguments.directories)])
        if arguments.out:
            arguments.out.parent.mkdir(parents=True, exist_ok=True)
            table.to_csv(arguments.out, index=False, float_format="%.6g")
    lines = Table("run", "statistic", "value", box=None)
    for row in table.to_dict("records"):
        lines.add_row(row["run"], row["statistic"], f"{row['value']:.4g}")
    console(width=120).print(lines)


if __name__ == "__main__":
    main()
