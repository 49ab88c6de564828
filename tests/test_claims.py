"""The claims table: what decides a claim, on evidence made up so that the answer is known."""

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis import measures as m
from analysis.claims import COLUMNS, add_notes, main, markdown, table_of_claims
from analysis.evidence import Evidence, MissingError
from analysis.statements import CLAIMS, STRATEGY
from analysis.verdicts import DECIDED, Claim, runs_needed
from apf.api.composed import composed
from apf.config.values import plain
from apf.errors import InputError
from apf.rundir.columns import ACCURACY_COLUMNS, REGRET_COLUMNS
from apf.rundir.files import write_yaml

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


@pytest.mark.parametrize(
    ("runs", "value", "low", "high", "bound", "needed"),
    [
        (4, 0.1, -0.1, 0.3, 0.0, "17"),  # 4 runs: exactly 0.1 above the bound; 4 x (0.2 / 0.1)^2 is not yet enough
        (4, -0.05, -0.2, 0.1, 0.0, "37"),  # towards the bound above: 4 x (0.15 / 0.05)^2, and one more
        (4, 0.3, 0.0, 0.31, 0.0, "5"),  # the bound is the end of the interval
        (4, 1.0, 0.3, 1.0, 0.99, "more than 1,000"),
        (4, 0.5, 0.3, 1.0, 0.5, "more than 1,000"),
        (4, np.nan, np.nan, np.nan, 0.5, ""),
    ],
)
def test_runs_needed_by_hand(runs: int, value: float, low: float, high: float, bound: float, needed: str) -> None:
    assert runs_needed(runs, value, low, high, bound) == needed


@given(st.integers(2, 20), st.floats(0.01, 1), st.floats(1.01, 5), st.booleans())
def test_so_many_runs_decide_and_one_less_does_not(runs: int, distance: float, factor: float, over: bool) -> None:
    """An interval that shrinks with the square root of the number of runs leaves the bound outside, just."""
    half, value = distance * factor, distance if over else -distance
    needed = int(runs_needed(runs, value, value - half, value + half, 0.0))
    assert half * np.sqrt(runs / needed) < distance
    assert half * np.sqrt(runs / (needed - 1)) >= distance * (1 - 1e-9)


def test_what_an_undecided_claim_needs_is_said_and_no_other(table: pd.DataFrame) -> None:
    decided = table["verdict"] != "undecided"
    assert (table.loc[decided, "needed"] == "").all()
    open_ = table[~decided & table["value"].notna()]
    assert len(open_)
    assert (open_["needed"] != "").all()


def test_each_name_has_columns_of_its_own(evidence: Evidence) -> None:
    few = replace(evidence, regret={key: value for key, value in evidence.regret.items() if key[0] != "greedy"})
    both = table_of_claims({"paper": few, "default": evidence}, draws=5)
    assert list(both.columns) == [*COLUMNS, *(f"{name}.{key}" for name in ("paper", "default") for key in DECIDED)]
    row = both.set_index("claim").loc["6. Random_ss beats greedy"]
    assert (row["paper.verdict"], row["default.verdict"]) == ("undecided", "holds")
    alone = table_of_claims({"default": evidence}, draws=5)
    assert both[alone.columns].equals(alone), "the others have no part in it"
    lines = markdown(both, ["paper", "default"]).splitlines()
    assert "| claim | paper: answer | paper: evidence | default: answer | default: evidence |" in lines
    (line,) = [line for line in lines if line.startswith("| 6. Random_ss beats greedy |")]
    assert line.split(" | ")[1] == "undecided"
    _, _, missing, answer, measured = line.split(" | ")
    assert "no runs of greedy" in missing or "no regret of greedy" in missing
    assert answer == "holds"
    assert measured.startswith("mean regret of the latter less that of the former: 0.")
    assert measured.endswith(", should be > 0; 4 + 4 runs |")


def test_notes_have_a_name(evidence: Evidence, tmp_path: Path) -> None:
    table = table_of_claims({"paper": evidence, "default": evidence}, draws=2)
    notes = tmp_path / "notes.yaml"
    notes.write_text("5. Overhang is harder than tallest: seen\n")
    add_notes(table, notes, "default")
    row = table.set_index("claim").loc["5. Overhang is harder than tallest"]
    assert (row["paper.note"], row["default.note"]) == ("", "seen")
    with pytest.raises(InputError, match="NAME=FILE"):
        add_notes(table, notes)


