"""A run that learns, as a moving picture: what its ensemble believes after each evaluated step, and its regret so far.

python -m analysis.film_model runs/first --out learning.gif

Each picture shows, over the offset of the top block of a tower of three evaluation blocks, the predicted chance that
the tower stands, and BALD of the last placement; a line surrounds where it stands (towers only). Beside it: mean
regret of the chosen plans, up to this step. `evaluation.every=20` gives a run twenty pictures.
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from analysis.beliefs import BALD, LIKELY, Belief, belief, draw_map
from analysis.commands import finished_runs, one_line_errors
from apf.errors import InputError
from apf.planning.learned import Learned
from apf.report.figures import plural
from apf.report.names import world_of
from apf.report.panels import STYLE
from apf.report.runs import Run
from apf.towers import TowerDomain
from apf.trained import config_of, kept_steps, load_ensemble

SIZE, DPI = (7.0, 2.5), 100
"""Of a picture [inch], and its pixels in an inch."""
LENGTH = 3
"""Blocks of the towers whose top is moved."""
COLOURS = 128
"""Of a picture, at most."""
SECONDS, LAST = 0.6, 3.0
"""For which each picture is shown, and the last one."""


def beliefs_of(run: Run) -> dict[int, Belief]:
    """What the run's ensemble believes after each evaluated step.

    Raises InputError if the run does not learn, is not one of towers, or has too few blocks.
    """
    config = config_of(run.directory)
    if not isinstance(config.predictor, Learned):
        raise InputError(f"{run.directory} is a run that does not learn")
    if not isinstance(config.domain, TowerDomain):
        raise InputError(f"{run.directory} is a run of {type(config.domain).__name__}; the maps are of towers")
    blocks, odds = config.domain.evaluation_blocks, config.predictor.odds
    if len(blocks) < LENGTH:
        raise InputError(f"{run.directory} has {len(blocks)} evaluation blocks; the maps are of towers of {LENGTH}")
    return {
        step: belief(load_ensemble(run.directory, step, odds), blocks, LENGTH) for step in kept_steps(run.directory)
    }


def regret_of(run: Run) -> tuple[pd.DataFrame, str]:
    """Mean regret of each evaluated step, by step: columns plans, regret; and where it is: the last of the worlds."""
    table = run.table("regret")
    world = str(table["world"].iloc[-1])
    here = table[table["world"] == world]
    return here.groupby("step").agg(plans=("plans", "first"), regret=("regret", "mean")), world


def picture(step: int, each: Belief, most: float, regret: pd.DataFrame, world: str, word: str) -> np.ndarray:
    """[height, width, 3] uint8: chance, BALD and regret after one step.

    Args:
        step: Of the run.
        each: What the ensemble believes.
        most: The largest BALD of all pictures [nats].
        regret: Of all steps, as `regret_of` gives it.
        world: Where plans were executed.
        word: For plans.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=SIZE, dpi=DPI, layout="constrained")
        left, middle, right = figure.subplots(1, 3, width_ratios=(1, 1, 1.1))
        for ax, title, values, colours, top in (
            (left, "Predicted chance to stand", each.chance, LIKELY, 1.0),
            (middle, "What one may learn (BALD)", each.bald, BALD, most),
        ):
            draw_map(ax, each, values, colours, top)
            ax.set(title=title, xlabel="Top block, offset in x [cm]")
        left.set_ylabel("Offset in y [cm]")
        so_far = regret.loc[:step]
        right.plot(so_far["plans"], so_far["regret"], color="#0173b2")
        right.plot(so_far["plans"].iloc[-1:], so_far["regret"].iloc[-1:], "o", color="#0173b2", markersize=5)
        right.axhline(0, color="0.6", linewidth=0.8, linestyle=":")
        low = min(0.0, regret["regret"].min())
        right.set(xlim=(0, regret["plans"].max() * 1.04), ylim=(low - 0.05, regret["regret"].max() + 0.05))
        right.set(title=f"Mean regret, {world_of(world)}", xlabel=f"Labelled {plural(word)}")
        right.spines[["top", "right"]].set_visible(False)
        figure.suptitle(f"{int(regret['plans'][step])} labelled {plural(word)}", fontsize=10, fontweight="bold")
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def film(run: Run, out: Path) -> None:
    """Write the moving picture of one run. Raises InputError if there is nothing to show."""
    beliefs, (regret, world) = beliefs_of(run), regret_of(run)
    steps = [step for step in beliefs if step in regret.index]
    if not steps:
        raise InputError(f"{run.directory} holds no regret of a step whose ensemble it keeps")
    most = max(float(beliefs[step].bald.max()) for step in steps)
    pictures = [
        Image.fromarray(picture(step, beliefs[step], most, regret, world, run.words.plan)).quantize(COLOURS)
        for step in steps
    ]
    milliseconds = [round(1000 * seconds) for seconds in [*[SECONDS] * (len(steps) - 1), LAST]]
    out.parent.mkdir(parents=True, exist_ok=True)
    pictures[0].save(out, save_all=True, append_images=pictures[1:], duration=milliseconds, loop=0)


def main() -> None:
    """Draw the run on the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path, metavar="DIR", help="a run")
    parser.add_argument("--out", type=Path, help="file, .gif; by default figures/learning.gif in the run")
    arguments = parser.parse_args()
    with one_line_errors():
        runs = finished_runs([arguments.directory])
        if len(runs) > 1:
            raise InputError(f"{arguments.directory} holds {len(runs)} runs; give one of them")
        out = arguments.out or runs[0].directory / "figures" / "learning.gif"
        if out.suffix != ".gif":
            raise InputError(f"--out {out}: it must end in .gif")
        film(runs[0], out)
    print(out)


if __name__ == "__main__":
    main()
