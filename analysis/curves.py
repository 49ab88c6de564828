"""What the two scripts that draw learning curves share: arguments, grouping, saving."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import pandas as pd

from analysis.commands import finished_runs, one_line_errors, parser_of
from apf.errors import InputError
from apf.report.figures import Words, save, split
from apf.report.runs import gather

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Drawing(NamedTuple):
    """How a quantity is drawn: `curves_of` makes curves of the gathered table, `plot` draws them."""

    curves_of: Callable[[pd.DataFrame], pd.DataFrame]
    plot: Callable[[pd.DataFrame, Words], "Figure"]


def draw(name: str, doc: str, metrics: Mapping[str, Drawing]) -> None:
    """Draw the table `name` of all finished runs below the directories on the command line.

    Args:
        name: Of the table: regret or accuracy.
        doc: What --help prints.
        metrics: What can be drawn of it, the default first. With several, `--metric` chooses.

    Raises:
        SystemExit: The runs hold no such table, there is no evaluation up to `--until`, or a file cannot be written.
    """
    parser = parser_of(doc)
    if len(metrics) > 1:
        parser.add_argument("--metric", choices=metrics, default=next(iter(metrics)), help="(default: %(default)s)")
    stem = "METRIC" if len(metrics) > 1 else name
    parser.add_argument(
        "--out", type=Path, help=f"where to write: STEM.pdf, STEM.png, STEM.csv (default: {stem} in the first DIR)"
    )
    parser.add_argument("--until", type=int, metavar="PLANS", help="leave out what came after so many labelled plans")
    arguments = parser.parse_args()
    metric = getattr(arguments, "metric", name)
    with one_line_errors():
        runs = finished_runs(arguments.directories)
        curves = metrics[metric].curves_of(gather(runs, name))
        if curves.empty:
            raise InputError(f"the runs hold no {metric}: their config asked for none, or no candidate could succeed")
        if arguments.until is not None:
            first, curves = split(curves)[0]["plans"].min(), curves[curves["plans"] <= arguments.until]
            if arguments.until < first:
                raise InputError(f"--until {arguments.until}: the first evaluation came at {first} plans")
        paths = save(
            metrics[metric].plot(curves, Words.common([run.words for run in runs])),
            curves,
            arguments.out or arguments.directories[0] / metric,
        )
    counts = curves.groupby("group", sort=False)["runs"].max()
    print("; ".join(f"{group}: {n} run{'s' * (n > 1)}" for group, n in counts.items()))
    print(*paths, sep="\n")
