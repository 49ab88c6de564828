"""What the robot did, what it took, and how often a person had to help: the paper's robot statistics."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import pandas as pd

BUILD, TIDY, INTERVENTION = "build", "tidy", "intervention"
DONE = "done"

COLUMNS = {
    "tower": "int64",
    "purpose": "string",
    "block": "string",
    "outcome": "string",
    "simulated": "float64",
    "wall": "float64",
    "processor": "float64",
    "planning": "float64",
    "plans": "int64",
    "replans": "int64",
    "regrasps": "int64",
    "error": "float64",
    "turn": "float64",
}
"""Of `world.parquet`."""


@dataclass
class Entry:
    """One pick-and-place, or one intervention.

    purpose: `build`, `tidy` or `intervention`. outcome: `done`, or what went wrong; of an intervention its cause.
    simulated, wall, processor: how long it took [s], by the clock of the simulation, of the wall, and of this process;
    planning is included in the latter two. planning: its share of the wall time [s]. plans: task plans, replans: those
    given up. regrasps: on the pedestal. error [m], turn [rad]: where the block came to lie, against where it should;
    None if it was not put down, or fell.
    """

    purpose: str
    block: str
    outcome: str = DONE
    simulated: float = 0.0
    wall: float = 0.0
    processor: float = 0.0
    planning: float = 0.0
    plans: int = 0
    replans: int = 0
    regrasps: int = 0
    error: float | None = None
    turn: float | None = None


@dataclass
class Account:
    """Entries of one plan, in the order of events."""

    entries: list[Entry] = field(default_factory=list)

    def plain(self) -> list[dict[str, Any]]:
        """As JSON can hold it, what is empty left out."""
        return [{k: v for k, v in asdict(entry).items() if v not in (None, 0)} for entry in self.entries]


def table(reports: Iterable[tuple[int, Mapping[str, Any]]]) -> pd.DataFrame:
    """One row per entry, in `COLUMNS`, of the reports of plans by their numbers."""
    rows = [{"tower": number, **entry} for number, report in reports for entry in report["entries"]]
    frame = pd.DataFrame(rows, columns=list(COLUMNS))
    counts = {name: 0 for name, dtype in COLUMNS.items() if dtype == "int64"}
    return frame.fillna({**counts, "simulated": 0.0, "wall": 0.0, "processor": 0.0, "planning": 0.0}).astype(COLUMNS)


def summary(reports: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Metrics of some plans together; medians are of pick-and-places that were done."""
    entries = [entry for report in reports for entry in report["entries"]]
    worked = [entry for entry in entries if entry["purpose"] != INTERVENTION]
    done = [entry for entry in worked if entry["outcome"] == DONE]
    built = [entry for entry in done if entry["purpose"] == BUILD]
    causes = [report["outcome"] for report in reports]
    figures: dict[str, float] = {
        "pick_and_places": len(done),
        "failed": len(worked) - len(done),
        "interventions": len(entries) - len(worked),
        "no_plan": causes.count("no plan"),
        **{name: sum(entry.get(name, 0) for entry in worked) for name in ("plans", "replans", "regrasps")},
    }
    medians = {
        "simulated": [entry.get("simulated", 0.0) for entry in done],
        "wall": [entry.get("wall", 0.0) for entry in done],
        "error": [entry["error"] for entry in built if entry.get("error") is not None],
    }
    return figures | {name: float(np.median(values)) for name, values in medians.items() if len(values)}
