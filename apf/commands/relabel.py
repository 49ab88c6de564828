"""What `python -m apf.relabel` does: what an operator saw of a plan differs from what was recorded."""

import shlex
import sys
from pathlib import Path

import numpy as np
from omegaconf import DictConfig, OmegaConf

from apf.config.build import build
from apf.domain import Domain, are_labels
from apf.errors import InputError
from apf.rundir.claim import CONFIG, JOURNAL, STATE, locked
from apf.rundir.directory import check_objects, reopen
from apf.rundir.labels import VALUE
from apf.rundir.resume import as_literal, kept_config, shut_off
from apf.rundir.store import Store
from apf.schema import Config
from apf.settings import CountOrNone, settings


@settings
class RelabelConfig:
    """What the command is given; the comments in `conf/relabel.yaml` say what for."""

    run: Path
    plan: CountOrNone
    labels: str
    reason: str


@settings
class KeptDomain:
    """What a correction needs of a run's config."""

    domain: Domain


def work(cfg: DictConfig) -> None:
    """Record the correction; the tables follow at once, what was learned since at the next resume."""
    if "labels" in cfg and isinstance(cfg.labels, int):
        cfg.labels = str(cfg.labels)
    config = build(cfg, RelabelConfig)
    for name in (CONFIG, STATE, JOURNAL):
        if not (config.run / name).exists():
            raise InputError(f"run={config.run}: no run there; give a directory that holds {name}")
    shut_off(config.run)
    with locked(config.run):
        domain = domain_of(config.run)
        check_objects(config.run, domain)
        store = Store(config.run, domain)
        if store.journal.notice:
            print(store.journal.notice, file=sys.stderr)
        try:
            old = store.proposal(config.plan).labels or ""
            new = checked(config.labels, len(old))
            if new == old:
                raise InputError(f"labels={new}: plan {config.plan} has these labels already")
            reopen(config.run)  # first: a kill in between must not leave a correction that a finished run ignores
            store.correct(config.plan, new, config.reason)
            store.export()
        finally:
            store.close()
    print(f"plan {config.plan}: {old} is now {new}")
    print(f"learn again what depended on it: python -m apf.main resume={shlex.quote(str(config.run))}")


def domain_of(run: Path) -> Domain:
    """The domain that a run directory's config describes, with the objects that are kept there."""
    kept = OmegaConf.create(as_literal({"domain": kept_config(run, Config.__dataclass_fields__)["domain"]}))
    try:
        return build(kept, KeptDomain).domain.kept_in(run)
    except InputError as error:
        raise InputError(f"{run / CONFIG}: {error}") from None


def checked(labels: str, length: int) -> str:
    """The labels of `length` prefixes, those left out after the first 0 added. Raises InputError if they are none."""
    right = f"it must be {length} characters, 1 for each prefix that stood, then one 0, then - to the end"
    padded = labels.ljust(length, "-") if "0" in labels else labels
    if len(padded) != length or set(padded) - set(VALUE):
        raise InputError(f"labels is {labels}; {right}")
    if not are_labels(np.array([VALUE[symbol] for symbol in padded])):
        raise InputError(f"labels is {labels}; {right}")
    return padded
