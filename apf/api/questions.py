"""Questions about somebody's own objects and plans."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from apf.api.composed import composed, given
from apf.api.files import Table, as_files
from apf.api.runs import Run, load_run
from apf.commands import label as labelling
from apf.commands import plan as planning
from apf.commands import predict as predicting
from apf.domain import Domain, NamedPlans


def plan(
    objects: Table,
    task: str,
    *,
    run: Run | str | Path | None = None,
    length: int = 5,
    top: int = 1,
    stand: float | None = None,
    predictor: str | None = None,
    seed: int = 0,
    overrides: Sequence[str] = (),
) -> planning.Found:
    """The plans of highest expected value that are found for somebody's own objects, as `python -m apf.plan` does.

    Args:
        objects: Of which plans are made: a file, or a frame in its columns.
        task: What a plan is for, by its name in the config, e.g. overhang.
        run: Whose ensemble judges plans.
        length: Placements of a plan.
        top: How many plans that differ from each other.
        stand: The least predicted chance of each plan; None: however likely.
        predictor: analytic or simulation, instead of a run.
        seed: Of all draws.
        overrides: More of the command's settings, e.g. `["planner.generations=100"]`.

    Raises:
        InputError: Something is wrong, or no plan is as likely to succeed as `stand` asks.
    """
    values = {"task": task, "predictor": predictor, "length": length, "top": top, "stand": stand, "seed": seed}
    with as_files(objects=objects) as files:
        arguments = given(objects=files["objects"], **values) + _of(run, overrides)
        with composed("plan", arguments) as (cfg, _):
            return planning.find(planning.settled(cfg))


def predict(
    plans: Table | Any,
    run: Run | str | Path | None = None,
    *,
    objects: Table | None = None,
    predictor: str | None = None,
    odds: float = 1.0,
    seed: int = 0,
    overrides: Sequence[str] = (),
) -> pd.DataFrame:
    """How likely is each prefix of each plan to succeed? As `python -m apf.predict` does.

    Args:
        plans: A file, a frame in its columns, or a batch of the domain's own class.
        run: Whose ensemble judges the plans.
        objects: Those that the plans name, if the plans' own table does not tell their properties.
        predictor: analytic or simulation, instead of a run.
        odds: Factor for the odds of each placement; 1: as the members say.
        seed: Of a predictor that draws.
        overrides: More of the command's settings, e.g. `["domain=NAME"]`.

    Returns:
        A row for each placement: plan, position, chance of the prefix that ends there, and its standard deviation over
        the members of the ensemble.
    """
    tables = {"plans": plans} if _is_table(plans) else {}
    if objects is not None:
        tables["objects"] = objects
    with as_files(**tables) as files:
        values = {"plans": "plans", "out": "-", "predictor": predictor, "odds": odds, "seed": seed}
        arguments = given(**{**values, **files}) + _of(run, overrides)
        with composed("predict", arguments) as (cfg, _):
            config = predicting.settled(cfg)
            batches = predicting.read(config) if _is_table(plans) else _numbered(plans)
            word = config.domain.plan_word
            return predicting.predictions(batches, predicting.predictor_of(config), word, config.seed)


def label(plans: Table | Any, world: str = "analytic", *, seed: int = 0, overrides: Sequence[str] = ()) -> pd.DataFrame:
    """What comes of each prefix of each plan in a world? As `python -m apf.label` does.

    Args:
        plans: A file, a frame in its columns, or a batch of the domain's own class.
        world: Where the plans are executed, by its name in the config.
        seed: Of the world's noise.
        overrides: More of the command's settings, e.g. `["world.noise=0.005"]`.

    Returns:
        A row for each placement: plan, position, label: 1, 0, or missing after the first failure.
    """
    with as_files(**({"plans": plans} if _is_table(plans) else {})) as files:
        values = {"plans": "plans", "out": "-", "world": world, "seed": seed}
        arguments = [*given(**{**values, **files}), *overrides]
        with composed("label", arguments) as (cfg, _):
            config = labelling.settled(cfg)
            domain: Domain = config.domain
            batches = domain.read_plans(config.plans) if _is_table(plans) else _numbered(plans)
            try:
                labels = labelling.labels_of(batches, config.world, config.seed)
            finally:
                config.world.close()
            return labelling.label_table(batches, labels, domain.plan_word)


def _of(run: Run | str | Path | None, overrides: Sequence[str]) -> list[str]:
    """The overrides, with the run and its domain, unless another domain is chosen."""
    if run is None:
        return [*overrides]
    run = run if isinstance(run, Run) else load_run(run)
    domain = None if any(text.startswith("domain=") for text in overrides) else run.domain_choice
    return [*given(run=run.directory, domain=domain), *overrides]


def _is_table(plans: Any) -> bool:
    return isinstance(plans, str | Path | pd.DataFrame)


def _numbered(plans: Any) -> list[NamedPlans]:
    """A batch of the domain's own class, whose plans are called 0, 1, 2, ..."""
    numbers = tuple(range(len(plans)))
    return [NamedPlans(plans, numbers, numbers)]
