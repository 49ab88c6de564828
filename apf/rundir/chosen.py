"""Plans that an evaluation chose, as the journal and `evaluation_plans.parquet` hold them."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from apf.domain import UNOBSERVED, Domain, Outcome
from apf.rundir.labels import labels_of, symbols_of

KEYS = {"task", "problem", "plan", "value", "chances", "outcomes"}
"""Of a chosen plan in the journal."""
COLUMNS = {
    "step": "int64",
    "task": "str",
    "problem": "int64",
    "world": "str",
    "value": "float64",
    "chance": "float64",
    "label": "Int8",
    "report": "string",
}
"""Of `evaluation_plans.parquet`, besides those of the domain's files."""


@dataclass(frozen=True, eq=False)
class ChosenPlan:
    """The plan that was chosen for one task in one problem, and what came of it.

    plan: A batch of one. value: What the plan is worth if it succeeds. chances: [K] predicted chance of each prefix;
    the last one is the plan's. best_value: The largest value of a candidate that succeeds without noise, or 0.
    search_value: The value that a search finds if it knows what succeeds without noise; NaN: there was no search.
    outcomes: By the name of the world.
    """

    task: str
    problem: int
    plan: Any
    value: float
    chances: np.ndarray
    best_value: float
    search_value: float
    outcomes: Mapping[str, Outcome]

    @property
    def chance(self) -> float:
        """Predicted chance of the plan."""
        return float(self.chances[-1])

    def encoded(self, domain: Domain) -> dict[str, Any]:
        """As the journal holds it."""
        outcomes: dict[str, dict[str, Any]] = {}
        for world, outcome in self.outcomes.items():
            outcomes[world] = {"labels": symbols_of(outcome.labels)}
            if outcome.report is not None:
                outcomes[world]["report"] = outcome.report
        return {
            "task": self.task,
            "problem": self.problem,
            "plan": domain.encode(self.plan, evaluation=True)[0],
            "value": self.value,
            "chances": self.chances.tolist(),
            "outcomes": outcomes,
        }


Row = tuple[int, dict[str, Any], str, dict[str, Any]]
"""Step, chosen plan, world and outcome; the plan and the outcome as the journal holds them."""


def chosen_table(evaluations: Mapping[int, Sequence[dict[str, Any]]], domain: Domain) -> pd.DataFrame:
    """[rows] one for each step, task, problem, world and placement: `COLUMNS`, and the columns of the domain's files.

    The first column numbers plans, so the table is also a file of plans. chance and label are those of the prefix that
    ends with the placement. report is the world's report as JSON, in the row of the first placement.

    Args:
        evaluations: Chosen plans as the journal holds them, by step.
        domain: Of the plans.
    """
    rows: list[Row] = [
        (step, each, world, outcome)
        for step, chosen in evaluations.items()
        for each in chosen
        for world, outcome in each["outcomes"].items()
    ]
    parts: dict[int, list[int]] = {}
    for number, (_, each, _, _) in enumerate(rows):
        parts.setdefault(len(each["chances"]), []).append(number)
    tables = [_table([rows[number] for number in numbers], numbers, domain) for numbers in parts.values()]
    if not tables:
        return _table([], [], domain)
    return pd.concat(tables, ignore_index=True).sort_values(domain.plan_word, kind="stable", ignore_index=True)


def _table(rows: list[Row], numbers: list[int], domain: Domain) -> pd.DataFrame:
    """The table of plans of one length. numbers: of the plans."""
    empty = domain.random_plans(1, 0, np.random.default_rng())
    table = domain.table(domain.decode([each["plan"] for _, each, _, _ in rows], evaluation=True) if rows else empty)
    row = table[domain.plan_word].to_numpy()
    first = table["position"].to_numpy() == 0
    labels = np.concatenate([labels_of(outcome["labels"]) for *_, outcome in rows] or [np.empty(0, np.int8)])
    reports = [json.dumps(outcome["report"]) if "report" in outcome else None for *_, outcome in rows]
    values = {
        "step": np.array([step for step, *_ in rows], int)[row],
        "task": np.array([each["task"] for _, each, _, _ in rows], object)[row],
        "problem": np.array([each["problem"] for _, each, _, _ in rows], int)[row],
        "world": np.array([world for _, _, world, _ in rows], object)[row],
        "value": np.array([each["value"] for _, each, _, _ in rows], float)[row],
        "chance": np.concatenate([each["chances"] for _, each, _, _ in rows] or [np.empty(0)]),
        "label": pd.Series(labels, dtype="Int8").mask(labels == UNOBSERVED),
        "report": pd.Series(np.array(reports, object)[row]).where(first, None),
    }
    for place, name in enumerate(COLUMNS, start=2):
        table.insert(place, name, values[name])
    table[domain.plan_word] = np.array(numbers, np.int64)[row]
    return table.astype(COLUMNS)


def check_chosen(chosen: Any, length_of: Any) -> None:
    """Raises ValueError, saying what is wrong, unless these are chosen plans as the journal holds them.

    Args:
        chosen: What the journal holds.
        length_of: The number of placements of a plan, as the journal holds it; raises ValueError if it is none.
    """
    if not isinstance(chosen, list):
        raise ValueError("chosen is no list of plans")
    for each in chosen:
        if not isinstance(each, dict) or each.keys() != KEYS:
            raise ValueError(f"a chosen plan is not {', '.join(sorted(KEYS))}")
        length = length_of(each["plan"], True)
        if not isinstance(each["chances"], list) or len(each["chances"]) != length:
            raise ValueError(f"chances are not those of {length} prefixes")
        for outcome in each["outcomes"].values() if isinstance(each["outcomes"], dict) else [None]:
            if not isinstance(outcome, dict) or len(labels_of(outcome.get("labels"))) != length:
                raise ValueError(f"an outcome has no labels of {length} prefixes")
