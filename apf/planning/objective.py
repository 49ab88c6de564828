"""The objective of a run: metrics of its last evaluation, which the run returns to a sweeper that optimises."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
from hydra.core.utils import JobReturn, JobStatus
from pydantic import BeforeValidator

from apf.errors import InputError, Stopped, shown
from apf.planning import EvaluationSettings
from apf.planning.measures import MEASURES

OPTIMISERS = ("optuna", "ax", "nevergrad")
"""Hydra's sweepers that use the objective of a run."""


def _listed(value: Any) -> Any:
    names = [] if value is None else [value] if isinstance(value, str) else value
    if not isinstance(names, list | tuple) or not all(isinstance(name, str) for name in names):
        raise ValueError(f"it should be the name of a metric, a list of names, or null, not {value!r}")
    return tuple(names)


Objective = Annotated[tuple[str, ...], BeforeValidator(_listed)]
"""The names of the metrics that a run returns: none, one, or several for a sweeper that weighs them."""


def metrics_of(regret: pd.DataFrame, accuracy: pd.DataFrame) -> dict[int, dict[str, float]]:
    """Metrics by step.

    For each world and task the median regret and the share of chosen plans that succeeded; for each task the mean
    chance that was predicted of these plans; for each length what `apf.planning.measures` says. A planner picks the
    plans that a model is too sure of, so more was predicted than succeeds (the optimiser's curse).

    Args:
        regret: Rows of `regret.parquet`, of one or more evaluations.
        accuracy: Rows of `accuracy.parquet`.
    """
    found: dict[int, dict[str, float]] = {}
    by = regret.sort_values(["step", "world"], kind="stable").groupby(["step", "world", "task"], sort=False)
    for name, values in (("regret", by["regret"].median()), ("success", by["feasible"].mean())):
        for (step, world, task), value in zip(values.index.tolist(), values.tolist(), strict=True):
            found.setdefault(step, {})[f"{name}/{world}/{task}"] = value
    chances = regret.groupby(["step", "task"], sort=False)["chance"].mean()
    for (step, task), value in zip(chances.index.tolist(), chances.tolist(), strict=True):
        found.setdefault(step, {})[f"predicted/{task}"] = value
    for name in MEASURES:
        if name not in accuracy:  # of an earlier version
            continue
        rows = (accuracy[column].tolist() for column in ("step", "length", name))
        for step, length, value in zip(*rows, strict=True):
            found.setdefault(step, {})[f"{name}/{length}"] = value
    return found


def names_of(evaluation: EvaluationSettings, tasks: Iterable[str]) -> list[str]:
    """The names that `metrics_of` has for evaluations of these settings."""
    where = [f"{world}/{task}" for world in sorted(evaluation.worlds) for task in tasks] if evaluation.problems else []
    lengths = evaluation.lengths if evaluation.test_plans else []
    kinds = [f"{kind}/{name}" for kind in ("regret", "success") for name in where]
    kinds += [f"predicted/{task}" for task in tasks] if evaluation.problems else []
    return kinds + [f"{name}/{length}" for name in MEASURES for length in lengths]


def check_objective(objective: Objective, evaluation: EvaluationSettings, tasks: Iterable[str]) -> None:
    """Raises InputError if no evaluation of these settings has such a metric.

    Args:
        objective: Names of metrics.
        evaluation: The settings.
        tasks: Names of the tasks.
    """
    known = names_of(evaluation, tasks)
    one_of_each = {name.partition("/")[0]: name for name in reversed(known)}.values()
    some = f"{', '.join(reversed(one_of_each))}, and their like" if known else "none"
    for name in objective:
        if name not in known:
            near = "".join(f"; did you mean {match}?" for match in get_close_matches(name, known, n=1))
            raise InputError(f"objective: there is no metric {shown(name)}{near}; there are: {some}")


def optimises(hydra: Any, objective: object) -> bool:
    """Does the sweeper of Hydra's config use the objective of a run?

    Raises InputError if the sweeper does, and no objective is chosen.
    """
    sweeper = hydra.runtime.choices["hydra/sweeper"]
    asks = sweeper in OPTIMISERS
    if asks and not objective:
        raise InputError(f"objective is null; hydra/sweeper={sweeper} needs one, e.g. objective=regret/noisy/tallest")
    return asks


def returned(directory: Path, objective: Objective, plans: int) -> float | tuple[float, ...] | None:
    """The objective of the finished run in the directory; None, a number, or one for each of several names.

    The metrics are those of the last evaluation at no more than `plans` labelled plans: the run may have gone on since.
    A metric that this run does not have is NaN, e.g. regret where no candidate of any problem succeeds.

    Args:
        directory: Of a finished run.
        objective: Names of metrics.
        plans: How many labelled plans count.
    """
    if not objective:
        return None
    regret, accuracy = (pd.read_parquet(directory / f"{name}.parquet") for name in ("regret", "accuracy"))
    steps = [table["step"][table["plans"] <= plans] for table in (regret, accuracy)]
    last = pd.concat(steps).max()
    found = metrics_of(regret[regret["step"] == last], accuracy[accuracy["step"] == last]).get(last, {})
    values = tuple(found.get(name, math.nan) for name in objective)
    return values[0] if len(values) == 1 else values


def must_be_number(value: float | tuple[float, ...] | None) -> None:
    """Raises Stopped for an objective that is no finite number: a sweeper cannot compare it."""
    values = value if isinstance(value, tuple) else (value,)
    if any(number is None or not math.isfinite(number) for number in values):
        raise Stopped(f"its objective is {value}: no candidate of the problems succeeds")


@dataclass
class Failed(JobReturn):
    """Hydra's record of a run that did not finish. A sweeper that reads its value gets this error alone."""

    error: Exception = field(default_factory=Exception)

    @property
    def return_value(self) -> Any:
        """Raises the error."""
        raise self.error

    @return_value.setter
    def return_value(self, value: Any) -> None:
        raise AttributeError("a run that did not finish returns nothing")


def outcome(
    overrides: list[str], directory: Path, value: float | tuple[float, ...] | None, error: Exception | None
) -> JobReturn:
    """Hydra's record of a run: its objective, or the error that ended the run.

    Args:
        overrides: Of the job.
        directory: Of the run.
        value: Its objective.
        error: What it ended with; None: it finished.
    """
    if error is not None:
        return Failed(overrides, working_dir=str(directory), status=JobStatus.FAILED, error=error)
    done = JobReturn(overrides, working_dir=str(directory), status=JobStatus.COMPLETED)
    done.return_value = value
    return done
