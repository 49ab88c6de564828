"""What the records of a journal keep, and what a write that fails leaves, whatever the format of the file."""

import errno
import os
import re
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from apf.errors import Stopped
from apf.rundir.journal import Journal


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A journal of three records."""
    path = tmp_path / "journal.jsonl"
    journal = Journal(path)
    for number in range(3):
        journal.append("label", plan=number)
    journal.close()
    return path


def read(path: Path) -> list[dict]:
    journal = Journal(path)
    journal.close()
    return journal.records


def test_a_record_is_synced_before_append_returns(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[bytes] = []
    fsync = os.fsync

    def noted(file: int) -> None:
        fsync(file)
        synced.append(Path(f"/proc/self/fd/{file}").read_bytes())

    journal = Journal(path)
    monkeypatch.setattr(os, "fsync", noted)
    journal.append("label", plan=3)
    journal.close()
    assert synced[-1] == path.read_bytes()


def test_records_before_one_that_cannot_be_written_stay(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = Journal(path)
    write, lines = os.write, path.read_bytes()
    for number in (3, 4):
        journal.append("label", plan=number)
        before = path.read_bytes()
        assert before.startswith(lines) and before != lines

        def torn(file: int, data: bytes) -> int:
            write(file, data[:5])
            raise OSError(errno.ENOSPC, "No space left on device")

        with monkeypatch.context() as full, pytest.raises(Stopped, match="No space left on device"):
            full.setattr(os, "write", torn)
            journal.append("label", plan=9)
        assert path.read_bytes() == before
        assert [record["plan"] for record in journal.records] == list(range(number + 1))
    journal.close()
    assert [record["plan"] for record in read(path)] == [0, 1, 2, 3, 4]


def test_text_is_kept_as_it_is_written(path: Path) -> None:
    journal = Journal(path)
    journal.append("correction", reason="fällt: \u201c崩れた\u201d")
    journal.close()
    assert "fällt: “崩れた”".encode() in path.read_bytes()
    assert read(path)[-1]["reason"] == "fällt: “崩れた”"


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_what_is_no_json_is_no_record(path: Path, value: float) -> None:
    before, journal = path.read_bytes(), Journal(path)
    with pytest.raises(ValueError, match="not JSON compliant"):
        journal.append("training", losses={"loss/train": value})
    journal.close()
    assert path.read_bytes() == before
    assert len(journal.records) == 3


def test_others_may_read_it(path: Path) -> None:
    mask = os.umask(0)
    os.umask(mask)
    assert path.stat().st_mode & 0o777 == 0o644 & ~mask


def test_records_say_when_and_after_how_many_seconds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [50.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    for start, seconds in ((50.0, [0.0, 1.235]), (7.0, [1.235, 2.47])):
        now[0] = start
        journal = Journal(tmp_path / "journal.jsonl")
        journal.append("label", plan=0)
        now[0] += 1.2345678
        journal.append("label", plan=1)
        journal.close()
        assert [record["seconds"] for record in journal.records[-2:]] == pytest.approx(seconds, abs=1e-12)
    for record in journal.records:
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}\+00:00", record["at"])
        assert abs((datetime.now(UTC) - datetime.fromisoformat(record["at"])).total_seconds()) < 60
