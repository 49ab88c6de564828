"""What `python -m apf.label` does: label every prefix of somebody's own plans."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from apf.commands.prefixes import prefix_table
from apf.config.build import build
from apf.config.values import without
from apf.domain import UNOBSERVED, Domain, NamedPlans, World
from apf.rng import stream
from apf.rundir.tables import check_ending, write_table
from apf.settings import Seed, settings


@settings
class LabelConfig:
    """What the command is given; the comments in `conf/label.yaml` say what for."""

    plans: Path
    out: Path
    domain: Domain
    world: World
    seed: Seed


def work(cfg: DictConfig) -> None:
    """Read, execute, write one row per placement: the plan's name, position, label (empty after the first fall)."""
    config = settled(cfg)
    check_ending(config.out)
    batches = config.domain.read_plans(config.plans)
    labels = labels_of(batches, config.world, config.seed)
    write_table(label_table(batches, labels, config.domain.plan_word), config.out)
    succeeded = sum(int((found == 1).all(1).sum()) for found in labels)
    print(f"{config.out}: {sum(map(len, labels))} plans labelled, {succeeded} of them succeed")


def settled(cfg: DictConfig) -> LabelConfig:
    """The checked settings of what Hydra composed. Raises InputError, naming the key, for what is wrong."""
    config: LabelConfig = build(without(cfg, "model", "task"), LabelConfig)
    return config


def labels_of(batches: Sequence[NamedPlans], world: World, seed: int) -> list[np.ndarray]:
    """The labels [N, K] of each batch, each plan executed in the world.

    Args:
        batches: Plans of one length each.
        world: Where the plans are executed.
        seed: Of the world's noise.
    """
    return [world.execute(batch.plans, stream(seed, "label", batch.plans.length)) for batch in batches]


def label_table(batches: Sequence[NamedPlans], labels: Sequence[np.ndarray], word: str) -> pd.DataFrame:
    """One row per placement: plan, position, label (missing after the first fall), in the order of the file.

    Args:
        batches: plans of one length each.
        labels: the labels [N, K] of each batch.
        word: What a plan is called: the name of the first column.
    """
    table = prefix_table(batches, {"label": [np.asarray(found, np.int8) for found in labels]}, word)
    label = table["label"].to_numpy(np.int8)
    return table.assign(label=pd.arrays.IntegerArray(label, label == UNOBSERVED))
