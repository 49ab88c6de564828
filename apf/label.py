"""python -m apf.label: label every prefix of somebody's own towers."""

from pathlib import Path

import hydra
import pandas as pd
from omegaconf import DictConfig

from apf.cli import one_line_errors, run_command
from apf.config import build, config_dir
from apf.data import UNOBSERVED
from apf.rng import stream
from apf.settings import Seed, settings
from apf.tables import check_ending, write_table
from apf.towers import read_towers
from apf.worlds import World


@settings
class LabelConfig:
    """What the command is given; the comments in `conf/label.yaml` say what for."""

    towers: Path
    out: Path
    world: World
    seed: Seed


@hydra.main(version_base="1.3", config_path=config_dir(), config_name="label")
@one_line_errors
def job(cfg: DictConfig) -> None:
    """Read, execute, write one row per placement: tower, position, label (empty after the first fall)."""
    config = build(cfg, LabelConfig)
    check_ending(config.out)
    parts = []
    for batch in read_towers(config.towers):
        labels = config.world.execute(batch.towers, stream(config.seed, "label", batch.towers.length))
        part = pd.DataFrame(labels).melt(var_name="position", value_name="label", ignore_index=False)
        part.insert(0, "tower", pd.Series(batch.names))
        part["order"] = pd.Series(batch.order)
        parts.append(part)
    table = pd.concat(parts).sort_values(["order", "position"], ignore_index=True)[["tower", "position", "label"]]
    table["label"] = table["label"].astype("Int8").mask(table["label"] == UNOBSERVED)
    write_table(table, config.out)
    stood = table.groupby("tower")["label"].min().fillna(0).eq(1)
    print(f"{config.out}: {len(stood)} towers labelled, {int(stood.sum())} of them stand")


def main() -> None:
    """Entry point of the command."""
    run_command(job)


if __name__ == "__main__":
    main()
