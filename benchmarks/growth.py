"""python -m benchmarks.growth [--quick] --out DIR: how time and memory grow with the size of a problem.

Four sizes vary, one at a time: labelled towers, blocks in a tower, ensemble members, candidates. Each measurement is a
process of its own, on one thread, so that its peak of memory is its own. DIR gets growth.csv, growth.pdf, growth.png.
"""

import argparse
import csv
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from apf.models import Ensemble
    from benchmarks.setting import Setting

# This module is imported by the parent of all measurements, which must stay small: on Linux a child's peak of memory
# counts from that of its parent. What needs torch is therefore imported where it is used.

SIZES: dict[str, list[int]] = {
    "towers": [100, 200, 400, 800, 1400, 2000],
    "length": [2, 3, 4, 5, 6, 7, 8, 9, 10],
    "members": [1, 3, 10, 20, 30],
    "candidates": [1_000, 10_000, 100_000, 300_000, 1_000_000],
}
"""What varies, and its values. The others are 400 labelled towers, 5 blocks, 10 members, 10,000 candidates."""

QUICK_SIZES: dict[str, list[int]] = {
    "towers": [20, 40],
    "length": [3],
    "members": [1],
    "candidates": [1_000],
}

USUAL = {"towers": 400, "length": 5, "members": 10, "candidates": 10_000}
QUICK_USUAL = {"towers": 40, "length": 5, "members": 3, "candidates": 1_000}

OPERATIONS = {
    "towers": ["epoch"],
    "length": ["epoch", "bald"],
    "members": ["epoch", "bald"],
    "candidates": ["bald", "plan"],
}
"""What is timed as each size varies."""

COLUMNS = ["varied", "operation", "towers", "length", "members", "candidates", "seconds", "peak_mib", "start_mib"]
"""peak_mib: of the whole process. start_mib: before the operation: Python, torch, the problem's towers."""

TITLES = {
    "towers": "Labelled towers",
    "length": "Blocks in a tower",
    "members": "Ensemble members",
    "candidates": "Candidates",
}
LABELS = {"epoch": "one epoch of training", "bald": "expected BALD", "plan": "one plan"}
REPETITIONS = 3
LEAST, ENOUGH = 3.0, 20.0
"""Seconds: what takes less is repeated more often, what takes more less often."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.growth", description="How time and memory grow.")
    parser.add_argument("--quick", action="store_true", help="a few small sizes, to see that it works")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where growth.csv, growth.pdf and growth.png go")
    parser.add_argument("--measure", metavar="JSON", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.measure:
        print(json.dumps(measure(**json.loads(options.measure))))
        return
    if options.out is None:
        parser.error("the following arguments are required: --out")
    options.out.mkdir(parents=True, exist_ok=True)
    rows = []
    with (options.out / "growth.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        for row in measurements(options.quick):
            writer.writerow(row)
            file.flush()
            rows.append(row)
    draw(rows, options.out / "growth")


def measurements(quick: bool) -> Iterator[dict[str, Any]]:
    """One row for each size and operation, in `COLUMNS`."""
    sizes, usual = (QUICK_SIZES, QUICK_USUAL) if quick else (SIZES, USUAL)
    with tempfile.TemporaryDirectory() as directory:
        weights = str(Path(directory) / "trained.safetensors")
        print("training an ensemble to plan with", file=sys.stderr)
        in_process("train", usual, weights)
        for varied, values in sizes.items():
            for value in values:
                for operation in OPERATIONS[varied]:
                    size = usual | {varied: value}
                    result = in_process(operation, size, weights)
                    print(f"{LABELS[operation]}, {size}: {result}", file=sys.stderr)
                    yield {"varied": varied, "operation": operation, **size, **result}


def in_process(operation: str, size: dict[str, int], weights: str) -> dict[str, float]:
    """Measure in a fresh process."""
    what = json.dumps({"operation": operation, "size": size, "weights": weights})
    environment = os.environ | {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "benchmarks.growth", "--measure", what]
    root = Path(__file__).parents[1]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=environment, cwd=root)
    return json.loads(done.stdout)


def measure(operation: str, size: dict[str, int], weights: str) -> dict[str, float]:
    """Seconds (median) of an operation, and the peak of this process's memory [MiB] before and after."""
    import torch

    torch.set_num_threads(1)
    work = {"train": prepare_training, "epoch": prepare_epoch, "bald": prepare_bald, "plan": prepare_plan}[operation]
    run = work(size, weights)
    start = peak_mib()
    seconds: list[float] = []
    while not seconds or (
        operation != "train" and (len(seconds) < REPETITIONS or sum(seconds) < LEAST) and sum(seconds) < ENOUGH
    ):
        began = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - began)
    return {"seconds": round(median(seconds), 5), "peak_mib": round(peak_mib(), 1), "start_mib": round(start, 1)}


