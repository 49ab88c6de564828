"""How long it still takes, worked out by hand: of one run, and of the runs of a sweep."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from apf.tracking.board import left_of_all
from apf.tracking.progress import Estimate, Progress, ProgressFile, clock, still, times


class Clock:
    """Time that passes when it is told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_nothing_is_known_at_first() -> None:
    estimate = Estimate(Clock())
    estimate.plan({"building": 2, "training": 1})
    assert estimate.left() == (0, False)


def test_units_take_what_those_of_their_kind_took() -> None:
    time = Clock()
    estimate = Estimate(time)
    estimate.plan({"building": 4, "training": 2, "planning": 0})
    for seconds in (1, 3):
        estimate.begin("building")
        time.now += seconds
    estimate.begin("training")
    assert estimate.left() == (2 * 2, False), "two buildings of 2 s; nobody knows how long training takes"
    time.now += 10
    estimate.begin("building")
    assert estimate.left() == (2 * 2 + 10, True)
    time.now += 0.5
    assert estimate.left() == (1.5 + 2 + 10, True), "half a second of the one that goes on is over"
    time.now += 50
    assert estimate.left() == (2 + 10, True), "what takes longer than expected is expected to end now"
    assert estimate.gone == 64.5
    estimate.begin("training")
    time.now += 6
    estimate.end()
    assert estimate.left() == ((1 + 3 + 50.5) / 3, True), "one building"


def test_work_that_was_not_planned_counts_while_it_goes_on() -> None:
    time = Clock()
    estimate = Estimate(time)
    estimate.begin("writing")
    assert estimate.left() == (0, False)
    time.now += 5
    estimate.end()
    assert estimate.left() == (0, True)


def test_old_times_are_forgotten() -> None:
    time = Clock()
    estimate = Estimate(time)
    estimate.plan({"building": 100})
    for seconds in [60] * 5 + [1] * 20:
        estimate.begin("building")
        time.now += seconds
    estimate.end()
    assert estimate.left() == (75, True)


def told(left: float, whole: bool = True) -> Progress:
    return Progress("training", 1, 2, 10, left, whole, 0)


@pytest.mark.parametrize(
    ("running", "took", "undone", "at_once", "expected"),
    [
        ([], [5.0], 0, 2, (0, True)),
        ([(3, None)], [], 2, 1, (0, False)),
        ([(3, told(4, whole=False))], [], 1, 1, (4, False)),
        ([(3, told(7))], [], 1, 1, (7, True)),
        ([(3, told(7))], [], 3, 1, (7 + 10 + 10, True)),
        ([(3, told(7)), (3, told(17))], [], 4, 2, (17 + 15, True)),
        ([(3, told(7)), (3, told(17))], [10.0, 20.0, 30.0], 3, 2, (7 + 20, True)),
        ([(3, None)], [10.0], 1, 1, (7, True)),
        ([(30, None)], [10.0], 1, 1, (0, True)),
        ([], [10.0], 5, 4, (20, True)),
    ],
)
def test_the_end_of_a_sweep(
    running: list[tuple[float, Progress | None]],
    took: list[float],
    undone: int,
    at_once: int,
    expected: tuple[float, bool],
) -> None:
    """Runs that wait begin where one ends, and take what others took."""
    assert left_of_all(running, took, undone, at_once) == expected


def test_in_words() -> None:
    assert [clock(s) for s in (0, 59.6, 61, 3723)] == ["0:00", "1:00", "1:01", "1:02:03"]
    assert still(0, whole=False) == ""
    assert still(37, whole=False) == "more than 0:37 left"
    assert still(37, whole=True) == "about 0:37 left"
    assert times(22, 37, whole=True) == "0:22 so far, about 0:37 left"
    assert times(22, 0, whole=False) == "0:22 so far"
    assert told(1).where == "step 1/2, training"
    assert Progress("planning 3/50", 0, 0, 1, 1, True, 0).where == "planning 3/50", "a baseline has no steps"


def test_a_state_ages() -> None:
    assert told(5).aged(3) == Progress("training", 1, 2, 13, 2, True, 3)
    assert told(5).aged(9).left == 0


def test_a_run_tells_when_the_work_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "progress"
    monkeypatch.setenv(ProgressFile.VARIABLE, str(path))
    monkeypatch.setattr(ProgressFile, "EVERY", 1000)
    file = ProgressFile()
    assert ProgressFile.read(path) is None
    kept = []
    for kind, left in (("building", 9), ("building", 8), ("training", 7)):
        file.write(kind, lambda left=left: told(left))  # type: ignore[misc]
        kept.append(json.loads(path.read_text())["left"])
    assert kept == [9, 9, 7]
    path.write_text(json.dumps(asdict(told(7)))[:-5])
    assert ProgressFile.read(path) is None, "half of one"


def test_nobody_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(ProgressFile.VARIABLE, raising=False)
    ProgressFile().write("building", lambda: pytest.fail("it was worked out for nobody"))


def test_nowhere_to_tell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ProgressFile.VARIABLE, str(tmp_path / "gone" / "progress"))
    ProgressFile().write("building", lambda: told(1))
