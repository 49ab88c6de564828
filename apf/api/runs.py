"""Runs: made, gone on with, and read."""

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch

from apf.api.composed import composed, given
from apf.commands.run import start
from apf.domain import UNOBSERVED, Labelled
from apf.errors import InputError
from apf.models import Ensemble
from apf.rundir.claim import CONFIG, STATE
from apf.rundir.kept import read_config, read_state
from apf.rundir.resume import RESUME, resumed
from apf.schema import Config
from apf.trained import config_of, kept_steps, load_ensemble


class Tables(Mapping[str, pd.DataFrame]):
    """The parquet tables of a directory, by their names without ending. Each is read when it is first asked for."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self._read: dict[str, pd.DataFrame] = {}

    def __getitem__(self, name: str) -> pd.DataFrame:
        if name not in self._read:
            path = self.directory / f"{name}.parquet"
            if not path.is_file():
                raise KeyError(f"{name}; there are {', '.join(self) or 'no tables'}")
            try:
                self._read[name] = pd.read_parquet(path)
            except (OSError, ValueError) as error:
                raise InputError(f"{path}: cannot be read: {str(error).splitlines()[0]}") from None
        return self._read[name]

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(path.stem for path in self.directory.glob("*.parquet")))

    def __len__(self) -> int:
        return len(list(self.directory.glob("*.parquet")))

    def __repr__(self) -> str:
        return f"Tables({', '.join(self)})"


@dataclass(frozen=True)
class Run:
    """A run directory. What is read is kept: load the run again to see what came since."""

    directory: Path

    @cached_property
    def config(self) -> dict[str, Any]:
        """The plain config, as `config.yaml` has it."""
        return read_config(self.directory)

    @property
    def domain_choice(self) -> str:
        """Which option of the config group `domain` was chosen, as in `domain=NAME`."""
        return str(read_state(self.directory)["choices"]["domain"])

    @property
    def finished(self) -> bool:
        """Has the run finished?"""
        return bool(read_state(self.directory)["finished"])

    @cached_property
    def tables(self) -> Tables:
        """The tables of the run: `plans`, `regret`, `accuracy`, `evaluation_plans`, and `world` if there is one."""
        return Tables(self.directory)

    @property
    def steps(self) -> list[int]:
        """The steps of which the run keeps an ensemble, in ascending order; none if the run does not learn."""
        return kept_steps(self.directory)

    @cached_property
    def parts(self) -> Config:
        """The config as objects, e.g. `parts.domain`, with the objects of plans that the run keeps."""
        return config_of(self.directory)

    def model(self, step: int | None = None, odds: float = 1.0, device: str = "cpu") -> Ensemble:
        """The ensemble that the run had trained by a step.

        Args:
            step: One of `steps`; None: the last.
            odds: Factor for the odds of each placement.
            device: Where the networks are to be: auto, cpu, cuda, cuda:1, ...

        Raises:
            InputError: The run keeps no ensemble of this step.
        """
        return load_ensemble(self.directory, step, odds, device)

    @cached_property
    def plans(self) -> list[Labelled]:
        """All plans that were labelled, one batch for each length: plans of the domain's own class, labels [N, K].

        Of a run that is under way, those that `plans.parquet` holds by now.
        """
        path = self.directory / "plans.parquet"
        if not path.is_file():
            return []
        table = self.tables["plans"]
        labels = table["label"].fillna(UNOBSERVED).to_numpy(np.int8)
        rows = table.groupby(self.parts.domain.plan_word, sort=False).indices
        return [
            Labelled(batch.plans, np.array([labels[rows[name]] for name in batch.names], np.int8))
            for batch in sorted(self.parts.domain.read_plans(path), key=lambda batch: batch.plans.length)
        ]


def load_run(directory: str | Path) -> Run:
    """The run in a directory, finished or not. Raises InputError if there is none."""
    directory = Path(directory)
    for name in (CONFIG, STATE):
        if not (directory / name).is_file():
            raise InputError(f"{directory} holds no run: there is no {name} in it")
    return Run(directory)


def run(overrides: Sequence[str] = (), directory: str | Path | None = None) -> Run:
    """Make a run, or go on with it, as `python -m apf.main` does; a run that has finished returns at once.

    Args:
        overrides: As on the command line, e.g. `["+experiment=smoke", "seed=3"]`; or `["resume=DIR"]`.
        directory: The run directory; None: as the config says, a new one below `runs/`.

    Raises:
        InputError: Something is wrong with the config, or the directory holds something else.
        Stopped: The run cannot go on for now, e.g. since a disk is full. Nothing labelled is lost.
    """
    arguments = resumed([*overrides], Config.__dataclass_fields__)
    resuming = arguments[-2:] == ["--config-name", RESUME]
    if resuming:
        name, arguments = RESUME, arguments[:-2]
        if directory is not None:
            raise InputError("directory: leave it out; resume=DIR goes on in DIR")
    else:
        name = "config"
        if directory is not None:
            arguments += given(**{"hydra.run.dir": Path(directory).absolute()})
    threads = torch.get_num_threads()
    try:
        with contextlib.chdir("."), composed(name, arguments) as (cfg, hydra):
            place = Path(hydra.run.dir).absolute()
            start(cfg, hydra, place)
    finally:
        torch.set_num_threads(threads)
    return load_run(place)
