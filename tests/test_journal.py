"""The journal: what was appended is read back, what was torn is cut off, what is damaged is refused."""

import errno
import json
import os
from pathlib import Path

import pytest

from apf.errors import InputError, Stopped
from apf.journal import Journal


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A journal of three records."""
    path = tmp_path / "journal.jsonl"
    journal = Journal(path)
    for number in range(3):
        journal.append("label", tower=number, labels="10-", ratio=0.1 + number)
    journal.close()
    return path


def read(path: Path) -> list[dict]:
    journal = Journal(path)
    journal.close()
    return journal.records


def test_what_was_appended_is_read_back(path: Path) -> None:
    records = read(path)
    assert [(r["kind"], r["tower"], r["labels"], r["ratio"]) for r in records] == [
        ("label", number, "10-", 0.1 + number) for number in range(3)
    ]
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert [{key: value for key, value in line.items() if key != "crc"} for line in lines] == records


def test_a_torn_end_is_cut_off_at_every_byte(path: Path) -> None:
    whole = path.read_bytes()
    last = len(whole.splitlines(keepends=True)[-1])
    for cut in range(1, last + 1):
        path.write_bytes(whole[:-cut])
        assert len(read(path)) == 2
        assert path.read_bytes() == whole[:-last]


def test_after_a_torn_end_the_next_record_is_whole(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-5])
    journal = Journal(path)
    assert journal.torn
    journal.append("label", tower=7)
    journal.close()
    assert [record["tower"] for record in read(path)] == [0, 1, 7]


@pytest.mark.parametrize("byte", [0, 20, 60, 100])
def test_damage_elsewhere_names_the_line(path: Path, byte: int) -> None:
    lines = path.read_bytes().splitlines(keepends=True)
    at = len(lines[0]) + byte
    whole = b"".join(lines)
    path.write_bytes(whole[:at] + b"\xff" + whole[at + 1 :])
    with pytest.raises(InputError, match=r"journal\.jsonl is damaged: line 2 of 3"):
        Journal(path)
    assert len(path.read_bytes()) == len(whole), "nothing is cut off"


def test_another_file_is_not_taken_for_a_journal(path: Path) -> None:
    path.write_bytes(b"SQLite format 3\0\n" + path.read_bytes())
    with pytest.raises(InputError, match="line 1 of 4"):
        Journal(path)


def test_a_record_that_cannot_be_written_leaves_the_file_as_it_was(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = path.read_bytes()
    journal = Journal(path)
    write = os.write

    def half(file: int, data: bytes) -> int:
        if len(data) < 40:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(file, data[:-20])

    monkeypatch.setattr(os, "write", half)
    with pytest.raises(Stopped, match=r"journal\.jsonl: cannot be written: No space left on device"):
        journal.append("label", tower=3)
    monkeypatch.undo()
    assert path.read_bytes() == before
    journal.append("label", tower=4)
    journal.close()
    assert [record["tower"] for record in read(path)] == [0, 1, 2, 4]


def test_seconds_add_up_over_all_starts(path: Path) -> None:
    seconds = [record["seconds"] for record in read(path)]
    assert seconds == sorted(seconds)
    journal = Journal(path)
    journal._before = 100.0
    journal.append("label", tower=3)
    journal.close()
    assert 100 <= Journal(path).seconds < 101


def test_a_file_that_cannot_be_opened(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="Is a directory"):
        Journal(tmp_path)
