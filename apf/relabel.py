"""python -m apf.relabel: what an operator saw of a tower differs from what was recorded."""

import shlex
from pathlib import Path

import hydra
import numpy as np
from omegaconf import DictConfig, OmegaConf

from apf.cli import one_line_errors, run_command
from apf.config import build, config_dir
from apf.errors import InputError
from apf.files import read_yaml
from apf.rundir import CONFIG, JOURNAL, locked, reopen
from apf.settings import CountOrNone, settings
from apf.store import VALUE, Store
from apf.towers import TowerDomain
from apf.worlds import are_labels


@settings
class RelabelConfig:
    """What the command is given; the comments in `conf/relabel.yaml` say what for."""

    run: Path
    tower: CountOrNone
    labels: str
    reason: str


@hydra.main(version_base="1.3", config_path=config_dir(), config_name="relabel")
@one_line_errors
def job(cfg: DictConfig) -> None:
    """Record the correction; the tables follow at once, what was learned since at the next resume."""
    if "labels" in cfg and isinstance(cfg.labels, int):
        cfg.labels = str(cfg.labels)
    config = build(cfg, RelabelConfig)
    for name in (CONFIG, JOURNAL):
        if not (config.run / name).exists():
            raise InputError(f"run={config.run}: no run there; give a directory that holds {name}")
    with locked(config.run):
        domain = domain_of(config.run)
        domain.check_kept(config.run)
        store = Store(config.run, domain)
        try:
            old = store.tower(config.tower).labels or ""
            new = checked(config.labels, len(old))
            if new == old:
                raise InputError(f"labels={new}: tower {config.tower} has these labels already")
            reopen(config.run)  # first: a kill in between must not leave a correction that a finished run ignores
            store.correct(config.tower, new, config.reason)
            store.export()
        finally:
            store.close()
    print(f"tower {config.tower}: {old} is now {new}")
    print(f"learn again what depended on it: python -m apf.main resume={shlex.quote(str(config.run))}")


def domain_of(run: Path) -> TowerDomain:
    """The domain that a run directory's config describes."""
    return build(OmegaConf.create({"domain": read_yaml(run / CONFIG)["domain"]}), dict)["domain"]


def checked(labels: str, length: int) -> str:
    """The labels of `length` prefixes, those left out after the first 0 added. Raises InputError if they are none."""
    right = f"it must be {length} characters, 1 for each prefix that stood, then one 0, then - to the end"
    padded = labels.ljust(length, "-") if "0" in labels else labels
    if len(padded) != length or set(padded) - set(VALUE):
        raise InputError(f"labels is {labels}; {right}")
    if not are_labels(np.array([VALUE[symbol] for symbol in padded])):
        raise InputError(f"labels is {labels}; {right}")
    return padded


def main() -> None:
    """Entry point of the command."""
    run_command(job)


if __name__ == "__main__":
    main()
