"""The run directory: the one source of truth about a run.

config.yaml       the resolved config
run.yaml          name, choices, versions, state, wall time
journal.jsonl     every plan proposed, every label, correction, training and evaluation, in the order they came
logs/             12.mcap: what happened in plan 12, if the world logs anything
weights/          step_0010.safetensors: the ensemble at each evaluated step
plans.parquet, regret.parquet, accuracy.parquet, evaluation_plans.parquet
                  the journal as tables, when it has grown by a tenth, and at the end
"""

from bisect import bisect_right, insort
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from apf.domain import UNOBSERVED, Domain, Labelled, Outcome, Scored
from apf.errors import InputError
from apf.rundir.chosen import ChosenPlan
from apf.rundir.claim import LOGS, STATE
from apf.rundir.evaluations import Evaluations, Execution
from apf.rundir.files import checksum, make_folder, remove_unfinished, replacing
from apf.rundir.journal import HEADER, End, Journal, Record
from apf.rundir.kept import read_state
from apf.rundir.labels import labels_of, symbols_of
from apf.rundir.records import check
from apf.rundir.tables import write_table

GROWTH = 1.1
"""An evaluation writes the tables if the number of labelled plans has grown by this factor since the last time. Over a
whole run, the number of written rows then stays in proportion to the rows of the last tables."""


