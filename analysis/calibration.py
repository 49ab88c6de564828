"""Can a run estimate how its chances are off, better than a constant factor on the odds is? A study of finished runs.

    python -m analysis.calibration runs/beyond/*seed1[0-7]* --step 16 --out results/calibration.csv

A *map* gives each conditional chance p that a member says of a prefix another one, whose logit is
`slope x logit(p) + offset`; the ensemble says the mean of these. Constant maps multiply the odds. The others are fitted
to what members that had not seen a plan said of its labels: the plans of a run are divided into folds, and an ensemble
is trained without each fold in turn. `all` fits to all labelled plans, most of them chosen because the ensemble was in
doubt; `random` to the initial plans alone. Each map is judged on the run's test plans, and by the plans that a Monte
Carlo planner chooses with it.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch

from analysis.commands import finished_runs, one_line_errors, parser_of
from analysis.intervals import over_runs
from apf.domain import Labelled, World
from apf.models import Ensemble
from apf.planning import Evaluator
from apf.planning.measures import accuracy, ece, nll
from apf.report.runs import Run
from apf.rng import stream
from apf.rundir.store import Store
from apf.schema import Config
from apf.trained import chosen_step, config_of, load_ensemble

FOLDS = 5
TRIES = 100
"""How often a chosen plan is executed in the noisy world."""
PULL = 1e-3
"""Weight of the squared distance from the map that changes nothing: few labels fit a map that is too steep."""
CONSTANT = (1.0, 1.5, 2.0, 3.0)
"""Factors on the odds."""
TINY = 1e-9
"""Least chance, and least distance of a chance from 1."""
CHUNK = 5000
"""Plans that are judged at once."""
Map = tuple[np.ndarray, np.ndarray]
"""Slope [K - 1] and offset [K - 1] for the prefixes of 2..K placements."""


@dataclass(frozen=True)
class Told:
    """What members that had not seen a plan said of its labelled prefixes.

    prefix: [N] 0 for two placements, 1 for three, ... logits: [E, N] of each member's chance. label: [N] 0 or 1.
    random: [N] bool, is it of one of the initial plans?
    """

    prefix: np.ndarray
    logits: np.ndarray
    label: np.ndarray
    random: np.ndarray

    def where(self, rows: np.ndarray) -> "Told":
        """The rows of a mask [N]."""
        return Told(self.prefix[rows], self.logits[:, rows], self.label[rows], self.random[rows])

    def fitted(self, slope: bool) -> tuple[float, float]:
        """Slope and offset that make the labels most likely; (1, 0) if there are none.

        Args:
            slope: Fit it, too? Otherwise it is 1.
        """
        if not len(self.label):
            return 1.0, 0.0
        given, labels = torch.tensor(self.logits), torch.tensor(self.label, dtype=torch.float64)
        values = torch.tensor([1.0, 0.0], dtype=torch.float64, requires_grad=True)
        optimizer = torch.optim.LBFGS([values], max_iter=100, line_search_fn="strong_wolfe")

        def loss() -> torch.Tensor:
            optimizer.zero_grad()
            chance = torch.sigmoid((values[0] if slope else 1.0) * given + values[1]).mean(0).clip(TINY, 1 - TINY)
            total = torch.nn.functional.binary_cross_entropy(chance, labels)
            total = total + PULL * ((values[0] - 1) ** 2 + values[1] ** 2)
            total.backward()
            return total

        optimizer.step(loss)
        one, other = values.tolist()
        return (one if slope else 1.0), other


def logits(p: np.ndarray) -> np.ndarray:
    """Of chances, which count as `TINY` away from 0 and 1 at least."""
    p = p.clip(TINY, 1 - TINY)
    return np.asarray(np.log(p) - np.log1p(-p))


def mapped(p: np.ndarray, by: Map) -> np.ndarray:
    """[N] chances of whole plans.

    Args:
        p: [E, N, K - 1] each member's conditional chances of the prefixes of 2..K placements.
        by: Slopes and offsets of K - 1 prefixes or more.
    """
    slope, offset = (each[: p.shape[2]] for each in by)
    return np.asarray((1 / (1 + np.exp(-(slope * logits(p) + offset)))).mean(0).prod(1))


def held_out(run: Path, step: int) -> Told:
    """What ensembles that had not seen a plan said of it.

    Args:
        run: A run directory.
        step: With the plans that were labelled by then.
    """
    domain = config_of(run).domain
    store = Store(run, domain)
    groups, first = store.labelled(until=step), {g.plans.length: len(g.labels) for g in store.labelled(until=0)}
    store.close()
    rng = np.random.default_rng(0)
    fold_of = [rng.integers(FOLDS, size=len(group.labels)) for group in groups]
    rows = []
    for fold in range(FOLDS):
        ensemble = load_ensemble(run, step)
        parts = [(group, np.flatnonzero(folds == fold)) for group, folds in zip(groups, fold_of, strict=True)]
        rest = [np.delete(np.arange(len(group.labels)), out) for group, out in parts]
        ensemble.fit(
            [Labelled(g.plans[kept], g.labels[kept]) for (g, _), kept in zip(parts, rest, strict=True) if len(kept)],
            [],
            np.random.default_rng(fold),
        )
        for group, out in parts:
            if len(out):
                rows.append(_rows(ensemble, group, out, first.get(group.plans.length, 0)))
    columns = zip(*rows, strict=True)
    return Told(*(np.concatenate(column, -1) for column in columns))


def _rows(ensemble: Ensemble, group: Labelled, out: np.ndarray, first: int) -> tuple[np.ndarray, ...]:
    """The columns of `Told` for the plans `out` of a group, whose first plans are the initial ones."""
    p, labels = chances(ensemble, group.plans[out]), group.labels[out][:, 1:]
    plan, prefix = np.nonzero(labels >= 0)
    return prefix, logits(p)[:, plan, prefix], labels[plan, prefix], out[plan] < first


def chances(ensemble: Ensemble, plans: Any) -> np.ndarray:
    """[E, N, K - 1] each member's conditional chance of each prefix of 2..K placements."""
    parts = range(0, len(plans), CHUNK)
    picked = [np.arange(start, min(start + CHUNK, len(plans))) for start in parts]
    return np.concatenate([ensemble.predict(plans[rows]).numpy(force=True) for rows in picked], 1)


