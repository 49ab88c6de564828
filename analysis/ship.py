"""Make the last ensemble of a finished run part of the package, for those who have no run of their own.

    python -m analysis.ship runs/beyond/sequential-tgn-noisy-seed10-... --out apf/shipped/towers

What `apf.plan` and `apf.predict` need is copied, and `quality.csv` says how good the ensemble was on novel objects.
"""

import shutil
from pathlib import Path

import pandas as pd

from analysis.commands import finished_runs, one_line_errors, parser_of
from apf.errors import InputError
from apf.planning.measures import MEASURES
from apf.report.runs import Run
from apf.rundir.claim import CONFIG
from apf.trained import chosen_step, config_of


def ship(run: Run, out: Path) -> list[Path]:
    """Copy config, objects and last weights of a run, and write how good they are. Returns the files."""
    step = chosen_step(run.directory, None)
    weights = f"weights/step_{step:04d}.safetensors"
    names = [CONFIG, *config_of(run.directory).domain.object_files, weights]
    if out.exists():
        shutil.rmtree(out)
    (out / "weights").mkdir(parents=True)
    for name in names:
        shutil.copyfile(run.directory / name, out / name)
    quality(run, step).to_csv(out / "quality.csv", index=False, float_format="%.4f")
    return [out / name for name in (*names, "quality.csv")]


def quality(run: Run, step: int) -> pd.DataFrame:
    """How good the ensemble of a step was: plans, quantity, of (which plans), value.

    Mean regret, share of chosen plans that succeeded and mean predicted chance for each world and task; the measures of
    `apf.planning.measures` for each length.
    """
    rows = []
    regret = run.table("regret")
    for (world, task), part in regret[regret["step"] == step].groupby(["world", "task"], sort=False):
        for quantity, column in (("mean regret", "regret"), ("standing", "feasible"), ("chance", "chance")):
            rows.append((part["plans"].iloc[0], quantity, f"{task}, {world}", float(part[column].mean())))
    for row in run.table("accuracy").query("step == @step").to_dict("records"):
        rows += [(row["plans"], name, f"{row['length']} placements", float(row[name])) for name in MEASURES]
    return pd.DataFrame(rows, columns=["plans", "quantity", "of", "value"])


def main() -> None:
    """Ship the run on the command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of the package, which is made anew")
    arguments = parser.parse_args()
    with one_line_errors():
        runs = finished_runs(arguments.directories)
        if len(runs) != 1:
            raise InputError(f"{len(runs)} runs are there; name one")
        print(*ship(runs[0], arguments.out), sep="\n")


if __name__ == "__main__":
    main()
