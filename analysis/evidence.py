"""What finished runs say, as arrays that a bootstrap can draw from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from apf.report.runs import Run

Regrets = dict[tuple[str, str, str, int], tuple[np.ndarray, np.ndarray]]
Accuracies = dict[tuple[str, int, int], np.ndarray]


class MissingError(LookupError):
    """The runs at hand do not say."""


@dataclass(frozen=True)
class Evidence:
    """Regret, success and accuracy of runs, for comparisons between names. A bootstrap draws from it.

    A name (who) is a sampler, or a predictor that does not learn. Only evaluations that all runs of a name had count.

    regret: by (who, world, task, towers): regret [R, P], and whether the tower stood [R, P], of R runs on P problems.
    accuracy: by (model, length, towers): [R].
    runs: by who: which runs a bootstrap drew; the same for all figures of that name.
    problems: which problems it drew; the same for all runs.
    """

    regret: Regrets
    accuracy: Accuracies
    runs: Mapping[str, np.ndarray]
    problems: np.ndarray

    @staticmethod
    def of(runs: Sequence[Run]) -> "Evidence":
        """The evidence of finished runs. Samplers are compared by the runs of TGN, models by those of sequential."""
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
        """As many runs and as many problems again, drawn with replacement."""
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
        """At how many towers all of these were evaluated, least first. Raises MissingError if there are none."""
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
    """The tables of that name of those runs that have any rows in it, with a column `run` that counts them."""
    tables = [table for run in runs if len(table := run.table(name))]
    return [table.assign(run=number) for number, table in enumerate(tables)]


def _comparing(runs: Sequence[Run], group: str) -> Sequence[Run]:
    """The runs of sweeps that compare options of a group, as these were evaluated alike; all runs if no sweep does."""
    options: dict[Any, set[str]] = {}
    for run in runs:
        options.setdefault(run.config.get("sweep"), set()).add(str(run.choices.get(group)))
    return [run for run in runs if len(options[run.config.get("sweep")]) > 1] or runs


def _by(runs: Sequence[Run], group: str, **others: str) -> dict[str, list[Run]]:
    """Runs by their choice of a group, among those with these other choices; those that do not learn by predictor."""
    found: dict[str, list[Run]] = {}
    for run in runs:
        predictor = str(run.choices.get("predictor", "learned"))
        if all(run.choices.get(name) == choice for name, choice in others.items()):
            if predictor == "learned":
                found.setdefault(str(run.choices[group]), []).append(run)
            elif group == "sampler":
                found.setdefault(f"predictor {predictor}", []).append(run)
    return found
