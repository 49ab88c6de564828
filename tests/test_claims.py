"""The claims table: what decides a claim, on evidence made up so that the answer is known."""

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis import measures as m
from analysis.claims import COLUMNS, add_notes, table_of_claims
from analysis.evidence import Evidence, MissingError
from analysis.statements import CLAIMS
from analysis.verdicts import DECIDED, Claim
from apf.errors import InputError

RUNS, PROBLEMS = 4, 50
TOWERS = (100, 200, 300, 400)


def regrets(level: float, spread: float, fallen: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Regret around a level; where the tower fell it is 1."""
    rng = np.random.default_rng(seed)
    stood = rng.random((RUNS, PROBLEMS)) >= fallen
    values = np.clip(rng.normal(level, spread, (RUNS, PROBLEMS)), 0, 1)
    return np.where(stood, values, 1.0), stood.astype(float)


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    """Sequential is best, greedy worst; complete falls often on the hard tasks; TGN leads, the more the longer."""
    levels = {
        "sequential": 0.1,
        "incremental": 0.1,
        "complete": 0.2,
        "greedy": 0.9,
        "random_ss": 0.5,
        "random_comp": 0.6,
    }
    regret = {}
    for number, (who, level) in enumerate(levels.items()):
        for task in m.TASKS:
            harder = 0.0 if task == "tallest" else 0.05
            fallen = 0.4 if who == "complete" and harder else 0.0
            for towers in TOWERS:
                for world in ("analytic", "noisy"):
                    regret[who, world, task, towers] = regrets(level + harder, 0.02, fallen, 1000 * number + towers)
    for who, fallen in (("predictor analytic", 0.6), ("predictor simulation", 0.2)):
        for task in m.TASKS:
            regret[who, "analytic", task, 0] = regrets(0.0, 0.0, 0.0, 1)
            regret[who, "noisy", task, 0] = regrets(0.0, 0.0, fallen, 2)
    accuracy = {
        (model, length, towers): np.full(3, 0.95 - slope * (length - 2) - late * (towers < 400))
        for model, slope, late in (("tgn", 0.02, 0.0), ("fcgn", 0.02, 0.1), ("lstm", 0.08, 0.1))
        for length in range(2, 8)
        for towers in TOWERS
    }
    counts = {who: RUNS for who, *_ in regret} | {model: 3 for model, *_ in accuracy}
    return Evidence(regret, accuracy, {who: np.arange(n) for who, n in counts.items()}, np.arange(PROBLEMS))


@pytest.fixture(scope="module")
def table(evidence: Evidence) -> pd.DataFrame:
    return table_of_claims({"": evidence}, draws=20)


def test_the_table_has_a_row_for_each_claim_and_its_columns(table: pd.DataFrame) -> None:
    assert list(table.columns) == [*COLUMNS, *DECIDED]
    assert len(table) == sum(map(len, CLAIMS.values()))
    assert {text.partition(".")[0] for text in table["claim"]} == {str(n) for n in range(1, 11)}
    assert set(table["verdict"]) <= {"holds", "fails", "undecided"}


@pytest.mark.parametrize(
    ("claim", "verdict"),
    [
        ("1. Sequential brings", "holds"),
        ("3. Complete has far wider quartiles than sequential (overhang)", "holds"),
        ("3. The upper quartile of complete reaches 1 (unsupported)", "holds"),
        ("4. Greedy is worst (tallest)", "holds"),
        ("4. Greedy is not yet decent", "holds"),
        ("5. Overhang is harder", "holds"),
        ("6. Sequential beats random_ss", "holds"),
        ("6. Random_ss beats greedy", "holds"),
        ("7. Complete beats random_comp", "holds"),
        ("8. TGN beats LSTM", "holds"),
        ("8. TGN's lead over LSTM grows with length", "holds"),
        ("8. TGN learns faster than FCGN", "holds"),
        ("8. FCGN catches up", "holds"),
        ("9. TGN trained on up to 5 blocks generalises to 7", "holds"),
        ("10. Analytic plans fall often", "holds"),
        ("10. Learned plans stand oftener than analytic", "holds"),
        ("4. Greedy is decent on tallest at 800", "undecided"),
    ],
)
def test_a_claim_that_is_true_by_construction_holds(table: pd.DataFrame, claim: str, verdict: str) -> None:
    rows = table[table["claim"].str.startswith(claim)]
    assert len(rows)
    assert set(rows["verdict"]) == {verdict}


def test_a_claim_that_is_false_by_construction_fails(evidence: Evidence) -> None:
    """The same evidence with the names of sequential and greedy exchanged."""
    other = {"sequential": "greedy", "greedy": "sequential"}
    regret = {(other.get(who, who), *rest): value for (who, *rest), value in evidence.regret.items()}
    swapped = Evidence(regret, evidence.accuracy, evidence.runs, evidence.problems)
    table = table_of_claims({"": swapped}, draws=20).set_index("claim")["verdict"]
    for claim in ("4. Greedy is worst (tallest)", "6. Sequential beats random_ss", "6. Random_ss beats greedy"):
        assert table[claim] == "fails"


@pytest.mark.parametrize(
    ("low", "high", "above", "below"), [(0.1, 0.3, "holds", "fails"), (-0.3, -0.1, "fails", "holds")]
)
def test_verdicts(low: float, high: float, above: str, below: str) -> None:
    make = partial(Claim, "a claim", "a number", (), lambda evidence: 0.0)
    assert make(above=0.0).verdict(low, high) == above
    assert make(below=0.0).verdict(low, high) == below
    assert make(above=0.2).verdict(0.1, 0.3) == make(below=0.2).verdict(0.1, 0.3) == "undecided"


def test_what_was_not_measured_is_said(evidence: Evidence) -> None:
    kept = {key: value for key, value in evidence.regret.items() if key[0] != "greedy"}
    runs = {who: rows for who, rows in evidence.runs.items() if who != "greedy"}
    table = table_of_claims({"": Evidence(kept, evidence.accuracy, runs, evidence.problems)}, draws=5)
    (row,) = table[table["claim"] == "6. Random_ss beats greedy"].to_dict("records")
    assert (row["verdict"], row["runs"]) == ("undecided", "4 + 0")
    assert "greedy" in row["note"]
    assert np.isnan(row["value"])


def test_one_run_of_what_learns_decides_nothing(evidence: Evidence) -> None:
    one = Evidence(
        evidence.regret, evidence.accuracy, dict(evidence.runs) | {"greedy": np.arange(1)}, evidence.problems
    )
    table = table_of_claims({"": one}, draws=5).set_index("claim")
    row = table.loc["6. Random_ss beats greedy"]
    assert (row["verdict"], row["runs"]) == ("undecided", "4 + 1")
    assert row["value"] > 0
    assert "too few runs of greedy" in row["note"]
    assert table.loc["6. Sequential beats random_ss", "verdict"] == "holds"


def test_a_draw_takes_whole_runs_and_whole_problems(evidence: Evidence) -> None:
    """Every number of a draw is one of the original, in its row and column."""
    regret = {("sequential", "analytic", "tallest", 200): (np.arange(12.0).reshape(3, 4), np.ones((3, 4)))}
    small = Evidence(regret, {}, {"sequential": np.arange(3)}, np.arange(4))
    drawn = small.drawn(np.random.default_rng(0))
    values = drawn.regrets("sequential", "tallest", 200)
    np.testing.assert_array_equal(values, drawn.runs["sequential"][:, None] * 4 + drawn.problems)
    with pytest.raises(MissingError, match="overhang"):
        drawn.regrets("sequential", "overhang", 200)


def test_relative_variance_by_hand() -> None:
    """Two runs whose mean regrets are 0.1 and 0.3 against 0.1 and 0.5: half the deviation."""
    regret = {}
    for who, second in (("incremental", 0.3), ("sequential", 0.5), ("complete", 0.9), ("greedy", 0.9)):
        for task in m.TASKS:
            regret[who, "analytic", task, 200] = (np.array([[0.1, 0.1], [second, second]]), np.ones((2, 2)))
    evidence = Evidence(regret, {}, {who: np.arange(2) for who in m.STRATEGIES}, np.arange(2))
    assert m.relative_variance(evidence, who="incremental") == pytest.approx(0.5)


def test_notes_stand_beside_their_claims(table: pd.DataFrame, tmp_path: Path) -> None:
    claim = "5. Overhang is harder than tallest"
    notes = tmp_path / "notes.yaml"
    notes.write_text(f"{claim}: seen at every number of towers\n")
    noted = table.copy()
    add_notes(noted, notes)
    assert noted.set_index("claim")["note"][claim] == "seen at every number of towers"
    assert noted[noted["claim"] != claim].equals(table[table["claim"] != claim])


def test_a_note_on_no_claim_is_refused(table: pd.DataFrame, tmp_path: Path) -> None:
    notes = tmp_path / "notes.yaml"
    notes.write_text("11. Towers fly: no\n")
    with pytest.raises(InputError, match="no such claim: 11"):
        add_notes(table.copy(), notes)
