"""Finished runs as tables: finds run directories, and labels groups of runs by the keys in which they differ."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from apf.config.values import NO_EFFECT, flatten, identity
from apf.errors import InputError
from apf.report.figures import Words
from apf.rundir.kept import Summary, read_config, read_state

NOT_A_GROUP = ("seed",)
"""Keys by which runs of one group may differ."""
NO_NAME = (*NO_EFFECT, "experiment", "with_world")
"""Config groups whose choice does not change a run's results, or repeats other keys."""
ASKED = ("predictor", "planner", "task", "evaluation", "domain.evaluation", "domain._target_")
"""Beginnings of the keys that count in a run which does not learn."""
WHEN = ("evaluation.every", "evaluation.also")
"""Keys of these that do not count, since such a run is evaluated once."""


@dataclass(frozen=True)
class Run:
    """A run directory: its plain config, the chosen option of each config group, and the words for figures."""

    directory: Path
    config: dict[str, Any]
    choices: dict[str, Any]
    words: Words

    @property
    def learns(self) -> bool:
        """Does the run learn what feasibility is? Other runs are asked once, before any plan is labelled."""
        return str(self.choices.get("predictor", "learned")) == "learned"

    def table(self, name: str) -> pd.DataFrame:
        """The parquet table of that name. Raises InputError if it cannot be read."""
        path = self.directory / f"{name}.parquet"
        try:
            return pd.read_parquet(path)
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: cannot be read: {str(error).splitlines()[0]}") from None


def find_runs(directories: Sequence[Path]) -> tuple[list[Run], list[Path]]:
    """The finished runs in and below the directories, and the directories of those that have not finished.

    Raises InputError if a directory does not exist or holds no finished run.
    """
    finished, unfinished = {}, []
    for top in directories:
        if not top.is_dir():
            raise InputError(f"{top}: no such directory; give a run directory or one that holds runs")
        for path in sorted(top.rglob("run.yaml")):
            state = read_state(path.parent, Summary)
            if state["finished"]:
                config = read_config(path.parent)
                finished[path.parent.resolve()] = Run(path.parent, config, state["choices"], words_of(state))
            else:
                unfinished.append(path.parent)
    if not finished:
        hint = f"; {len(unfinished)} there have not finished" if unfinished else ""
        raise InputError(f"{', '.join(map(str, directories))}: no finished run found{hint}")
    return list(finished.values()), unfinished


def words_of(state: Mapping[str, Any]) -> Words:
    """The words for a run's figures, from its `run.yaml`."""
    return Words(state["words"]["plan"], state["words"]["object"], state["titles"])


def label_runs(runs: Sequence[Run]) -> list[str]:
    """For each run, what sets its group apart: runs that differ by their seed alone share a label.

    Where the choice of a config group differs, its name stands for all keys of the group that follow from it. Runs that
    do not learn are compared with their like alone, and labelled by their predictor first.
    """
    if len({run.learns for run in runs}) == 1:
        return _labels(runs)
    labels = {learns: iter(_labels([run for run in runs if run.learns == learns])) for learns in (True, False)}
    return [next(labels[run.learns]) for run in runs]


def _labels(runs: Sequence[Run]) -> list[str]:
    """The labels of runs that all learn, or of which none does."""
    groups = sorted({group for run in runs for group in run.choices if _owner(group) not in NO_NAME})
    flats = [flatten(identity(run.config)) for run in runs]
    chosen = [g for g in groups if _varies([str(run.choices.get(g)) for run in runs])]
    keys = sorted({key for flat in flats for key in flat if key not in NOT_A_GROUP and not _follows(key, flats)})
    if not runs[0].learns:
        others = [group for group in chosen if group != "predictor" and _owner(group).startswith((*ASKED, "domain"))]
        chosen = ["predictor", *others]
        keys = [key for key in keys if key.startswith(ASKED) and key not in WHEN]
    differing = [key for key in keys if _varies_within(key, flats, runs, [_owner(g) for g in chosen], chosen)]
    labels = []
    for run, flat in zip(runs, flats, strict=True):
        parts = [_show(run.choices.get(group)) for group in chosen]
        parts += [f"{key}={_show(flat.get(key))}" for key in differing]
        labels.append(", ".join(parts) or _show(run.choices.get("sampler")))
    return labels


def gather(runs: Sequence[Run], name: str) -> pd.DataFrame:
    """One table of all runs, with columns `run` (a number) and `group` (the label) added in front."""
    parts = []
    for number, (run, label) in enumerate(zip(runs, label_runs(runs), strict=True)):
        part = run.table(name)
        part.insert(0, "group", label)
        part.insert(0, "run", number)
        parts.append(part)
    return pd.concat(parts, ignore_index=True)


def _owner(group: str) -> str:
    """The config key that a group fills.

    `model` for model, `evaluation.worlds.noisy` for world@evaluation.worlds.noisy.
    """
    return group.rpartition("@")[2]


def _varies(values: Sequence[Any]) -> bool:
    return len({_show(value) for value in values}) > 1


def _follows(key: str, flats: Sequence[dict]) -> bool:
    """Is this another seed, which follows from the run's: one for each seed, and the same in all runs of that seed?"""
    pairs = {(flat.get("seed"), flat.get(key)) for flat in flats} if key.endswith(".seed") else set()
    seeds, values = {seed for seed, _ in pairs}, {value for _, value in pairs}
    return len(seeds) > 1 and len(pairs) == len(seeds) == len(values)


def _varies_within(
    key: str, flats: Sequence[dict], runs: Sequence[Run], owners: Sequence[str], chosen: Sequence[str]
) -> bool:
    """Does a key differ between runs, other than by the choice of the group that it belongs to?"""
    group = next((g for g, owner in zip(chosen, owners, strict=True) if key.startswith(f"{owner}.")), None)
    if group is None:
        return _varies([flat.get(key) for flat in flats])
    options: dict[str, list[Any]] = {}
    for flat, run in zip(flats, runs, strict=True):
        options.setdefault(str(run.choices.get(group)), []).append(flat.get(key))
    return any(_varies(values) for values in options.values())


def _show(value: Any) -> str:
    """As one would write it on the command line; a list with + between its values. 1.0 is 1."""
    if isinstance(value, list):
        return "+".join(map(_show, value))
    if isinstance(value, float) and value.is_integer():
        value = int(value)  # 40.0 is 40, as another version of the config may have it
    return {"None": "null", "True": "true", "False": "false"}.get(str(value), str(value))