def test_an_evaluation_of_some_runs_is_counted_by_these() -> None:
    """Of three runs of greedy one went to 800 towers: too few to decide on."""
    at_800 = (
        np.array([[0.1, 0.1], [np.nan, np.nan], [np.nan, np.nan]]),
        np.array([[1, 1], [np.nan] * 2, [np.nan] * 2]),
    )
    evidence = Evidence(
        {}, {}, {"greedy": np.arange(3)}, np.arange(2), {("greedy", "analytic", "tallest", 800): at_800}
    )
    (claim,) = [claim for claim in STRATEGY if claim.towers == 800]
    decision = claim.decide(evidence, 10, np.random.default_rng(0))
    assert (decision["value"], decision["runs"], decision["verdict"]) == (pytest.approx(0.1), "1", "undecided")
    assert "too few runs of greedy" in str(decision["note"])


def write_run(folder: Path, sampler: str, seed: int, level: float, *overrides: str) -> None:
    """A finished run of the sweep `strategies` whose regret is a level, and what `overrides` change of its config."""
    folder.mkdir(parents=True)
    with composed("config", ["+experiment=strategies", "tracker=none", f"seed={seed}", *overrides]) as (config, _):
        write_yaml(folder / "config.yaml", plain(config))
    choices = {"experiment": "strategies", "sampler": sampler, "model": "tgn", "predictor": "learned"}
    state = {"name": folder.name, "hash": "0", "sweep": "strategies", "choices": choices, "words": {"plan": "tower"}}
    state |= {"titles": {}, "versions": {}, "finished": True, "seconds": 1}
    write_yaml(folder / "run.yaml", state | {"words": {"plan": "tower", "object": "block"}})
    rows = [
        (0, towers, task, problem, world, 1.0, 0.9, 2.0, level + 0.01 * problem, True, 2.0, 0.5)
        for towers in (100, 200)
        for task in m.TASKS
        for problem in range(3)
        for world in ("analytic", "noisy")
    ]
    pd.DataFrame(rows, columns=REGRET_COLUMNS).to_parquet(folder / "regret.parquet")
    pd.DataFrame([], columns=ACCURACY_COLUMNS).to_parquet(folder / "accuracy.parquet")


def claims(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> None:
    """The script in this process."""
    monkeypatch.setattr(sys, "argv", ["claims.py", *map(str, arguments), "--draws", "5"])
    main()


def test_claims_of_two_names_lie_beside_their_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first name has runs of the protocol, the second, with the same tables, runs with too few candidates."""
    for name, overrides in (("good", ()), ("smoke", ("planner.candidates=2000",))):
        for sampler, level in (("sequential", 0.1), ("random_ss", 0.4)):
            for seed in (0, 1):
                write_run(tmp_path / "runs" / name / f"{sampler}{seed}", sampler, seed, level, *overrides)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    claims(monkeypatch, *(f"{name}={tmp_path / 'runs' / name}" for name in ("good", "smoke")))
    row = pd.read_csv(tmp_path / "runs" / "claims.csv").set_index("claim").loc["6. Sequential beats random_ss"]
    assert (row["good.verdict"], row["good.runs"], row["good.value"]) == ("holds", "2 + 2", pytest.approx(0.3))
    assert (row["smoke.verdict"], row["smoke.runs"], row["smoke.value"]) == ("undecided", "2 + 2", pytest.approx(0.3))
    assert row["smoke.note"].endswith("planner.candidates is 2000 (protocol: 20000)")
    assert "6. Sequential beats random_ss" in (tmp_path / "runs" / "claims.md").read_text()
    claims(monkeypatch, tmp_path / "runs" / "good", tmp_path / "runs" / "smoke" / "sequential0")
    both = pd.read_csv(tmp_path / "runs" / "claims.csv").set_index("claim").loc["6. Sequential beats random_ss"]
    assert (both["verdict"], both["runs"]) == ("undecided", "3 + 2")
    assert "1 of 3 of sequential" in both["note"]
    claims(monkeypatch, tmp_path / "runs" / "good")
    alone = pd.read_csv(tmp_path / "runs" / "good" / "claims.csv").set_index("claim")
    assert alone.loc["6. Sequential beats random_ss", "verdict"] == "holds"
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_a_name_without_a_folder_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match=r"paper=: write NAME=DIR"):
        claims(monkeypatch, "paper=")
    with pytest.raises(SystemExit, match="nowhere: no such directory"):
        claims(monkeypatch, "paper=nowhere")
