"""What the two scripts that draw learning curves share: arguments, grouping, saving."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from apf.errors import InputError
from apf.figures import save
from apf.runs import find_runs, gather

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(
    name: str, doc: str, curves_of: Callable[[pd.DataFrame], pd.DataFrame], plot: Callable[[pd.DataFrame], "Figure"]
) -> None:
    """Draw the table `name` of all finished runs below the directories on the command line."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directories", nargs="+", type=Path, metavar="DIR", help="a run, or a folder that holds runs")
    parser.add_argument(
        "--out", type=Path, help=f"where to write: STEM.pdf, STEM.png, STEM.csv (default: {name} in the first DIR)"
    )
    arguments = parser.parse_args()
    try:
        runs, unfinished = find_runs(arguments.directories)
        for directory in unfinished:
            print(f"left out, not finished: {directory}", file=sys.stderr)
        curves = curves_of(gather(runs, name))
        if curves.empty:
            raise InputError(f"the runs hold no {name}: their config asked for none, or no candidate tower could stand")
        paths = save(plot(curves), curves, arguments.out or arguments.directories[0] / name)
    except InputError as error:
        sys.exit(f"error: {error}")
    except OSError as error:
        sys.exit(f"error: {error.filename}: {error.strerror}")
    groups = curves.groupby("group", sort=False)["runs"].max()
    print("; ".join(f"{group}: {runs} run{'s' * (runs > 1)}" for group, runs in groups.items()))
    print(*paths, sep="\n")
