"""What `python -m apf.predict` does: how likely is each prefix of somebody's own plans to succeed?"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from apf.commands.judge import judge_of
from apf.commands.prefixes import prefix_table
from apf.config.build import build
from apf.config.values import without
from apf.domain import Domain, NamedPlans, Predictor
from apf.errors import InputError
from apf.planning.planner import Odds
from apf.rng import stream
from apf.rundir.tables import check_ending, write_table
from apf.settings import CountOrNone, Name, Seed, settings

SAID = 10
"""Of so many plans the summary says how likely each is to succeed."""


@settings
class PredictConfig:
    """What the command is given; the comments in `conf/predict.yaml` say what for."""

    plans: Path
    objects: Path | None
    run: Path | None
    step: CountOrNone | None
    out: Path
    odds: Odds
    seed: Seed
    device: Name
    domain: Domain
    predictor: Predictor | None


def work(cfg: DictConfig) -> None:
    """Read, predict, say what was found, write one row per placement."""
    config = settled(cfg)
    check_ending(config.out)
    batches = read(config)
    table = predictions(batches, predictor_of(config), config.domain.plan_word, config.seed)
    write_table(table, config.out)
    for line in summary(table):
        print(line)
    print(f"written: {config.out}")


def settled(cfg: DictConfig) -> PredictConfig:
    """The checked settings of what Hydra composed. Raises InputError, naming the key, for what is wrong."""
    config: PredictConfig = build(without(cfg, "model", "task"), PredictConfig)
    return config


def read(config: PredictConfig) -> list[NamedPlans]:
    """The plans of the file, of the objects that it tells of, or of those in a file of their own."""
    if config.objects is None:
        return config.domain.read_plans(config.plans)
    try:
        objects = config.domain.read_objects(config.objects)
    except InputError as error:
        raise InputError(f"objects: {error}") from None
    return config.domain.read_plans(config.plans, objects)


def predictor_of(config: PredictConfig) -> Predictor:
    """Who is asked. Raises InputError as `judge_of` does."""
    return judge_of(config.run, config.step, config.predictor, config.domain, config.odds, config.device)


def predictions(batches: Sequence[NamedPlans], predictor: Predictor, word: str, seed: int = 0) -> pd.DataFrame:
    """One row per placement: plan, position, `chance` of the prefix that ends there, and its `deviation`.

    The deviation is the standard deviation over the members of an ensemble; missing: there are no members.

    Args:
        batches: Plans of one length each.
        predictor: Is asked.
        word: What a plan is called: the name of the first column.
        seed: Of the predictor's draws, if it draws.
    """
    values: dict[str, list[np.ndarray]] = {"chance": [], "deviation": []}
    for batch in batches:
        values["chance"].append(predictor.prefix_feasibility(batch.plans, stream(seed, "predict", batch.plans.length)))
        values["deviation"].append(predictor.prefix_deviation(batch.plans))
    return prefix_table(batches, values, word)


def summary(table: pd.DataFrame) -> list[str]:
    """Lines on what was predicted: each of a few plans, then all of them.

    Args:
        table: As `predictions` gives it.
    """
    word = str(table.columns[0])
    lines = []
    for name, plan in [*table.groupby(word, sort=False)][:SAID]:
        sure = plan["deviation"].iloc[-1]
        spread = "" if np.isnan(sure) else f", standard deviation of the members {sure:.2f}"
        prefixes = " ".join(f"{chance:.2f}" for chance in plan["chance"])
        lines.append(f"{word} {name}: chance {plan['chance'].iloc[-1]:.2f}{spread}; of each prefix: {prefixes}")
    chances = table.groupby(word, sort=False)["chance"].last()
    if len(chances) > SAID:
        lines.append("...")
    lines.append(f"{len(chances)} plans: {chances.sum():.1f} are expected to succeed")
    return lines
