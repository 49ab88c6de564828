"""What the journal holds of evaluations: tables, chosen plans, and executions of an evaluation that is not over."""

from typing import Any, NamedTuple

import pandas as pd

from apf.domain import Domain, Outcome
from apf.rundir.chosen import chosen_table
from apf.rundir.columns import ACCURACY_COLUMNS, DTYPES, REGRET_COLUMNS
from apf.rundir.journal import Record
from apf.rundir.labels import labels_of


class Execution(NamedTuple):
    """Which plan of an evaluation is executed, and where: its step, task and problem, and the name of the world."""

    step: int
    task: str
    problem: int
    world: str


class Evaluations:
    """The evaluations of a run, by their steps."""

    def __init__(self, domain: Domain) -> None:
        self.domain = domain
        self._done: dict[int, Record] = {}
        self._rewards: dict[Execution, Record] = {}
        """Of evaluations that are not over."""

    def apply(self, record: Record) -> None:
        """Take a record of the journal into account: of an evaluation, or of an execution in one."""
        if record["kind"] == "reward":
            self._rewards[Execution(*(record[field] for field in Execution._fields))] = record
            return
        self._done[record["step"]] = record
        self._rewards = {key: reward for key, reward in self._rewards.items() if key.step != record["step"]}

    def forget(self, step: int) -> None:
        """Drop the evaluations from a step on, and executions of any that is not over."""
        self._done = {done: record for done, record in self._done.items() if done < step}
        self._rewards.clear()

    def get(self, step: int) -> Record | None:
        """The record of a step's evaluation; None: there was none."""
        return self._done.get(step)

    def outcome(self, execution: Execution, plan: Any) -> Outcome | None:
        """What came of a chosen plan in an evaluation that is not over; None: this plan was not executed yet."""
        kept = self._rewards.get(execution)
        if kept is None or kept["plan"] != self.domain.encode(plan, evaluation=True)[0]:
            return None
        return Outcome(labels_of(kept["labels"]), kept["report"])

    def regret(self, step: int | None) -> pd.DataFrame:
        """Of all evaluations, or that of a step, in the columns of `regret.parquet`."""
        return self._table("regret", REGRET_COLUMNS, step)

    def accuracy(self, step: int | None) -> pd.DataFrame:
        """Of all evaluations, or that of a step, in the columns of `accuracy.parquet`."""
        return self._table("accuracy", ACCURACY_COLUMNS, step)

    def plans(self) -> pd.DataFrame:
        """All plans that evaluations chose: see `apf.rundir.chosen.chosen_table`."""
        return chosen_table({step: self._done[step]["chosen"] for step in sorted(self._done)}, self.domain)

    def _table(self, name: str, columns: list[str], step: int | None) -> pd.DataFrame:
        steps = sorted(self._done) if step is None else [step]
        rows = [row for step in steps for row in self._done[step][name]]
        table = pd.DataFrame(rows, columns=columns)
        return table.astype({column: dtype for column, dtype in DTYPES.items() if column in columns})
