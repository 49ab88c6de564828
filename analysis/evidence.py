"""Results of finished runs, as arrays from which a bootstrap can draw."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from apf.report.runs import Run

Regrets = dict[tuple[str, str, str, int], tuple[np.ndarray, np.ndarray]]
Accuracies = dict[tuple[str, int, int], np.ndarray]


class MissingError(LookupError):
    """The runs have no such result."""


@dataclass(frozen=True)
class Evidence:
    """Regret, success and accuracy of runs, for comparisons between names. A bootstrap draws from the evidence.

    A name (who) is a sampler, or a predictor that does not learn; in `accuracy`, the name of a model. An evaluation
    counts only if all runs of a name had that evaluation.

    Attributes:
        regret: By (who, world, task, towers): regret [R, P], and whether the tower stood [R, P], of R runs on P
            problems.
        accuracy: By (model, length, towers): accuracy [R].
        runs: By name: the runs that a bootstrap drew; the same for all figures of that name.
        problems: The problems that a bootstrap drew; the same for all runs.
    """

    regret: Regrets
    accuracy: Accuracies
    runs: Mapping[str, np.ndarray]
    problems: np.ndarray

    @staticmethod
    def of(runs: Sequence[Run]) -> "Evidence":
        """The evidence of finished runs. For samplers the runs of TGN count; for models, the runs of sequential."""
        regret: Regrets = {}
        accuracy: Accuracies = {}
        counts: dict[str, int] = {}
        problems = 0
        for who, members in _by(runs, "sampler", model="tgn").items():
            tables = _tables(members, "regret")
            if not tables:
                continue
            counts[who] = len(tables)
            by: Any = pd.concat(tables).groupby(["world", "task", "plans"])
            for (world, task, towers), part in by:
                values, stood = (part.pivot(index="run", columns="problem", values=c) for c in ("regret", "feasible"))
                problems = max(problems, values.shape[1])
                if len(values) == len(tables):
                    regret[who, world, task, int(towers)] = values.to_numpy(float), stood.to_numpy(float)
        for model, members in _by(_comparing(runs, "model"), "model", sampler="sequential").items():
            tables = _tables(members, "accuracy")
            if not tables:
                continue
            counts[model] = len(tables)
            by = pd.concat(tables).groupby(["length", "plans"])
            for (length, towers), part in by:
                if len(part) == len(tables):
                    accuracy[model, int(length), int(towers)] = part["accuracy"].to_numpy()
        return Evidence(regret, accuracy, {who: np.arange(n) for who, n in counts.items()}, np.arange(problems))

    def drawn(self, rng: np.random.Generator) -> "Evidence":
        """New evidence with as many runs and as many problems, drawn with replacement."""
        runs = {who: rng.choice(rows, len(rows)) for who, rows in self.runs.items()}
        return Evidence(self.regret, self.accuracy, runs, rng.choice(self.problems, len(self.problems)))

    def regrets(self, who: str, task: str, towers: int, world: str = "analytic") -> np.ndarray:
        """[R, P] normalised regret; NaN on problems without a feasible candidate.

        Args:
            who: A sampler, or a predictor that does not learn.
            task: The name of a task.
            towers: Labelled towers at the evaluation.
            world: Where the chosen towers were built.

        Raises:
            MissingError: The runs have no such evaluation.
        """
        return self._pick((who, world, task, towers))[0]

    def stood(self, who: str, task: str, towers: int, world: str = "analytic") -> np.ndarray:
        """[R, P] whether the chosen tower stood.

        Args:
            who: A sampler, or a predictor that does not learn.
            task: The name of a task.
            towers: Labelled towers at the evaluation.
            world: Where the chosen towers were built.

        Raises:
            MissingError: The runs have no such evaluation.
        """
        return self._pick((who, world, task, towers))[1]

    def accuracies(self, model: str, length: int, towers: int) -> np.ndarray:
        """[R] accuracy.

        Args:
            model: The name of a model.
            length: The number of placements.
            towers: Labelled towers at the evaluation.

        Raises:
            MissingError: The runs have no such evaluation.
        """
        if (values := self.accuracy.get((model, length, towers))) is None:
            raise MissingError(f"no accuracy of {model} on {length} blocks at {towers} towers")
        return values[self.runs[model]]

    def common_towers(self, *names: str) -> list[int]:
        """Numbers of towers at which all these names were evaluated, least first.

        Raises:
            MissingError: There is no such number.
        """
        keys = [(key[0], int(key[-1])) for key in (*self.regret, *self.accuracy)]
        at = [{towers for who, towers in keys if who == name} for name in names]
        common = sorted(set.intersection(*at))
        if not common:
            raise MissingError(
                f"no runs of {', '.join(name for name, towers in zip(names, at) if not towers) or names}"
            )
        return common

    def _pick(self, key: tuple[str, str, str, int]) -> tuple[np.ndarray, np.ndarray]:
        if key not in self.regret:
            who, world, task, towers = key
            raise MissingError(f"no regret of {who} on {task} at {towers} towers in world {world}")
        values, stood = self.regret[key]
        grid = np.ix_(self.runs[key[0]], self.problems)
        return values[grid], stood[grid]


def _tables(runs: Sequence[Run], name: str) -> list[pd.DataFrame]:
    """The tables of that name that have rows. A column `run` numbers the tables."""
    tables = [table for run in runs if len(table := run.table(name))]
    return [table.assign(run=number) for number, table in enumerate(tables)]


def _comparing(runs: Sequence[Run], group: str) -> Sequence[Run]:
    """The runs of sweeps that compare options of a group: these were evaluated alike. All runs, if no sweep does."""
    options: dict[Any, set[str]] = {}
    for run in runs:
        options.setdefault(run.config.get("sweep"), set()).add(str(run.choices.get(group)))
    return [run for run in runs if len(options[run.config.get("sweep")]) > 1] or runs


def _by(runs: Sequence[Run], group: str, **others: str) -> dict[str, list[Run]]:
    """Runs by their choice of a group, if their other choices are `others`. Runs that do not learn: by predictor."""
    found: dict[str, list[Run]] = {}
    for run in runs:
        predictor = str(run.choices.get("predictor", "learned"))
        if all(run.choices.get(name) == choice for name, choice in others.items()):
            if predictor == "learned":
                found.setdefault(str(run.choices[group]), []).append(run)
            elif group == "sampler":
                found.setdefault(f"predictor {predictor}", []).append(run)
    return found