@dataclass
class Proposal:
    """A proposed plan and its records.

    labels: None until the plan is executed. score: None for initial plans. report: the world's report of the execution;
    None: the world reported nothing. corrected: a person has corrected the labels. outdated: the model that chose the
    plan had learned from a label that was corrected later.
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
        """The text in the column `note` of `plans.parquet`; None: nothing to note."""
        notes = ["corrected"] * self.corrected + ["chosen before a correction"] * self.outdated
        return "; ".join(notes) or None


@dataclass
class Batch:
    """All labelled plans of one length, oldest first: what is known of each [N], the plans, their labels [N, K]."""

    plans: Any
    labels: np.ndarray
    proposals: list[Proposal] = field(default_factory=list)


class Store:
    """Reads and writes one run directory. A label is on disk before `record` returns."""

    def __init__(self, directory: Path, domain: Domain) -> None:
        """Raises InputError if the journal is damaged, another run's, or cannot be written."""
        self.directory = directory
        self.domain = domain
        state = read_state(directory) if (directory / STATE).exists() else {}
        known = state.get("journal")
        self.journal = Journal(directory / "journal.jsonl", state.get("id", ""), End(**known) if known else None)
        make_folder(directory / "weights")
        for folder in (directory, directory / "weights"):
            remove_unfinished(folder)
        self.corrections = 0
        self._proposed: list[Proposal] = []
        self._steps: dict[int, list[Proposal]] = {}
        self._labelled: list[Proposal] = []
        """By their numbers."""
        self._labelled_steps: list[int] = []
        """The step of each labelled plan, in ascending order."""
        self._reported: Proposal | None = None
        """The last plan that the world told anything of."""
        self._batches: dict[int, Batch] = {}
        """By length, of the first plans of `_labelled`."""
        self._exported = 0
        """Labelled plans when the tables were last written."""
        self._trainings: dict[int, dict[str, float]] = {}
        self._evaluations = Evaluations(domain)
        for number, record in enumerate(self.journal.records, HEADER + 1):
            try:
                check(record, self._proposed, domain.encoded_length)
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
        check({"kind": kind, **content}, self._proposed, self.domain.encoded_length)
        self._apply(self.journal.append(kind, **content))

    def _apply(self, record: Record) -> None:
        """Take a record into account. The journal alone, read from its beginning, gives the state."""
        match record["kind"]:
            case "plans":
                first = len(self._proposed)
                plans = enumerate(record["plans"], first)
                proposals = [Proposal(number, record["step"], **plan) for number, plan in plans]
                self._proposed += proposals
                self._steps.setdefault(record["step"], []).extend(proposals)
            case "label":
                self._label(self._proposed[record["plan"]], record["labels"], record.get("report"))
            case "correction":
                self._correct(self._proposed[record["plan"]], record["labels"])
            case "training":
                self._trainings[record["step"]] = record["losses"]
            case "reward" | "evaluation":
                self._evaluations.apply(record)

    def _label(self, proposal: Proposal, labels: str, report: dict[str, Any] | None) -> None:
        proposal.labels, proposal.report = labels, report
        if self._labelled and self._labelled[-1].number > proposal.number:
            self._batches.clear()
        insort(self._labelled, proposal, key=attrgetter("number"))
        insort(self._labelled_steps, proposal.step)
        if report is not None and (self._reported is None or self._reported.number < proposal.number):
            self._reported = proposal

    def _correct(self, proposal: Proposal, labels: str) -> None:
        """What was learned from the old labels is forgotten; plans that were chosen by it are marked."""
        self.corrections += 1
        proposal.labels, proposal.corrected = labels, True
        self._batches.clear()
        for other in self._proposed:
            other.outdated |= other.step > proposal.step and other.score is not None
        self._trainings = {step: losses for step, losses in self._trainings.items() if step < proposal.step}
        self._evaluations.forget(proposal.step)

    # -- plans and labels ---------------------------------------------------------------------------------------

    def planned(self, step: int) -> bool:
        """Have the plans of this step been chosen?"""
        return step in self._steps

    def plan(self, step: int, scored: Sequence[Scored], splits: Sequence[str]) -> None:
        """Record what will be executed in this step, all or nothing.

        Args:
            step: Of the run.
            scored: The plans and their scores.
            splits: Of each plan: train or validation.
        """
        plans = [
            {"split": split, "score": None if np.isnan(s.score) else s.score, "plan": self.domain.encode(s.plan)[0]}
            for s, split in zip(scored, splits, strict=True)
        ]
        self._append("plans", step=step, plans=plans)

    def pending(self, step: int) -> list[tuple[int, Any]]:
        """(number, plan) of each plan of this step that has not been executed yet."""
        pending = [proposal for proposal in self._steps.get(step, []) if proposal.labels is None]
        return [(proposal.number, self.domain.decode([proposal.plan])) for proposal in pending]

    def record(self, number: int, labels: np.ndarray, report: dict[str, Any] | None = None) -> None:
        """Make the labels [K] of a plan durable, and what the world reported.

        Args:
            number: Of the plan.
            labels: [K] 1, 0 or -1.
            report: What the world told besides, if anything.
        """
        self._append("label", plan=number, labels=symbols_of(labels), **({} if report is None else {"report": report}))

    @property
    def last_report(self) -> dict[str, Any] | None:
        """What the world told of the last plan that it told anything of: how it was left."""
        return self._reported.report if self._reported else None

    def reports(self, step: int | None = None) -> dict[int, dict[str, Any]]:
        """What the world told, by the number of the plan, of all plans or of those of a step."""
        proposals = self._proposed if step is None else self._steps.get(step, [])
        return {proposal.number: proposal.report for proposal in proposals if proposal.report is not None}

    def proposal(self, number: int) -> Proposal:
        """An executed plan. Raises InputError if there is none of that number."""
        if not 0 <= number < len(self._proposed) or self._proposed[number].labels is None:
            have = self._labelled
            numbers = f"plans {have[0].number} to {have[-1].number} have" if have else "none has"
            raise InputError(f"plan is {number}; {numbers} labels in {self.directory}")
        return self._proposed[number]

    def correct(self, number: int, labels: str, reason: str) -> None:
        """Make other labels of an executed plan durable; the journal keeps the old ones too.

        Args:
            number: Of the plan.
            labels: A character for each prefix: 1, 0 or -.
            reason: Kept in the journal.
        """
        self._append("correction", plan=number, old=self.proposal(number).labels, labels=labels, reason=reason)

    def labelled(self, split: str | None = None, until: int | None = None) -> list[Labelled]:
        """All labelled plans of a split (or of both), up to a step, one batch per length, oldest first."""
        labelled = []
        for batch in self._decoded():
            rows = [
                row
                for row, proposal in enumerate(batch.proposals)
                if split in (None, proposal.split) and (until is None or proposal.step <= until)
            ]
            if rows:
                labelled.append(Labelled(batch.plans[np.array(rows)], batch.labels[rows]))
        return labelled

    def _decoded(self) -> list[Batch]:
        """All labelled plans, one batch per length; only those labelled since the last call are decoded."""
        known = sum(len(batch.proposals) for batch in self._batches.values())
        by_length: dict[int, list[Proposal]] = {}
        for proposal in self._labelled[known:]:
            by_length.setdefault(len(proposal.labels or ""), []).append(proposal)
        for length, proposals in by_length.items():
            plans = self.domain.decode([proposal.plan for proposal in proposals])
            labels = np.array([labels_of(proposal.labels) for proposal in proposals])
            if before := self._batches.get(length):
                plans = self.domain.concatenate([before.plans, plans])
                labels, proposals = np.concatenate([before.labels, labels]), before.proposals + proposals
            self._batches[length] = Batch(plans, labels, proposals)
        return [batch for _, batch in sorted(self._batches.items())]

    def executed(self, step: int) -> tuple[np.ndarray, np.ndarray]:
        """Of this step's plans: did the whole plan succeed [n] bool, and the acquisition scores [n]."""
        proposals = [proposal for proposal in self._steps.get(step, []) if proposal.labels is not None]
        return (
            np.array([set(proposal.labels or "") == {"1"} for proposal in proposals], bool),
            np.array([np.nan if proposal.score is None else proposal.score for proposal in proposals], float),
        )

    def count(self, until: int) -> int:
        """Labelled plans up to a step."""
        return bisect_right(self._labelled_steps, until)

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

    def outcome(self, execution: Execution, plan: Any) -> Outcome | None:
        """What came of a chosen plan in an evaluation that was stopped; None: this plan was not executed yet."""
        return self._evaluations.outcome(execution, plan)

    def record_outcome(self, execution: Execution, plan: Any, outcome: Outcome) -> None:
        """Make durable what came of a chosen plan, if the world reported on it: such a world is slow.

        Args:
            execution: Of which evaluation, and where.
            plan: A batch of one.
            outcome: What came of it.
        """
        if outcome.report is None:
            return
        encoded = self.domain.encode(plan, evaluation=True)[0]
        labels = symbols_of(outcome.labels)
        self._append("reward", **execution._asdict(), plan=encoded, labels=labels, report=outcome.report)

    def log_of(self, plan: int | Execution) -> Path:
        """Where a world may log what happens in a plan of the experiment, by its number, or of an evaluation."""
        if isinstance(plan, int):
            return self.directory / LOGS / f"{plan}"
        return self.directory / LOGS / f"step_{plan.step}_{plan.task}_{plan.problem}_{plan.world}"

    def record_evaluation(
        self,
        step: int,
        regret: pd.DataFrame,
        accuracy: pd.DataFrame,
        chosen: Sequence[ChosenPlan],
        save: Callable[[Path], None] | None = None,
    ) -> None:
        """Make an evaluation durable with the weights that `save` writes; write the tables if they lag far behind.

        Args:
            step: Of the run.
            regret: Rows of regret.parquet.
            accuracy: Rows of accuracy.parquet.
            chosen: The plans that were chosen.
            save: Writes the weights to a path; None: there are none.
        """
        weights = self.weights(step)
        if save:
            with replacing(weights) as half:
                save(half)
        rows = {
            name: table.astype(object).where(table.notna(), None).to_numpy().tolist()
            for name, table in (("regret", regret), ("accuracy", accuracy))
        }
        plans = [each.encoded(self.domain) for each in chosen]
        self._append("evaluation", step=step, **rows, chosen=plans, weights=checksum(weights) if save else None)
        if len(self._labelled) >= GROWTH * self._exported:
            self.export()

    def weights(self, step: int) -> Path:
        """Where the ensemble of this step is kept."""
        return self.directory / "weights" / f"step_{step:04d}.safetensors"

    # -- tables -------------------------------------------------------------------------------------------------

    def regret(self, step: int | None = None) -> pd.DataFrame:
        """All evaluations so far, or that of a step, in the columns of `regret.parquet`."""
        return self._evaluations.regret(step)

    def accuracy(self, step: int | None = None) -> pd.DataFrame:
        """All evaluations so far, or that of a step, in the columns of `accuracy.parquet`."""
        return self._evaluations.accuracy(step)

    def evaluation_plans(self) -> pd.DataFrame:
        """All plans that evaluations chose: see `apf.rundir.chosen.chosen_table`."""
        return self._evaluations.plans()

    def plans(self) -> pd.DataFrame:
        """One row per placement of every labelled plan: what came of it, and the columns of the domain's files."""
        nothing = Batch(self.domain.random_plans(1, 0, np.random.default_rng()), np.empty((0, 1), np.int8))
        parts = [self._plan_table(batch) for batch in self._decoded() or [nothing]]
        order = np.argsort(np.concatenate([part[self.domain.plan_word] for part in parts]), kind="stable")
        return pd.concat(parts, ignore_index=True).iloc[order].reset_index(drop=True)

    def _plan_table(self, batch: Batch) -> pd.DataFrame:
        """The rows of plans of one length."""
        table, proposals = self.domain.table(batch.plans), batch.proposals
        row = table[self.domain.plan_word].to_numpy()

        def repeated(values: list[Any], dtype: str) -> pd.Series:
            return pd.Series(values, dtype=dtype).take(row).reset_index(drop=True)

        labels = pd.Series(batch.labels.ravel(), dtype="Int8")
        columns = {
            "step": repeated([proposal.step for proposal in proposals], "int64"),
            "split": repeated([proposal.split for proposal in proposals], "str"),
            "score": repeated([np.nan if p.score is None else p.score for p in proposals], "float64"),
            "label": labels.mask(labels == UNOBSERVED),
            "note": repeated([proposal.note for proposal in proposals], "string"),
        }
        for place, (name, values) in enumerate(columns.items(), start=2):
            table.insert(place, name, values)
        table[self.domain.plan_word] = np.array([proposal.number for proposal in proposals], np.int64)[row]
        return table

    def export(self) -> None:
        """Write all tables, each replaced in one step."""
        tables = {
            "plans": self.plans(),
            "regret": self.regret(),
            "accuracy": self.accuracy(),
            "evaluation_plans": self.evaluation_plans(),
        }
        for name, table in tables.items():
            write_table(table, self.directory / f"{name}.parquet")
        self._exported = len(self._labelled)
