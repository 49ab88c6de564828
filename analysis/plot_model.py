"""What a run's ensemble believes, whether its chances hold, and what was tried to learn them: one figure.

python -m analysis.plot_model runs/first --step 12 --out model.pdf

Above (of towers only): maps over the offset of the top block of a tower of two and of three evaluation blocks. They
show where the tower stands, the predicted chance of it, and BALD of the last placement; a line surrounds where it
stands. Below: a reliability diagram of the test plans of each length, with the number of plans in each bin; the scores
of the acquired plans; and the share of plans of each length that succeeded and failed, over the number of labelled
plans. Chances are those that the run's evaluations use, with `predictor.odds`; BALD is the acquisition's, without.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from analysis.beliefs import belief, draw_beliefs
from analysis.commands import draw_each, parser_of
from apf.errors import InputError
from apf.planning import Evaluator
from apf.planning.learned import Learned
from apf.planning.measures import BINS, ece, reliability
from apf.report.figures import plural
from apf.report.panels import STYLE
from apf.report.runs import Run
from apf.rng import stream
from apf.schema import Config
from apf.towers import TowerDomain
from apf.trained import chosen_step, config_of, load_ensemble

WIDTH, MAPS, PANELS = 7.2, 4.3, 2.9
"""Width of the figure, height of the maps and of the panels below [inch]."""
LENGTHS = (2, 3)
"""Blocks of the towers whose top is moved."""
BARS = 25
"""Bars of what was tried, at most."""
LEGEND: Any = {"frameon": False, "fontsize": 6.5, "title_fontsize": 6.5, "handlelength": 1, "borderpad": 0.1}
SUCCEEDED, FAILED = "#0173b2", "#d55e00"
Chances = Mapping[int, tuple[np.ndarray, np.ndarray]]
"""By the length of plans: what was predicted of test plans, and whether they succeed."""


def model_figure(run: Run, step: int | None) -> Figure:
    """The figure of one run.

    Args:
        run: A run that learns.
        step: An evaluated step, whose ensemble is asked; None: the last.

    Raises:
        InputError: The run does not learn, or keeps no ensemble of this step.
    """
    step = chosen_step(run.directory, step)
    config = config_of(run.directory)
    if not isinstance(config.predictor, Learned):
        raise InputError(f"{run.directory} is a run that does not learn")
    ensemble = load_ensemble(run.directory, step, config.predictor.odds)
    plans = tried(run.table("plans"), run.words.plan)
    blocks = config.domain.evaluation_blocks if isinstance(config.domain, TowerDomain) else None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, PANELS + (MAPS if blocks is not None else 0.0)), layout="constrained")
        below: Figure | SubFigure = figure
        if blocks is not None:
            parts = figure.add_gridspec(2, 1, height_ratios=(MAPS, PANELS))
            above, below = (figure.add_subfigure(parts[row]) for row in (0, 1))
            draw_beliefs(above, [belief(ensemble, blocks, length) for length in LENGTHS if length <= len(blocks)])
        _draw_below(below, chances_of(config, ensemble, step), plans, run, config.sampler.score.asks_model)
        labelled = int((plans["step"] <= step).sum())
        words = f"{labelled} labelled {plural(run.words.plan)} (step {step})"
        figure.suptitle(f"{run.directory.name}, {words}", fontsize=8, parse_math=False)
    return figure


def chances_of(config: Config, ensemble: Any, step: int) -> Chances:
    """What an ensemble predicts of the test plans of a run, as the run's own evaluation of that step did.

    Args:
        config: Of the run.
        ensemble: Of that step.
        step: An evaluated step.
    """
    settings = config.evaluation
    evaluator = Evaluator(settings, config.domain, config.planner, config.task)
    found = {}
    for length in settings.lengths if settings.test_plans else ():
        plans, labels = evaluator.test_set(length)
        found[length] = ensemble.feasibility(plans, stream(settings.seed, "accuracy", step, length)), labels
    return found


def tried(table: pd.DataFrame, word: str) -> pd.DataFrame:
    """One row for each labelled plan: step, length, score, succeeded.

    Args:
        table: Rows of `plans.parquet`.
        word: The domain's word for a plan, the column that numbers them.
    """
    by = table.groupby(word, sort=True)
    succeeded = by["label"].min().eq(1).fillna(False) & by["label"].count().eq(by.size())
    return pd.DataFrame(
        {
            "step": by["step"].first(),
            "length": by.size(),
            "score": by["score"].first(),
            "succeeded": succeeded.astype(bool),
        }
    ).reset_index(drop=True)


def _draw_below(figure: SubFigure | Figure, chances: Chances, plans: pd.DataFrame, run: Run, asks_model: bool) -> None:
    """Reliability with its counts, scores (if the model gave them), and what was tried."""
    grid = figure.add_gridspec(2, 3, height_ratios=(3.2, 1))
    colours = colours_of_lengths(sorted({*chances, *plans["length"]}))
    above = figure.add_subplot(grid[0, 0])
    counts = figure.add_subplot(grid[1, 0], sharex=above)
    draw_reliability(above, counts, chances, colours)
    draw_scores(figure.add_subplot(grid[:, 1]), plans if asks_model else plans.assign(score=np.nan), run)
    draw_tried(figure.add_subplot(grid[:, 2]), plans, colours, run)
    for ax in figure.axes:
        ax.spines[["top", "right"]].set_visible(False)


def colours_of_lengths(lengths: list[int]) -> dict[int, Any]:
    """A colour for each length, from dark to light."""
    return dict(zip(lengths, mpl.colormaps["viridis"](np.linspace(0.0, 0.88, len(lengths))), strict=True))


def draw_reliability(above: Axes, counts: Axes, chances: Chances, colours: Mapping[int, Any]) -> None:
    """Share of test plans that succeed, against the predicted chance, and below it the number of plans in each bin.

    Args:
        above: For the diagram.
        counts: For the numbers of plans.
        chances: By length.
        colours: By length.
    """
    above.plot([0, 1], [0, 1], color="0.6", linewidth=0.8, linestyle=":")
    middles, base = (np.arange(BINS) + 0.5) / BINS, np.zeros(BINS)
    for length, (probability, labels) in chances.items():
        found = reliability(probability, labels)
        some = found.n > 0
        said = f"{length}, ECE {ece(probability, labels):.2f}"
        above.plot(found.predicted[some], found.observed[some], color=colours[length], label=said, zorder=2)
        above.scatter(
            found.predicted[some], found.observed[some], s=40 * found.n[some] / found.n.max() + 3, color=colours[length]
        )
        counts.bar(middles, found.n, 0.9 / BINS, base, color=colours[length])
        base = base + found.n
    above.set(
        title="Reliability", ylabel="Share that succeeds", xlim=(-0.02, 1.02), ylim=(-0.02, 1.6), yticks=(0, 0.5, 1)
    )
    above.tick_params(labelbottom=False)
    counts.set(xlabel="Predicted chance", ylabel="Plans")
    if chances:
        above.legend(title="Length", loc="upper center", ncols=2, columnspacing=1, **LEGEND)


def draw_scores(ax: Axes, plans: pd.DataFrame, run: Run) -> None:
    """The score of each acquired plan, by outcome, and the median of each step.

    Args:
        ax: For the panel.
        plans: As `tried` gives them; those that no model gave a score have NaN.
        run: For its words.
    """
    at = np.arange(1, len(plans) + 1)
    ax.set(title="Acquisition scores", xlabel=f"Labelled {plural(run.words.plan)}", ylabel="Score when chosen")
    ax.set_xlim(0, len(plans))
    if plans["score"].isna().all():
        ax.text(0.5, 0.5, "chosen without a score", transform=ax.transAxes, ha="center", fontsize=7, color="0.35")
        ax.set_yticks([])
        return
    for succeeded, colour, name in ((True, SUCCEEDED, "succeeded"), (False, FAILED, "failed")):
        rows = (plans["succeeded"] == succeeded).to_numpy()
        ax.scatter(at[rows], plans["score"][rows], s=5, color=colour, alpha=0.5, linewidth=0, label=name)
    acquired = plans.assign(at=at).dropna(subset=["score"]).groupby("step")
    ax.plot(acquired["at"].median(), acquired["score"].median(), color="black", linewidth=1.2, label="median of a step")
    ax.set_ylim(bottom=0)
    ax.legend(**LEGEND)


def draw_tried(ax: Axes, plans: pd.DataFrame, colours: Mapping[int, Any], run: Run) -> None:
    """Shares of plans of each length over time: those that succeeded upwards, those that failed downwards.

    Args:
        ax: For the panel.
        plans: As `tried` gives them.
        colours: By length.
        run: For its words.
    """
    steps = int(plans["step"].max()) + 1
    joined = 1 if steps <= BARS else -(-(steps - 1) // (BARS - 1))  # steps in a bar; the initial plans have their own
    bar = -(-plans["step"] // joined)
    sizes = bar.value_counts().sort_index()
    left = sizes.cumsum() - sizes
    for sign, succeeded in ((1, True), (-1, False)):
        base = np.zeros(len(sizes))
        for length, colour in colours.items():
            some = (plans["length"] == length) & (plans["succeeded"] == succeeded)
            share = sign * bar[some].value_counts().reindex(sizes.index, fill_value=0) / sizes
            name = f"{length}" if succeeded and (plans["length"] == length).any() else None
            ax.bar(left, share, sizes * 0.94, base, align="edge", color=colour, linewidth=0, label=name)
            base = base + share.to_numpy()
    ax.axhline(0, color="black", linewidth=0.7)
    ax.set_yticks([-1, -0.5, 0, 0.5, 1], ["1", "0.5", "0", "0.5", "1"])
    ax.set(title="What was tried", xlabel=f"Labelled {plural(run.words.plan)}", ylabel="Share: failed | succeeded")
    ax.set(xlim=(0, len(plans)), ylim=(-1.02, 1.5))
    ax.legend(title="Length", loc="upper center", ncols=4, columnspacing=1, **LEGEND)


def main() -> None:
    """Draw the figures of the runs on the command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--step", type=int, help="an evaluated step, whose ensemble is asked; the last by default")
    parser.add_argument("--out", type=Path, help="file of the figure; by default figures/model.png in the run")
    arguments = parser.parse_args()
    draw_each(arguments, "model.png", lambda run: model_figure(run, arguments.step), dpi=200)


if __name__ == "__main__":
    main()
