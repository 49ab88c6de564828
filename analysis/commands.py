"""What the scripts share: run directories as arguments, and one line instead of a traceback for a user's mistake."""

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import pandas as pd

from apf.errors import InputError
from apf.report.runs import Run, find_runs

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def parser_of(doc: str | None, names: Literal["none", "optional", "needed"] = "none") -> argparse.ArgumentParser:
    """A parser of a command line that begins with directories.

    Args:
        doc: What --help prints.
        names: May, or must, a directory have a name, NAME=DIR? Then `directories` are texts, for `by_name`.
    """
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    metavar = {"none": "DIR", "optional": "[NAME=]DIR", "needed": "NAME=DIR"}[names]
    said = "a run, or a folder that holds runs" + ("" if names == "none" else "; those of one NAME make one group")
    parser.add_argument("directories", nargs="+", type=Path if names == "none" else str, metavar=metavar, help=said)
    return parser


def named(text: str, optional: bool = False) -> tuple[str, Path]:
    """The name and the path of NAME=PATH. Raises InputError if it is no such text.

    Args:
        text: Of the command line.
        optional: A path alone has the empty name?
    """
    name, _, path = text.partition("=")
    if optional and ("=" not in text or Path(text).exists()):
        return "", Path(text)
    if not name or not path:
        raise InputError(f"{text}: write NAME=DIR, e.g. 'Search=runs/beyond'")
    return name, Path(path)


def by_name(texts: Sequence[str], optional: bool = True) -> dict[str, list[Path]]:
    """Directories by their name, in the order of the command line. Raises InputError as `named` does.

    Args:
        texts: NAME=DIR of the command line.
        optional: A DIR alone has the empty name?
    """
    found: dict[str, list[Path]] = {}
    for name, path in (named(text, optional) for text in texts):
        found.setdefault(name, []).append(path)
    return found


def finished_runs(directories: Sequence[Path]) -> list[Run]:
    """All finished runs there; says which others were left out. Raises InputError if there are none."""
    runs, unfinished = find_runs(directories)
    for directory in unfinished:
        print(f"left out, not finished: {directory}", file=sys.stderr)
    return runs


def check_world(world: str, regret: pd.DataFrame) -> None:
    """Raises InputError if the rows of `regret.parquet` are of no world of that name."""
    known = sorted(set(regret["world"]))
    if world not in known:
        raise InputError(f"--world {world}: the runs have {', '.join(known)}")


@contextlib.contextmanager
def one_line_errors() -> Iterator[None]:
    """A mistake in the input, or a file that cannot be written, ends the process with one line and exit code 1."""
    try:
        yield
    except InputError as error:
        sys.exit(f"error: {error}")
    except OSError as error:
        sys.exit(f"error: {error.filename}: {error.strerror}")


def draw_each(arguments: argparse.Namespace, name: str, figure_of: Callable[[Run], "Figure"], dpi: int) -> None:
    """Write a figure of each run on the command line, and print where.

    Args:
        arguments: Its `directories`, and `out`, the file of a single figure.
        name: Of a figure without `out`, in the run's folder of figures.
        figure_of: Draws a run.
        dpi: Of the picture.
    """
    with one_line_errors():
        runs = finished_runs(arguments.directories)
        if arguments.out and len(runs) > 1:
            raise InputError(f"--out names one file, and there are {len(runs)} runs")
        for run in runs:
            path = arguments.out or run.directory / "figures" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            figure_of(run).savefig(path, dpi=dpi)
            print(path)
