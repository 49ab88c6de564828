"""Results of finished runs, as arrays from which a bootstrap can draw."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
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

    A name (who) is a sampler, or a predictor that does not learn; in `accuracy`, the name of a model. What is taken
    over several evaluations, or at the last one, is taken over those that all runs of a name had.

    Attributes:
        regret: By (who, world, task, towers): regret [R, P], and whether the tower stood [R, P], of R runs on P
            problems.
        accuracy: By (model, length, towers): accuracy [R].
        runs: By name: the runs that a bootstrap drew; the same for all figures of that name.
        problems: The problems that a bootstrap drew; the same for all runs.
        partial: As `regret`, of evaluations that some runs of a name had; NaN in the rows of the others.
        sources: By name: the runs that the figures come from.
    """

    regret: Regrets
    accuracy: Accuracies
    runs: Mapping[str, np.ndarray]
    problems: np.ndarray
    partial: Regrets = field(default_factory=dict)
    sources: Mapping[str, Sequence[Run]] = field(default_factory=dict)

    @staticmethod
    def of(runs: Sequence[Run]) -> "Evidence":
        """The evidence of finished runs. For samplers the runs of TGN count; for models, the runs of sequential."""
        regret: Regrets = {}
        partial: Regrets = {}
        accuracy: Accuracies = {}
        sources: dict[str, Sequence[Run]] = {}
        for who, members in _by(runs, "sampler", model="tgn").items():
            sources[who], tables = _tables(members, "regret")
            if not tables:
                continue
            by: Any = pd.concat(tables).groupby(["world", "task", "plans"])
            for (world, task, towers), part in by:
                values, stood = (
                    part.pivot(index="run", columns="problem", values=column).reindex(range(len(tables)))
                    for column in ("regret", "feasible")
                )
                here = regret if part["run"].nunique() == len(tables) else partial
                here[who, world, task, int(towers)] = values.to_numpy(float), stood.to_numpy(float)
        for model, members in _by(_comparing(runs, "model"), "model", sampler="sequential").items():
            sources[model], tables = _tables(members, "accuracy")
            if not tables:
                continue
            by = pd.concat(tables).groupby(["length", "plans"])
            for (length, towers), part in by:
                if len(part) == len(tables):
                    accuracy[model, int(length), int(towers)] = part["accuracy"].to_numpy()
        sources = {who: of_who for who, of_who in sources.items() if of_who}
        rows = {who: np.arange(len(of_who)) for who, of_who in sources.items()}
        problems = max((stood.shape[1] for _, stood in (*regret.values(), *partial.values())), default=0)
        padded = (_padded(regrets, problems) for regrets in (regret, partial))
        return Evidence(next(padded), accuracy, rows, np.arange(problems), next(padded), sources)

    def drawn(self, rng: np.random.Generator) -> "Evidence":
        """New evidence with as many runs and as many problems, drawn with replacement."""
        runs = {who: rng.choice(rows, len(rows)) for who, rows in self.runs.items()}
        return replace(self, runs=runs, problems=rng.choice(self.problems, len(self.problems)))

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

    def count(self, who: str, towers: int | None = None) -> int:
        """How many runs a name has; how many with an evaluation at so many towers.

        Args:
            who: A sampler, a predictor that does not learn, or a model.
            towers: None: all runs.
        """
        keys = ((key[0], int(key[-1])) for key in (*self.regret, *self.accuracy))
        if towers is None or (who, towers) in keys:
            return len(self.runs.get(who, ()))
        some = (stood for (name, *_, at), (_, stood) in self.partial.items() if (name, at) == (who, towers))
        return max((int(_evaluated(stood).sum()) for stood in some), default=0)

    def _pick(self, key: tuple[str, str, str, int]) -> tuple[np.ndarray, np.ndarray]:
        who, world, task, towers = key
        found = self.regret.get(key) or self.partial.get(key)
        if found is None:
            raise MissingError(f"no regret of {who} on {task} at {towers} towers in world {world}")
        values, stood = found
        drawn = self.runs[who]
        if key in self.partial:
            has = _evaluated(stood)
            drawn = drawn[has[drawn]] if has[drawn].any() else np.flatnonzero(has)  # a draw may miss all of a few runs
        grid = np.ix_(drawn, self.problems)
        return values[grid], stood[grid]


def _evaluated(stood: np.ndarray) -> np.ndarray:
    """[R] which runs had an evaluation; stood: [R, P]."""
    return ~np.isnan(stood).all(axis=1)


def _padded(regret: Regrets, problems: int) -> Regrets:
    """All arrays with so many problems, NaN for those that runs of another protocol lack."""

    def pad(array: np.ndarray) -> np.ndarray:
        return np.pad(array, ((0, 0), (0, problems - array.shape[1])), constant_values=np.nan)

    return {key: (pad(values), pad(stood)) for key, (values, stood) in regret.items()}


def _tables(runs: Sequence[Run], name: str) -> tuple[list[Run], list[pd.DataFrame]]:
    """The runs whose table of that name has rows, and these tables. A column `run` numbers the tables."""
    pairs = [(run, table) for run in runs if len(table := run.table(name))]
    return [run for run, _ in pairs], [table.assign(run=number) for number, (_, table) in enumerate(pairs)]


def _comparing(runs: Sequence[Run], group: str) -> Sequence[Run]:
    """The runs of sweeps that compare options of a group: these were evaluated alike. All runs, if no sweep does."""
    options: dict[Any, set[str]] = {}
    for run in runs:
        options.setdefault(run.config.get("sweep"), set()).add(str(run.choices.get(group)))
    return [run for run in runs if len(options[run.config.get("sweep")]) > 1] or runs


def _by(runs: Sequence[Run], group: str, **others: str) -> dict[str, list[Run]]:
    """Runs by their choice of a group, if their other choices are `others`. Runs that do not learn: by predictor.

    An option SWEEP_NAME of the sweep SWEEP is that sweep's way of doing what NAME does, and counts as NAME.
    """
    found: dict[str, list[Run]] = {}
    for run in runs:
        prefix = f"{run.config.get('sweep')}_"
        choices = {name: str(choice).removeprefix(prefix) for name, choice in run.choices.items()}
        if all(choices.get(name) == choice for name, choice in others.items()):
            if run.learns:
                found.setdefault(choices[group], []).append(run)
            elif group == "sampler":
                found.setdefault(f"predictor {choices['predictor']}", []).append(run)
    return found
