"""What `python -m apf.plan` does: find the best plans of somebody's own objects."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from omegaconf import DictConfig, OmegaConf
from pydantic import Field

from apf.commands.judge import judge_of
from apf.config.build import build
from apf.config.values import without
from apf.domain import Domain, Predictor, Task
from apf.errors import InputError
from apf.planning import Choice, Planner, alternatives
from apf.rng import stream
from apf.rundir.tables import check_ending, write_table
from apf.settings import CountOrNone, Length, Name, Number, Seed, Whole, settings

Top = Annotated[Whole, Field(ge=1, le=100)]
"""How many plans to choose from."""
Share = Annotated[Number, Field(ge=0, le=1)]
"""A chance."""


@settings
class PlanConfig:
    """What the command is given; the comments in `conf/plan.yaml` say what for."""

    objects: Path
    run: Path | None
    step: CountOrNone | None
    length: Length
    top: Top
    stand: Share | None
    out: Path
    seed: Seed
    device: Name
    domain: Domain
    task: dict[str, Task]
    planner: Planner
    predictor: Predictor | None


@dataclass(frozen=True)
class Found:
    """N plans that were found for a task, from the best on, and what is predicted of them.

    task: Its name. unit: Of the values. choices: The plans, each with its value and the chance that it was chosen for.
    chances: [N, K] of each prefix, means over the members of an ensemble. deviations: [N, K] standard deviation over
    these members, NaN if there are none. domain: Of the plans.
    """

    task: str
    unit: str
    choices: list[Choice]
    chances: np.ndarray
    deviations: np.ndarray
    domain: Domain

    @cached_property
    def plans(self) -> Any:
        """The plans as one batch of the domain's own class."""
        return self.domain.concatenate([choice.plan for choice in self.choices])

    @cached_property
    def table(self) -> pd.DataFrame:
        """A row for each placement, in the columns of a file of plans, with `value`, `chance` and `deviation`.

        `value` is that of the whole plan, the other two are of the prefix that ends with the placement.
        """
        table = self.domain.table(self.plans)
        length = self.plans.length
        values = {
            "value": np.repeat([choice.value for choice in self.choices], length),
            "chance": self.chances.ravel(),
            "deviation": self.deviations.ravel(),
        }
        for place, (name, column) in enumerate(values.items(), start=2):
            table.insert(place, name, column)
        return table

    def title(self, number: int) -> str:
        """What is said of a plan: task, value and chance."""
        choice = self.choices[number]
        return f"{self.task} {choice.value:.3g} {self.unit}, chance {self.chances[number, -1]:.2f}"

    def save_pictures(self, path: Path) -> list[Path]:
        """Write a picture of each plan; of several, their numbers are added to the name of the file.

        Args:
            path: Of a .png, .svg or .pdf file.

        Returns:
            The files; none if the domain draws no pictures.
        """
        several = len(self.choices) > 1
        paths = [path.with_stem(f"{path.stem}_{i}") if several else path for i in range(len(self.choices))]
        plans = enumerate(zip(self.choices, paths, strict=True))
        return [file for i, (choice, file) in plans if self.domain.save_picture(choice.plan, file, self.title(i))]


def work(cfg: DictConfig) -> None:
    """Plan, say what was found, and write it."""
    config = settled(cfg)
    check_ending(config.out)
    found = find(config)
    write_table(found.table, config.out)
    for number in range(len(found.choices)):
        for line in said_of(found, number):
            print(line)
    if len(found.choices) < config.top:
        print(f"found {len(found.choices)} instead of {config.top}: no others differ enough and are worth anything")
    print(f"written: {', '.join(map(str, [config.out, *found.save_pictures(config.out.with_suffix('.png'))]))}")


def settled(cfg: DictConfig) -> PlanConfig:
    """The checked settings of what Hydra composed. Raises InputError, naming the key, for what is wrong."""
    cfg = without(cfg, "model")
    if not OmegaConf.is_missing(cfg, "objects"):
        cfg.domain.training.file = cfg.objects
    try:
        config: PlanConfig = build(cfg, PlanConfig)
        if len(config.task) != 1:
            raise InputError(f"task is {', '.join(config.task) or 'none'}; choose one of them: task=NAME")
        config.domain.check_length(config.length, "length")
    except InputError as error:
        line = str(error).replace("domain.training.file", "objects").replace("domain.training has", "objects has")
        raise InputError(line) from None
    return config


def find(config: PlanConfig) -> Found:
    """The plans of highest expected value that the planner finds for what the settings ask.

    Raises:
        InputError: There is nobody to ask, or no plan is as likely to succeed as `stand` asks.
    """
    predictor = judge_of(config.run, config.step, config.predictor, config.domain, device=config.device)
    ((name, task),) = config.task.items()
    planner, domain = config.planner, config.domain
    candidates = domain.random_plans(config.length, planner.candidates, stream(config.seed, "plan"))
    least = config.stand or 0.0
    try:
        choices = alternatives(planner, candidates, task, predictor, domain, config.top, least, config.seed)
    except InputError as error:
        doubt = predictor.members > 1 and planner.pessimism
        off = f", the members' standard deviation taken off (planner.pessimism={doubt:g})" if doubt else ""
        line = f"stand is {least:g}; {error}{off}: ask for less, or for fewer placements (length)"
        raise InputError(line) from None
    plans = domain.concatenate([choice.plan for choice in choices])
    judge = planner.judge(predictor).with_pessimism(None)
    chances = judge.prefix_feasibility(plans, stream(config.seed, "chances"))
    if judge.random:  # which says something else each time
        chances[:, -1] = [choice.chance for choice in choices]
    return Found(name, task.unit, choices, chances, judge.prefix_deviation(plans), domain)


def said_of(found: Found, number: int) -> list[str]:
    """Lines on a plan: its value and chance, the chance of each prefix, how far the members of an ensemble differ."""
    lines = [f"{number}: {found.title(number)}" if len(found.choices) > 1 else found.title(number)]
    lines.append(f"chance of each prefix: {' '.join(f'{chance:.2f}' for chance in found.chances[number])}")
    deviation = found.deviations[number]
    if not np.isnan(deviation).any():
        lines.append(f"standard deviation of the members: {' '.join(f'{each:.2f}' for each in deviation)}")
    return lines
