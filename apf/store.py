"""The run directory: the one source of truth about a run.

config.yaml       the resolved config
run.yaml          name, choices, versions, state, wall time
journal.sqlite    every plan proposed and every label, in the order they came, and the evaluations
weights/          step_0010.safetensors: the ensemble at each evaluated step
towers.parquet, regret.parquet, accuracy.parquet    the journal as tables
"""

import sqlite3
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from apf.acquisition import Scored
from apf.data import Labelled
from apf.errors import InputError
from apf.tables import write_table
from apf.towers import TowerDomain

SCHEMA = """
create table if not exists towers (
    id integer primary key,       -- order of execution, from 0
    step integer not null,        -- 0: initial data; n: acquisition n
    split text not null,          -- train or validation
    score real,                   -- acquisition score; null for initial plans
    plan text not null,
    labels text,                  -- one character per prefix: 1 stood, 0 fell, - not attempted; null: not executed yet
    labelled_at text
) strict;
create table if not exists evaluations (step integer primary key) strict;
create table if not exists regret (
    step integer, towers integer, task text, problem integer, value real, best_value real, regret real, feasible integer
) strict;
create table if not exists accuracy (step integer, towers integer, length integer, accuracy real, n integer) strict;
"""

SYMBOL = {1: "1", 0: "0", -1: "-"}
VALUE = {symbol: label for label, symbol in SYMBOL.items()}