def peak_mib() -> float:
    """The most memory that this process has held so far [MiB]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2**20 if sys.platform == "darwin" else peak / 2**10


def prepare_training(size: dict[str, int], weights: str) -> Callable[[], object]:
    """Train the ensemble that `prepare_plan` loads."""
    from dataclasses import replace

    from apf.rng import stream
    from benchmarks.setting import FULL, SEED, Setting

    setting = Setting(replace(FULL, labelled=size["towers"]))
    ensemble = setting.ensemble(f"model.members={size['members']}")

    def run() -> None:
        ensemble.fit(*setting.split, stream(SEED, "train"))
        ensemble.save(Path(weights))

    return run


def prepare_epoch(size: dict[str, int], weights: str) -> Callable[[], object]:
    """One epoch on towers of one length that were labelled at every prefix, each seen from four sides."""
    import numpy as np

    from apf.domain import Labelled
    from apf.models.examples import examples
    from apf.models.training import fit
    from benchmarks.learning import epoch_of, new_generators

    setting, ensemble = _ensemble(size)
    plans = setting.random_towers("growth", size["towers"], size["length"])
    labels = np.ones((size["towers"], size["length"]), np.int8)
    train = examples([Labelled(plans, labels)], ensemble.kind, ensemble.domain)
    one_epoch, generators = epoch_of(ensemble.training, train), new_generators(ensemble)
    return lambda: fit(ensemble.passes, train, [], one_epoch, *generators, size["towers"])


def prepare_bald(size: dict[str, int], weights: str) -> Callable[[], object]:
    """Score random candidates by expected BALD."""
    from apf.acquisition import ExpectedBald
    from apf.rng import stream

    setting, ensemble = _ensemble(size)
    candidates = setting.random_towers("growth", size["candidates"], size["length"])
    return lambda: ExpectedBald()(ensemble, candidates[:], stream(0, "unused"))


def prepare_plan(size: dict[str, int], weights: str) -> Callable[[], object]:
    """Plan the tallest tower with a trained ensemble."""
    from apf.rng import stream

    setting, ensemble = _ensemble(size)
    ensemble.load(Path(weights))
    planner, task = setting.default.planner, setting.default.task["tallest"]
    candidates = setting.default.domain.problem(size["length"], size["candidates"], stream(0, "growth"))
    return lambda: planner.plan(task, planner.pool(candidates[:], ensemble, stream(0, "unused")))


def _ensemble(size: dict[str, int]) -> tuple["Setting", "Ensemble"]:
    """The setting, and an untrained ensemble of this size."""
    from benchmarks.setting import FULL, Setting

    setting = Setting(FULL)
    return setting, setting.ensemble(f"model.members={size['members']}")


def draw(rows: list[dict], stem: Path) -> None:
    """Two rows of panels, time and peak memory, one column for each size that varies."""
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt
    import pandas as pd
    import seaborn as sns

    from apf.report.figures import PANEL, save

    table = pd.DataFrame(rows, columns=COLUMNS)
    colours = dict(zip(LABELS, sns.color_palette("colorblind", len(LABELS))))
    style: Any = {"font.size": 8, "axes.titlesize": 9, "axes.labelsize": 8, "legend.fontsize": 8, "pdf.fonttype": 42}
    with sns.axes_style("ticks", {"axes.grid": True, "grid.color": "0.92"}), mpl.rc_context(style):
        width, height = PANEL
        figure, grid = plt.subplots(
            2,
            len(TITLES),
            figsize=(width * len(TITLES), height * 2 + 0.3),
            sharex="col",
            sharey="row",
            layout="constrained",
        )
        handles = {}
        for column, (varied, title) in enumerate(TITLES.items()):
            for row, quantity in enumerate(("seconds", "peak_mib")):
                axes = grid[row][column]
                for operation in OPERATIONS[varied]:
                    line = table[(table["varied"] == varied) & (table["operation"] == operation)]
                    (handles[operation],) = axes.plot(
                        line[varied], line[quantity], color=colours[operation], marker="o", markersize=2.5
                    )
                if varied != "length":
                    axes.set_xscale("log")
            grid[1][column].set_xlabel(title)
        grid[0][0].set_yscale("log")
        grid[1][0].set_ylim(0, max(1100, 1.05 * table["peak_mib"].max()))
        for axes in grid[1]:
            axes.axhline(1024, color="0.6", linewidth=0.8, linestyle=":", zorder=0)
        grid[1][0].annotate("1 GiB", (0.02, 1040), xycoords=("axes fraction", "data"), color="0.4")
        grid[0][0].set_ylabel("Time [s]")
        grid[1][0].set_ylabel("Peak memory [MiB]")
        sns.despine(figure)
        known = [operation for operation in LABELS if operation in handles]
        figure.legend(
            [handles[operation] for operation in known],
            [LABELS[operation] for operation in known],
            loc="outside upper center",
            ncols=len(known),
            frameon=False,
        )
    save(figure, table, stem)


if __name__ == "__main__":
    main()
