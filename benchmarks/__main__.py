"""python -m benchmarks [--quick] [--csv FILE] [--only NAME ...]: how fast each operation is, and against what.

Prints one table: for each operation its time, its rate, how many times faster it is than the plain reference, its share
of the machine's limit, and whether its target holds. All on one thread, in one process, both sides in turn.
With `--device cuda` the operations run on a GPU, and the reference is the same code on a core of the CPU.
"""

import argparse
import csv
import sys
from collections.abc import Sequence
from pathlib import Path

import torch
from rich.console import Console
from rich.table import Table

from benchmarks import gpu
from benchmarks.operations import ONLY_FULL, OPERATIONS
from benchmarks.setting import FULL, QUICK, Setting
from benchmarks.timing import Row, measure

COLUMNS = ["operation", "seconds", "rate", "reference_ratio", "limit_share", "target", "holds"]


TABLES = {"cpu": OPERATIONS, "cuda": gpu.OPERATIONS}
"""What is timed, by where networks run."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="How fast each operation is.")
    parser.add_argument("--quick", action="store_true", help="smaller sizes, about a minute")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the table there too")
    parser.add_argument("--device", default="cpu", choices=list(TABLES), help="where networks run (default: cpu)")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="some of the operations, by their short names")
    options = parser.parse_args(arguments)
    operations = TABLES[options.device]
    if unknown := [name for name in options.only or () if name not in operations]:
        parser.error(f"--only {unknown[0]}: there is no such operation; choose from {', '.join(operations)}")
    if options.device == "cuda" and not torch.cuda.is_available():
        parser.error("--device cuda: PyTorch finds no GPU here")
    names = options.only or [name for name in operations if not (options.quick and name in ONLY_FULL)]
    torch.set_num_threads(1)
    setting = Setting(QUICK if options.quick else FULL, options.device)
    progress, rows = Console(stderr=True), list[Row]()
    with progress.status("") as status:
        for name in names:
            status.update(f"{name}: comparing the results with the reference's")
            case = operations[name](setting)
            rows.append(measure(case, setting.sizes.enough, status.update))
            if not progress.is_terminal:
                progress.print(f"{name}: {rows[-1].seconds:.3g} s", highlight=False)
            if options.csv:
                write_csv(rows, options.csv)
    console = Console() if sys.stdout.isatty() else Console(width=160)
    console.print(table(rows))
    for number, row in enumerate(rows, 1):
        console.print(f"{number:2}  {row.note}", highlight=False)


def table(rows: Sequence[Row]) -> Table:
    """For the terminal."""
    result = Table("", "operation", "seconds", "rate", "x reference", "of the limit", "target", "holds")
    for number, row in enumerate(rows, 1):
        result.add_row(
            str(number),
            row.operation,
            f"{row.seconds:.3g}",
            f"{row.rate:,.3g} {row.unit}/s" if row.rate < 1000 else f"{row.rate:,.0f} {row.unit}/s",
            "" if row.reference_ratio is None else f"{row.reference_ratio:.3g}",
            "" if row.limit_share is None else f"{row.limit_share:.1%}",
            row.target,
            "[green]yes[/]" if row.holds else "[red]no[/]",
        )
    return result


def write_csv(rows: Sequence[Row], path: Path) -> None:
    """One line per operation; what does not apply is empty."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for row in rows:
            values = [getattr(row, column) for column in COLUMNS]
            writer.writerow([f"{v:.6g}" if isinstance(v, float) else v for v in values])


if __name__ == "__main__":
    main()
