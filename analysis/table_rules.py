"""Accuracy by other rules than P(plan) > 1/2: from the weights of runs, on the test sets of their evaluations.

    python analysis/table_rules.py runs/strategies --out results/rules.csv

A plan is called feasible by `product` if P(plan), the product over its prefixes, is over 1/2 (as the evaluation does);
by `each action` if the ensemble gives each action more than 1/2; by `votes` if most members do so; and by `last
action` if the ensemble does so for the last one. `ranking` calls that half of the balanced set feasible of which
P(plan) is highest: it tells a wrong threshold from a wrong order.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from commands import finished_runs, one_line_errors, parser_of
from omegaconf import OmegaConf
from rich.console import Console
from rich.table import Table

from apf.config import validate
from apf.errors import InputError
from apf.main import make_model
from apf.planning import Evaluator
from apf.runs import Run, label_runs

COLUMNS = ["group", "run", "towers", "length", "rule", "accuracy"]


def calls(probabilities: np.ndarray) -> dict[str, np.ndarray]:
    """[E, N, P] -> [N] which plans each rule calls feasible."""
    mean = probabilities.mean(0)
    product = mean.prod(1)
    return {
        "product": product > 0.5,
        "each action": (mean > 0.5).all(1),
        "votes": (probabilities > 0.5).all(2).mean(0) > 0.5,
        "last action": mean[:, -1] > 0.5,
        "ranking": product > np.median(product),
    }


def judged(run: Run) -> Iterator[tuple[int, int, str, float]]:
    """(towers, length, rule, accuracy) at every evaluated step. Raises InputError if the run has no weights."""
    cfg = OmegaConf.create(run.config)
    config = validate(cfg)
    model = make_model(cfg, config)
    evaluator = Evaluator(config.evaluation, config.domain, config.planner, config.task)
    for step, towers in run.table("accuracy")[["step", "towers"]].drop_duplicates().itertuples(index=False):
        path = run.directory / "weights" / f"step_{step:04d}.safetensors"
        if not path.exists():
            raise InputError(f"{path}: no such file; the rules need the weights of a run")
        model.load(path)
        for length in config.evaluation.lengths:
            plans, labels = evaluator.test_set(length)
            for rule, feasible in calls(model.predict(plans)).items():
                yield towers, length, rule, float((feasible == labels).mean())


def main() -> None:
    """Write and show the table for the runs on the command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=Path, help="CSV to write: every run at every evaluation")
    arguments = parser.parse_args()
    with one_line_errors():
        runs = finished_runs(arguments.directories)
        rows = [
            (group, run.directory.name, *row)
            for run, group in zip(runs, label_runs(runs), strict=True)
            for row in judged(run)
        ]
        table = pd.DataFrame(rows, columns=COLUMNS)
        if arguments.out:
            arguments.out.parent.mkdir(parents=True, exist_ok=True)
            table.to_csv(arguments.out, index=False, float_format="%.4f")
    lengths = sorted(table["length"].unique())
    lines = Table("group", "towers", "rule", *(f"{length} blocks" for length in lengths), box=None)
    for keys, part in table.groupby(["group", "towers", "rule"], sort=False):
        means = part.groupby("length")["accuracy"].mean()
        lines.add_row(*map(str, keys), *(f"{means[length]:.3f}" for length in lengths))
    Console(width=120).print(lines, highlight=False)


if __name__ == "__main__":
    main()