class Store:
    """Reads and writes one run directory. A label is on disk before `record` returns."""

    def __init__(self, directory: Path, domain: TowerDomain) -> None:
        self.directory = directory
        self.domain = domain
        (directory / "weights").mkdir(parents=True, exist_ok=True)
        self._db = sqlite3.connect(directory / "journal.sqlite", isolation_level=None)
        self._db.execute("pragma synchronous = full")
        self._db.executescript(SCHEMA)

    def close(self) -> None:
        """Release the journal."""
        self._db.close()

    # -- plans and labels ---------------------------------------------------------------------------------------

    def planned(self, step: int) -> bool:
        """Have the plans of this step been chosen?"""
        return self._db.execute("select count(*) from towers where step = ?", (step,)).fetchone()[0] > 0

    def plan(self, step: int, scored: Sequence[Scored], splits: Sequence[str]) -> None:
        """Record what will be executed in this step, all or nothing."""
        first = self._db.execute("select coalesce(max(id) + 1, 0) from towers").fetchone()[0]
        rows = [
            (first + i, step, split, None if np.isnan(s.score) else s.score, self.domain.encode(s.plan)[0])
            for i, (s, split) in enumerate(zip(scored, splits, strict=True))
        ]
        self._db.execute("begin immediate")
        self._db.executemany("insert into towers (id, step, split, score, plan) values (?, ?, ?, ?, ?)", rows)
        self._db.execute("commit")

    def pending(self, step: int) -> list[tuple[int, Any]]:
        """(id, plan) of each plan of this step that has not been executed yet."""
        rows = self._db.execute("select id, plan from towers where step = ? and labels is null order by id", (step,))
        return [(number, self.domain.decode([plan])) for number, plan in rows.fetchall()]

    def record(self, number: int, labels: np.ndarray) -> None:
        """Make the labels [K] of a plan durable."""
        text = "".join(SYMBOL[int(label)] for label in labels)
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        self._db.execute("update towers set labels = ?, labelled_at = ? where id = ?", (text, now, number))

    def labelled(self, split: str | None = None, until: int | None = None) -> list[Labelled]:
        """All labelled plans of a split (or of both), up to a step, one batch per length, oldest first."""
        rows = self._db.execute(
            "select plan, labels from towers where labels is not null and (? is null or split = ?) "
            "and (? is null or step <= ?) order by id",
            (split, split, until, until),
        ).fetchall()
        by_length: dict[int, list[tuple[str, str]]] = {}
        for plan, labels in rows:
            by_length.setdefault(len(labels), []).append((plan, labels))
        return [
            Labelled(
                self.domain.decode([plan for plan, _ in group]),
                np.array([[VALUE[symbol] for symbol in labels] for _, labels in group], np.int8),
            )
            for _, group in sorted(by_length.items())
        ]

    def executed(self, step: int) -> tuple[np.ndarray, np.ndarray]:
        """Of this step's plans: did the whole plan succeed [n] bool, and the acquisition scores [n]."""
        rows = self._db.execute(
            "select labels, score from towers where step = ? and labels is not null order by id", (step,)
        ).fetchall()
        return (
            np.array([set(labels) == {"1"} for labels, _ in rows], bool),
            np.array([np.nan if score is None else score for _, score in rows], float),
        )

    def count(self, until: int) -> int:
        """Labelled plans up to a step."""
        query = "select count(*) from towers where labels is not null and step <= ?"
        return self._db.execute(query, (until,)).fetchone()[0]

    # -- evaluations --------------------------------------------------------------------------------------------

    def evaluated(self, step: int) -> bool:
        """Has this step been evaluated?"""
        return self._db.execute("select 1 from evaluations where step = ?", (step,)).fetchone() is not None

    def record_evaluation(self, step: int, regret: pd.DataFrame, accuracy: pd.DataFrame) -> None:
        """Make an evaluation durable, and write the tables anew."""
        self._db.execute("begin immediate")
        for name, table in (("regret", regret), ("accuracy", accuracy)):
            rows = table.astype(object).where(table.notna(), None).to_numpy().tolist()
            marks = ", ".join("?" * len(table.columns))
            self._db.executemany(f"insert into {name} ({', '.join(table.columns)}) values ({marks})", rows)
        self._db.execute("insert into evaluations values (?)", (step,))
        self._db.execute("commit")
        self.export()

    def weights(self, step: int) -> Path:
        """Where the ensemble of this step is kept."""
        return self.directory / "weights" / f"step_{step:04d}.safetensors"

    # -- tables -------------------------------------------------------------------------------------------------

    def regret(self) -> pd.DataFrame:
        """All evaluations so far, in the columns of `regret.parquet`."""
        table = pd.read_sql_query("select * from regret order by step, rowid", self._db)
        return table.astype({"feasible": bool, "regret": float})

    def accuracy(self) -> pd.DataFrame:
        """All evaluations so far, in the columns of `accuracy.parquet`."""
        return pd.read_sql_query("select * from accuracy order by step, rowid", self._db)

    def towers(self) -> pd.DataFrame:
        """One row per placement of every labelled plan: what came of it, and the columns of a tower file."""
        rows = self._db.execute(
            "select id, step, split, score, plan, labels from towers where labels is not null order by id"
        ).fetchall()
        parts = [self.domain.table(self.domain.random_plans(1, 0, np.random.default_rng()))] if not rows else []
        for part in parts:
            for place, column in enumerate(("step", "split", "score", "label"), start=2):
                part.insert(place, column, [])
        for number, step, split, score, plan, labels in rows:
            part = self.domain.table(self.domain.decode([plan]))
            part["tower"] = number
            label = pd.Series([None if s == "-" else int(s) for s in labels], dtype="Int8")
            part.insert(2, "step", step)
            part.insert(3, "split", split)
            part.insert(4, "score", np.nan if score is None else score)
            part.insert(5, "label", label)
            parts.append(part)
        return pd.concat(parts, ignore_index=True)

    def export(self) -> None:
        """Write towers.parquet, regret.parquet and accuracy.parquet, each replaced in one step."""
        for name, table in (("towers", self.towers()), ("regret", self.regret()), ("accuracy", self.accuracy())):
            write_table(table, self.directory / f"{name}.parquet")


def write_yaml(path: Path, content: dict) -> None:
    """Write a YAML file, replacing it in one step."""
    half = path.with_name(path.name + ".part")
    half.write_text(yaml.safe_dump(content, sort_keys=False, allow_unicode=True))
    half.replace(path)


def read_yaml(path: Path) -> dict:
    """Raises InputError if there is no such file, or it is no YAML mapping."""
    try:
        content = yaml.safe_load(path.read_text())
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except yaml.YAMLError as error:
        raise InputError(f"{path}: not a YAML file: {str(error).splitlines()[0]}") from None
    if not isinstance(content, dict):
        raise InputError(f"{path}: not a YAML mapping")
    return content
