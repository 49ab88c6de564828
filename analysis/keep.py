"""Keep what the analyses read of finished runs, small enough to publish: no weights, no journal, no paths.

    python -m analysis.keep runs/strategies runs/baselines --out results/runs

A run of a sweep is copied to OUT/SWEEP/NAME, another one to OUT/NAME; the analyses take OUT for the runs themselves.
"""

import shutil
from pathlib import Path

from analysis.commands import finished_runs, one_line_errors, parser_of
from apf.report.runs import Run
from apf.rundir.files import write_yaml
from apf.rundir.kept import Summary, read_state

TABLES = ("regret.parquet", "accuracy.parquet")
OF_A_WORLD = "world.parquet"
"""Table of a world's reports."""
STATE = ("name", "hash", "sweep", "choices", "words", "titles", "versions", "finished", "seconds")
"""Keys of run.yaml that are kept."""


def keep(run: Run, out: Path) -> Path:
    """Copy one run; returns where to."""
    state = read_state(run.directory, Summary)
    copy = out / (state["sweep"] or "") / state["name"]
    copy.mkdir(parents=True, exist_ok=True)
    reported = [OF_A_WORLD] if (run.directory / OF_A_WORLD).exists() else []
    for name in ("config.yaml", *TABLES, *reported):
        shutil.copyfile(run.directory / name, copy / name)
    write_yaml(copy / "run.yaml", {key: state[key] for key in STATE})
    return copy


def main() -> None:
    """Keep the runs on the command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/runs"), help="folder (default: %(default)s)")
    arguments = parser.parse_args()
    with one_line_errors():
        for run in finished_runs(arguments.directories):
            print(keep(run, arguments.out))


if __name__ == "__main__":
    main()
