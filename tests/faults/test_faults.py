"""The quick part of `python -m benchmarks.faults`: a few of each fault, all of them resumed, nothing lost."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.faults import label_cost
from benchmarks.injections import Suite, mount

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Suite:
    """A reference run, made once."""
    return Suite(tmp_path_factory.mktemp("faults"))


def must_be_harmless(suite: Suite, injection: Iterator[str]) -> None:
    """Fails if a label was lost, a table differs, or something was not said in one line."""
    assert list(injection)
    report = suite.report
    assert (report.labels_lost, report.tables_differing, report.unclear) == (0, 0, [])


def test_a_kill_in_every_phase(suite: Suite) -> None:
    must_be_harmless(suite, suite.kills(7, seed=1))


def test_sigterm_and_ctrl_c(suite: Suite) -> None:
    must_be_harmless(suite, suite.terminations(2))


def test_the_last_record_torn_or_garbled_at_every_byte(suite: Suite) -> None:
    must_be_harmless(suite, suite.torn(1))
    assert suite.report.faults["torn record"] > 50
    assert suite.report.refused >= suite.report.faults["damage elsewhere"] > 100
    for fault in ("line doubled", "line missing", "lines swapped", "line of another run", "line ends of Windows"):
        assert suite.report.faults[fault]


def test_a_full_disk(suite: Suite) -> None:
    must_be_harmless(suite, suite.full_disk(2))


def test_a_small_disk_that_is_then_read_only(suite: Suite, tmp_path: Path) -> None:
    if not mount("-t", "tmpfs", "tmpfs", tmp_path):
        pytest.skip("mounting is not permitted")
    subprocess.run(["umount", tmp_path], check=True)
    must_be_harmless(suite, suite.small_disk(2))
    assert suite.report.faults["small disk"] == 2


def test_worlds_that_fail(suite: Suite) -> None:
    must_be_harmless(suite, suite.worlds((2,)))


def test_two_at_once(suite: Suite) -> None:
    must_be_harmless(suite, suite.concurrent(1))


def test_a_label_costs_little(tmp_path: Path) -> None:
    assert label_cost(tmp_path, 100) < 0.05, "the target is 5 ms; other machines have slower disks"
