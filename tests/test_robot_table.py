"""What a robot did, from rows whose sums are known."""

import pandas as pd
import pytest

from analysis.table_robot import statistics


def test_counts_times_and_errors() -> None:
    rows = [
        # tower, purpose, outcome, simulated, wall, planning, plans, replans, regrasps, error
        (80, "build", "done", 3600.0, 1.0, 0.1, 1, 0, 1, 0.001),
        (80, "build", "missed", 1800.0, 9.0, 0.9, 1, 1, 0, None),
        (80, "tidy", "done", 1800.0, 3.0, 0.3, 1, 0, 0, 0.003),
        (81, "intervention", "no grasp", 0.0, 0.0, 0.0, 0, 0, 0, None),
    ]
    names = ["tower", "purpose", "outcome", "simulated", "wall", "planning", "plans", "replans", "regrasps", "error"]
    found = statistics(pd.DataFrame(rows, columns=names))
    expected = {
        "towers": 2,
        "pick-and-places": 3,
        "to build": 2,
        "to clear up": 1,
        "failed": 1,
        "interventions": 1,
        "plans": 3,
        "replans": 1,
        "regrasps": 1,
        "simulated time [h]": 2.0,
        "simulated time of one, median [s]": 2700.0,
        "wall time of one, median [s]": 2.0,
        "planning in it, median [s]": 0.2,
        "placement error, median [mm]": 2.0,
        "placement error, 90th percentile [mm]": 2.8,
    }
    assert found == pytest.approx(expected)
