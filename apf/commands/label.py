"""What `python -m apf.label` does: label every prefix of somebody's own plans."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig

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
    config = build(without(cfg, "model", "task"), LabelConfig)
    check_ending(config.out)
    batches = config.domain.read_plans(config.plans)
    labels = [config.world.execute(b.plans, stream(config.seed, "label", b.plans.length)) for b in batches]
    write_table(label_table(batches, labels, config.domain.plan_word), config.out)
    succeeded = sum(int((found == 1).all(1).sum()) for found in labels)
    print(f"{config.out}: {sum(map(len, labels))} plans labelled, {succeeded} of them succeed")


def label_table(batches: Sequence[NamedPlans], labels: Sequence[np.ndarray], word: str) -> pd.DataFrame:
    """One row per placement: plan, position, label (missing after the first fall), in the order of the file.

    Args:
        batches: plans of one length each.
        labels: the labels [N, K] of each batch.
        word: What a plan is called: the name of the first column.
    """
    order = np.concatenate([np.repeat(batch.order, batch.plans.length) for batch in batches])
    position = np.concatenate([np.tile(np.arange(b.plans.length), len(b.plans)) for b in batches])
    rows = np.lexsort((position, order))
    label = np.concatenate([np.asarray(found, np.int8).ravel() for found in labels])[rows]
    names = pd.Series([name for b in batches for name in b.names], [i for b in batches for i in b.order]).sort_index()
    return pd.DataFrame(
        {
            word: names.to_numpy()[order[rows]],
            "position": position[rows],
            "label": pd.arrays.IntegerArray(label, label == UNOBSERVED),
        }
    )
