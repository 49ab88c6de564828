"""The run directory: the one source of truth about a run.

config.yaml       the resolved config
run.yaml          name, choices, versions, state, wall time
journal.jsonl     every plan proposed, every label, correction, training and evaluation, in the order they came
weights/          step_0010.safetensors: the ensemble at each evaluated step
towers.parquet, regret.parquet, accuracy.parquet    the journal as tables
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from apf.acquisition import Scored
from apf.data import Labelled
from apf.errors import InputError
from apf.files import checksum, make_folder, read_yaml, remove_unfinished, replacing
from apf.journal import HEADER, End, Journal, Record
from apf.planning.evaluation import ACCURACY_COLUMNS, REGRET_COLUMNS
from apf.records import check
from apf.tables import write_table
from apf.towers import TowerDomain

SYMBOL = {1: "1", 0: "0", -1: "-"}
"""How the journal writes labels, one character for each prefix: stood, fell, not attempted."""
VALUE = {symbol: label for label, symbol in SYMBOL.items()}

DTYPES = {
    **dict.fromkeys(("step", "towers", "problem", "length", "n"), "int64"),
    **dict.fromkeys(("value", "best_value", "regret", "accuracy", "auc"), "float64"),
    "feasible": "bool",
}


@dataclass
class Tower:
    """What is known of a proposed plan. labels: None until it is executed. score: None for initial plans.
    report: what the world told of its execution, beside the labels, if anything.

    corrected: its labels are not those first recorded. outdated: it was chosen by a model that had learned from a
    label corrected since.
    """

    number: int
    step: int
    split: str
    score: float | None
    plan: dict[str, Any]
    labels: str | None = None
    corrected: bool = False
    outdated: bool = False
    report: dict[str, Any] | None = None

    @property
    def note(self) -> str | None:
        """As `towers.parquet` says it."""
        notes = ["corrected"] * self.corrected + ["chosen before a correction"] * self.outdated
        return "; ".join(notes) or None


class Store:
    """Reads and writes one run directory. A label is on disk before `record` returns."""

    def __init__(self, directory: Path, domain: TowerDomain) -> None:
        """Raises InputError if the journal is damaged, another run's, or cannot be written."""
        self.directory = directory
        self.domain = domain
        state = read_yaml(directory / "run.yaml") if (directory / "run.yaml").exists() else {}
        known = state.get("journal")
        self.journal = Journal(directory / "journal.jsonl", state.get("id", ""), End(**known) if known else None)
        make_folder(directory / "weights")
        for folder in (directory, directory / "weights"):
            remove_unfinished(folder)
        self.corrections = 0
        self._towers: list[Tower] = []
        self._trainings: dict[int, dict[str, float]] = {}
        self._evaluations: dict[int, Record] = {}
        for number, record in enumerate(self.journal.records, HEADER + 1):
            try:
                check(record, self._towers, domain.encoded_length)
            except ValueError as error:
                self.close()
                line = f"line {number} ({record.get('kind')})"
                raise InputError(f"{self.journal.path} is damaged: {line} cannot be used: {error}") from None
            self._apply(record)

    def close(self) -> None:
        """Release the journal."""
        self.journal.close()

    def _append(self, kind: str, **content: Any) -> None:
        """Make a record durable, and take it into account. Raises ValueError if it could not be read back."""
        check({"kind": kind, **content}, self._towers, self.domain.encoded_length)
        self._apply(self.journal.append(kind, **content))

    def _apply(self, record: Record) -> None:
        """Take a record into account. The journal alone, read from its beginning, gives the state."""
        match record["kind"]:
            case "plans":
                first = len(self._towers)
                for number, plan in enumerate(record["plans"], first):
                    self._towers.append(Tower(number, record["step"], **plan))
            case "label":
                self._towers[record["tower"]].labels = record["labels"]
                self._towers[record["tower"]].report = record.get("report")
            case "correction":
                self._correct(self._towers[record["tower"]], record["labels"])
            case "training":
                self._trainings[record["step"]] = record["losses"]
            case "evaluation":
                self._evaluations[record["step"]] = record

    def _correct(self, tower: Tower, labels: str) -> None:
        """What was learned from the old labels is forgotten; plans that were chosen by it are marked."""
        self.corrections += 1
        tower.labels, tower.corrected = labels, True
        for other in self._towers:
            other.outdated |= other.step > tower.step and other.score is not None
        for learned in (self._trainings, self._evaluations):
            for step in [step for step in learned if step >= tower.step]:
                del learned[step]

    # -- plans and labels ---------------------------------------------------------------------------------------

    def planned(self, step: int) -> bool:
        """Have the plans of this step been chosen?"""
        return any(tower.step == step for tower in self._towers)

    def plan(self, step: int, scored: Sequence[Scored], splits: Sequence[str]) -> None:
        """Record what will be executed in this step, all or nothing."""
        plans = [
            {"split": split, "score": None if np.isnan(s.score) else s.score, "plan": self.domain.encode(s.plan)[0]}
            for s, split in zip(scored, splits, strict=True)
        ]
        self._append("plans", step=step, plans=plans)

    def pending(self, step: int) -> list[tuple[int, Any]]:
        """(number, plan) of each plan of this step that has not been executed yet."""
        pending = [t for t in self._towers if t.step == step and t.labels is None]
        return [(tower.number, self.domain.decode([tower.plan])) for tower in pending]

    def record(self, number: int, labels: np.ndarray, report: dict[str, Any] | None = None) -> None:
        """Make the labels [K] of a plan durable, and what the world reported."""
        symbols = "".join(SYMBOL[int(label)] for label in labels)
        self._append("label", tower=number, labels=symbols, **({} if report is None else {"report": report}))

    @property
    def last_report(self) -> dict[str, Any] | None:
        """What the world told of the last plan that it told anything of: how it was left."""
        return next((tower.report for tower in reversed(self._towers) if tower.report is not None), None)

    def reports(self, step: int | None = None) -> dict[int, dict[str, Any]]:
        """What the world told, by the number of the plan, of all plans or of those of a step."""
        towers = [tower for tower in self._towers if step in (None, tower.step)]
        return {tower.number: tower.report for tower in towers if tower.report is not None}

    def tower(self, number: int) -> Tower:
        """An executed plan. Raises InputError if there is none of that number."""
        if not 0 <= number < len(self._towers) or self._towers[number].labels is None:
            have = self._select(None)
            numbers = f"towers {have[0].number} to {have[-1].number} have" if have else "none has"
            raise InputError(f"tower is {number}; {numbers} labels in {self.directory}")
        return self._towers[number]

    def correct(self, number: int, labels: str, reason: str) -> None:
        """Make other labels of an executed plan durable; the journal keeps the old ones too."""
        self._append("correction", tower=number, old=self.tower(number).labels, labels=labels, reason=reason)

    def labelled(self, split: str | None = None, until: int | None = None) -> list[Labelled]:
        """All labelled plans of a split (or of both), up to a step, one batch per length, oldest first."""
        by_length: dict[int, list[tuple[dict[str, Any], str]]] = {}
        for tower in self._select(until):
            if split in (None, tower.split):
                by_length.setdefault(len(tower.labels or ""), []).append((tower.plan, tower.labels or ""))
        return [
            Labelled(
                self.domain.decode([plan for plan, _ in group]),
                np.array([[VALUE[symbol] for symbol in labels] for _, labels in group], np.int8),
            )
            for _, group in sorted(by_length.items())
        ]

    def executed(self, step: int) -> tuple[np.ndarray, np.ndarray]:
        """Of this step's plans: did the whole plan succeed [n] bool, and the acquisition scores [n]."""
        towers = [tower for tower in self._select(step) if tower.step == step]
        return (
            np.array([set(tower.labels or "") == {"1"} for tower in towers], bool),
            np.array([np.nan if tower.score is None else tower.score for tower in towers], float),
        )

    def count(self, until: int) -> int:
        """Labelled plans up to a step."""
        return len(self._select(until))

    def _select(self, until: int | None) -> list[Tower]:
        return [t for t in self._towers if t.labels is not None and (until is None or t.step <= until)]

    # -- what was learned ---------------------------------------------------------------------------------------

    def training(self, step: int) -> Mapping[str, float] | None:
        """The losses of this step's training, if it was done."""
        return self._trainings.get(step)

    def record_training(self, step: int, losses: Mapping[str, float]) -> None:
        """Make the losses of a training durable; those of the same training done again are the same."""
        if self._trainings.get(step) != losses:
            self._append("training", step=step, losses=dict(losses))

    def evaluated(self, step: int) -> bool:
        """Has this step been evaluated, and does what was kept of it still hold?"""
        done = self._evaluations.get(step)
        return done is not None and (done["weights"] is None or done["weights"] == checksum(self.weights(step)))

    def record_evaluation(
        self, step: int, regret: pd.DataFrame, accuracy: pd.DataFrame, save: Callable[[Path], None] | None = None
    ) -> None:
        """Make an evaluation durable with the weights that `save` writes, and write the tables anew."""
        weights = self.weights(step)
        if save:
            with replacing(weights) as half:
                save(half)
        rows = {
            name: table.astype(object).where(table.notna(), None).to_numpy().tolist()
            for name, table in (("regret", regret), ("accuracy", accuracy))
        }
        self._append("evaluation", step=step, **rows, weights=checksum(weights) if save else None)
        self.export()

    def weights(self, step: int) -> Path:
        """Where the ensemble of this step is kept."""
        return self.directory / "weights" / f"step_{step:04d}.safetensors"

    # -- tables -------------------------------------------------------------------------------------------------

    def regret(self) -> pd.DataFrame:
        """All evaluations so far, in the columns of `regret.parquet`."""
        return self._evaluation_table("regret", REGRET_COLUMNS)

    def accuracy(self) -> pd.DataFrame:
        """All evaluations so far, in the columns of `accuracy.parquet`."""
        return self._evaluation_table("accuracy", ACCURACY_COLUMNS)

    def _evaluation_table(self, name: str, columns: list[str]) -> pd.DataFrame:
        rows = [row for _, record in sorted(self._evaluations.items()) for row in record[name]]
        table = pd.DataFrame(rows, columns=columns)
        return table.astype({column: dtype for column, dtype in DTYPES.items() if column in columns})

    def towers(self) -> pd.DataFrame:
        """One row per placement of every labelled plan: what came of it, and the columns of a tower file."""
        towers = self._select(None)
        parts = [self.domain.table(self.domain.random_plans(1, 0, np.random.default_rng()))] if not towers else []
        for part in parts:
            for place, column in enumerate(("step", "split", "score", "label", "note"), start=2):
                part.insert(place, column, [])
        for tower in towers:
            part = self.domain.table(self.domain.decode([tower.plan]))
            part["tower"] = tower.number
            label = [None if s == "-" else int(s) for s in tower.labels or ""]
            part.insert(2, "step", tower.step)
            part.insert(3, "split", tower.split)
            part.insert(4, "score", np.nan if tower.score is None else tower.score)
            part.insert(5, "label", pd.Series(label, dtype="Int8"))
            part.insert(6, "note", pd.Series([tower.note] * len(part), dtype="string"))
            parts.append(part)
        return pd.concat(parts, ignore_index=True)

    def export(self) -> None:
        """Write towers.parquet, regret.parquet and accuracy.parquet, each replaced in one step."""
        for name, table in (("towers", self.towers()), ("regret", self.regret()), ("accuracy", self.accuracy())):
            write_table(table, self.directory / f"{name}.parquet")
