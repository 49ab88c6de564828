"""What a record of the journal must be, given those before it."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from apf.rundir.chosen import check_chosen
from apf.rundir.columns import ACCURACY_COLUMNS, REGRET_COLUMNS
from apf.rundir.journal import Record
from apf.rundir.labels import LABELS, labels_of

KINDS = {
    "plans": ("step", "plans"),
    "label": ("plan", "labels"),
    "correction": ("plan", "old", "labels", "reason"),
    "training": ("step", "losses"),
    "reward": ("step", "task", "problem", "world", "plan", "labels", "report"),
    "evaluation": ("step", "regret", "accuracy", "chosen", "weights"),
}
"""What each kind of record holds, besides when it was written."""

NUMBERS = {"reward": ("step", "problem")}
"""Which of these are numbers from 0; of other kinds step and plan."""


class Proposed(Protocol):
    """A plan that was proposed, as the journal holds it, and its labels if it has been executed."""

    plan: dict[str, Any]
    labels: str | None


LengthOf = Callable[..., int]
"""The number of placements of a plan, as the journal holds it, and whether an evaluation chose it; raises ValueError if
it is none."""


def check(record: Record, proposed: Sequence[Proposed], length_of: LengthOf) -> None:
    """Raises ValueError, saying what is wrong, unless the record may follow.

    Args:
        record: As the journal holds it.
        proposed: All that was proposed before.
        length_of: Of a plan.
    """
    kind = record.get("kind")
    if kind not in KINDS:
        raise ValueError(f"records of kind {kind!r} are unknown")
    missing = [name for name in KINDS[kind] if name not in record]
    if missing:
        raise ValueError(f"{missing[0]} is missing")
    for name in KINDS[kind]:
        if name in NUMBERS.get(kind, ("step", "plan")) and not (type(record[name]) is int and record[name] >= 0):
            raise ValueError(f"{name} is {record[name]!r}, which is no number from 0")
    if kind == "plans":
        _check_plans(record["plans"], length_of)
    elif kind in ("label", "correction"):
        _check_labels(record, proposed, length_of)
    elif kind == "reward":
        length = length_of(record["plan"], True)
        if len(labels_of(record["labels"])) != length:
            raise ValueError(f"labels are not those of {length} prefixes")
    elif kind == "training":
        losses = record["losses"]
        if not isinstance(losses, dict) or not all(isinstance(loss, int | float) for loss in losses.values()):
            raise ValueError("losses are no numbers by name")
    else:
        for name, columns in (("regret", REGRET_COLUMNS), ("accuracy", ACCURACY_COLUMNS)):
            rows = record[name]
            if not isinstance(rows, list) or any(not isinstance(r, list) or len(r) != len(columns) for r in rows):
                raise ValueError(f"{name} is no rows of {len(columns)} values")
        check_chosen(record["chosen"], length_of)


def _check_plans(plans: Any, length_of: LengthOf) -> None:
    if not isinstance(plans, list):
        raise ValueError("plans are no list")
    for plan in plans:
        if not isinstance(plan, dict) or plan.keys() != {"split", "score", "plan"}:
            raise ValueError("a plan is not split, score and plan")
        length_of(plan["plan"])


def _check_labels(record: Record, proposed: Sequence[Proposed], length_of: LengthOf) -> None:
    number, new = record["plan"], record["labels"]
    if number >= len(proposed):
        raise ValueError(f"plan {number} was not proposed before")
    before = proposed[number].labels
    if record["kind"] == "label" and before is not None:
        raise ValueError(f"plan {number} has labels already")
    if record["kind"] == "correction" and (before is None or before != record["old"]):
        raise ValueError(f"plan {number} has labels {before} before, and not {record['old']}")
    length = length_of(proposed[number].plan)
    if not isinstance(new, str) or len(new) != length or not LABELS.fullmatch(new):
        raise ValueError(
            f"labels are {new!r}; plan {number} takes {length} characters, 1 for each prefix that stood, then one 0, "
            "then - to the end"
        )
    if not isinstance(record.get("report"), dict | None):
        raise ValueError("report is no mapping")