def maps_of(told: Told, prefixes: int) -> dict[str, Map]:
    """All maps that are compared, by name.

    Args:
        told: Of `held_out`.
        prefixes: K - 1 of the longest plans.
    """
    found: dict[str, Map] = {
        f"odds x {odds:g}": (np.ones(prefixes), np.full(prefixes, np.log(odds))) for odds in CONSTANT
    }
    for name, part in (("all", told), ("random", told.where(told.random))):
        for what, slope in (("offset", False), ("slope and offset", True)):
            by_slope, by_offset = part.fitted(slope)
            found[f"{what}, {name}"] = np.full(prefixes, by_slope), np.full(prefixes, by_offset)
    by_prefix = [told.where(told.prefix == prefix).fitted(slope=True) for prefix in range(prefixes)]
    found["slope and offset of each prefix, all"] = tuple(np.array(by_prefix).T)
    return found


def judged(config: Config, ensemble: Ensemble, maps: Mapping[str, Map], problems: int) -> pd.DataFrame:
    """A row for each map and measure: map, measure, of, value.

    Args:
        config: Of the run.
        ensemble: Of one of its steps.
        maps: By name.
        problems: Planning problems.
    """
    rows = []
    settings = config.evaluation
    evaluator = Evaluator(settings, config.domain, config.planner, config.task)
    for length in settings.lengths:
        plans, labels = evaluator.test_set(length)
        p = chances(ensemble, plans)
        for name, by in maps.items():
            chance = mapped(p, by)
            for measure in (accuracy, nll, ece):
                rows.append((name, measure.__name__, f"{length}", measure(chance, labels)))
    world = list(settings.worlds.values())[-1]
    for number in range(problems):
        candidates = config.domain.problem(
            settings.length, config.planner.candidates, stream(settings.seed, "problem", number)
        )
        p, standing = chances(ensemble, candidates), config.domain.feasible(candidates)
        of_maps = {name: mapped(p, by) for name, by in maps.items()}
        for task_name, task in config.task.items():
            value = task.value(candidates)
            best = float(value[standing].max(initial=0.0))
            for name, chance in of_maps.items():
                row = int((chance * value).argmax())
                share = _share(world, candidates[np.full(TRIES, row)], number)
                rows.append((name, "regret", task_name, 1 - value[row] * share / best if best > 0 else np.nan))
                rows.append((name, "standing", task_name, share))
    table = pd.DataFrame(rows, columns=["map", "measure", "of", "value"])
    return table.groupby(["map", "measure", "of"], sort=False)["value"].mean().reset_index()


def _share(world: World, plans: Any, number: int) -> float:
    """The share of these executions that succeed."""
    return float((world.execute(plans, np.random.default_rng(number)) == 1).all(1).mean())


def study(run: Run, step: int, problems: int) -> pd.DataFrame:
    """`judged` for one run, with a column `run`.

    Args:
        run: A finished run.
        step: An evaluated step.
        problems: Planning problems.
    """
    config, ensemble = config_of(run.directory), load_ensemble(run.directory, chosen_step(run.directory, step))
    longest = max(config.evaluation.length, *config.evaluation.lengths)
    maps = maps_of(held_out(run.directory, step), longest - 1)
    return judged(config, ensemble, maps, problems).assign(run=run.directory.name)


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """A row for each map and measure: mean over lengths or tasks, then over runs, with its 95 % interval."""
    of_runs = table.groupby(["map", "measure", "run"], sort=False)["value"].mean().reset_index()
    rows = []
    for (name, measure), part in of_runs.groupby(["map", "measure"], sort=False):
        low, high = over_runs(part["value"].to_numpy())
        rows.append((name, measure, part["value"].mean(), low, high, len(part)))
    return pd.DataFrame(rows, columns=["map", "measure", "mean", "low", "high", "runs"])


def main() -> None:
    """Study the runs on the command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--step", type=int, required=True, help="an evaluated step, whose ensemble is judged")
    parser.add_argument("--problems", type=int, default=20, help="planning problems (default: %(default)s)")
    parser.add_argument("--out", type=Path, required=True, help="CSV to write")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    with one_line_errors():
        tables = []
        for run in finished_runs(arguments.directories):
            print(run.directory, file=sys.stderr)
            tables.append(study(run, arguments.step, arguments.problems))
        found = summary(pd.concat(tables, ignore_index=True))
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        found.to_csv(arguments.out, index=False, float_format="%.4f")
    print(found.pivot(index="map", columns="measure", values="mean").round(3).to_string())
    print(arguments.out)


if __name__ == "__main__":
    main()
