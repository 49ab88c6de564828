"""The journal: what was appended is read back, what one write tore is kept aside, what is damaged is refused."""

import errno
import json
import os
from pathlib import Path

import pytest

from apf.errors import InputError, Stopped
from apf.rundir.journal import End, Journal, create, encode


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A journal of three records."""
    path = tmp_path / "journal.jsonl"
    journal = Journal(path)
    for number in range(3):
        journal.append("label", plan=number, labels="10-", ratio=0.1 + number)
    journal.close()
    return path


def read(path: Path) -> list[dict]:
    journal = Journal(path)
    journal.close()
    return journal.records


def test_what_was_appended_is_read_back(path: Path) -> None:
    records = read(path)
    assert [(r["kind"], r["plan"], r["labels"], r["ratio"]) for r in records] == [
        ("label", number, "10-", 0.1 + number) for number in range(3)
    ]
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    kept = [{key: value for key, value in line.items() if key not in ("crc", "follows")} for line in lines]
    assert kept[1:] == records
    assert {key: kept[0][key] for key in ("kind", "format", "run")} == {"kind": "journal", "format": 6, "run": ""}
    assert [line["follows"] for line in lines] == ["", *(line["crc"] for line in lines[:-1])]


def test_a_torn_end_is_moved_aside_at_every_byte(path: Path) -> None:
    whole = path.read_bytes()
    last = whole.splitlines(keepends=True)[-1]
    aside = path.with_name("journal.torn-1.jsonl")
    for cut in range(2, len(last)):
        path.write_bytes(whole[:-cut])
        assert len(read(path)) == 2
        assert path.read_bytes() == whole[: -len(last)]
        assert aside.read_bytes() == last[:-cut]
        aside.unlink()


def test_a_record_that_lacks_its_line_end_alone_is_not_lost(path: Path) -> None:
    whole = path.read_bytes()
    path.write_bytes(whole[:-1])
    assert len(read(path)) == 3
    assert path.read_bytes() == whole
    assert not list(path.parent.glob("*torn*"))


def test_after_a_torn_end_the_next_record_is_whole(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-5])
    journal = Journal(path)
    assert journal.torn == path.with_name("journal.torn-1.jsonl")
    assert "torn" in str(journal.notice) and "journal.torn-1.jsonl" in str(journal.notice)
    journal.append("label", plan=7)
    journal.close()
    assert [record["plan"] for record in read(path)] == [0, 1, 7]
    assert Journal(path).notice is None


def test_what_was_torn_before_is_never_overwritten(path: Path) -> None:
    whole = path.read_bytes()
    for number in (1, 2, 3):
        path.write_bytes(whole[: -number - 1])
        read(path)
    kept = [path.with_name(f"journal.torn-{n}.jsonl").read_bytes() for n in (1, 2, 3)]
    assert kept == [whole.splitlines(keepends=True)[-1][: -n - 1] for n in (1, 2, 3)]


def test_a_garbled_last_line_is_moved_aside(path: Path) -> None:
    """A disk may have room for a line that it did not write: zeros, or what was there before."""
    whole = path.read_bytes()
    last = len(whole.splitlines(keepends=True)[-1])
    for tail in (b"\0" * last, b"x" * 20 + whole[20 - last :], whole[-last:-30] + b"\0" * 30):
        path.write_bytes(whole[:-last] + tail)
        assert len(read(path)) == 2
        assert path.read_bytes() == whole[:-last]


def changed(lines: list[bytes]) -> dict[str, tuple[list[bytes], str]]:
    """What can become of the lines of a journal of five, and what is said of it."""
    header, first, second, third, fourth = lines
    return {
        "doubled": ([header, first, first, second, third, fourth], "line 3 is line 2 once more"),
        "doubled at the end": ([*lines, fourth], "line 6 is line 5 once more"),
        "doubled later": ([*lines, first], "line 6 is line 2 once more"),
        "missing": ([header, first, third, fourth], "line 3 of 4 does not follow line 2"),
        "missing before the last": ([header, first, second, fourth], "line 4 of 4 does not follow line 3"),
        "first missing": ([header, second, third, fourth], "line 2 of 4 does not follow line 1"),
        "swapped": ([header, second, first, third, fourth], "line 2 of 5 does not follow line 1"),
        "last two swapped": ([header, first, second, fourth, third], "line 4 of 5 does not follow line 3"),
        "two begins": ([header, header, first], "line 2 is line 1 once more"),
        "the last two damaged": ([header, first, second, b"x" + third, b"x" + fourth], "line 4 of 5 is not what"),
        "all but one damaged": ([header, *(b"x" + line for line in lines[1:])], "line 2 of 5 is not what"),
        "one damaged and the last torn": ([*lines[:3], b"x" + third, fourth[:-9]], "line 4 of 5 is not what"),
        "two lines run together": ([*lines[:3], third[:-1] + b" " + fourth], "line 4 of 4 is not what"),
        "an empty line": ([header, first, b"\n", second, third, fourth], "line 3 of 6 is not what"),
        "a first line garbled": ([b"x" + header, *lines[1:]], "line 1 of 5 is not what"),
    }


@pytest.mark.parametrize("case", changed([b""] * 5))
def test_what_no_write_can_do_is_refused_and_stays(path: Path, case: str) -> None:
    journal = Journal(path)
    journal.append("label", plan=3)
    journal.close()
    lines, words = changed(path.read_bytes().splitlines(keepends=True))[case]
    path.write_bytes(b"".join(lines))
    with pytest.raises(InputError) as error:
        Journal(path)
    assert f"journal.jsonl is damaged: {words}" in str(error.value)
    assert "\n" not in str(error.value)
    assert path.read_bytes() == b"".join(lines)
    assert list(path.parent.iterdir()) == [path]


def test_lines_of_another_journal_are_refused(path: Path, tmp_path: Path) -> None:
    """Of another run, and of the same one in a copy of its directory that went another way."""
    copy = tmp_path / "copy.jsonl"
    copy.write_bytes(path.read_bytes())
    for journal, tower in ((Journal(path), 3), (Journal(copy), 4)):
        for _ in range(2):
            journal.append("label", plan=tower)
        journal.close()
    mine, theirs = (p.read_bytes().splitlines(keepends=True) for p in (path, copy))
    path.write_bytes(b"".join([*mine[:5], theirs[5]]))
    with pytest.raises(InputError, match="line 6 of 6 does not follow line 5"):
        Journal(path)
    path.write_bytes(b"".join(mine))
    with pytest.raises(InputError, match=r"is the journal of run , and by run\.yaml this run is 12ab"):
        Journal(path, run="12ab")


@pytest.mark.parametrize("which", ["all", "the last", "the first"])
def test_line_ends_of_windows_are_named_and_nothing_is_cut(path: Path, which: str) -> None:
    lines = path.read_bytes().splitlines(keepends=True)
    wrong = {"all": range(4), "the last": [3], "the first": [0]}[which]
    text = b"".join(line.replace(b"\n", b"\r\n") if n in wrong else line for n, line in enumerate(lines))
    path.write_bytes(text)
    with pytest.raises(InputError, match=rf"line {wrong[0] + 1} ends as Windows ends lines \(CRLF\).*dos2unix"):
        Journal(path)
    assert path.read_bytes() == text


@pytest.mark.parametrize(
    ("number", "words"), [(7, "has format 7, .* reads format 6: it takes a newer apf"), (1, "older")]
)
def test_another_format_is_refused(path: Path, number: int, words: str) -> None:
    line, crc = encode({"kind": "journal", "format": number, "run": ""}, "")
    path.write_bytes(line + encode({"kind": "future"}, crc)[0])
    with pytest.raises(InputError, match=words):
        Journal(path)


def test_a_journal_without_a_first_line_is_of_an_older_version(path: Path) -> None:
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[1:]))
    with pytest.raises(InputError, match=r"has format 1, .* reads format 6: it takes an older apf"):
        Journal(path)


def test_lines_that_were_known_to_be_there_are_missed(path: Path) -> None:
    """The chain alone cannot tell that its last lines are gone."""
    journal = Journal(path)
    end = journal.end
    journal.close()
    assert end == End(4, json.loads(path.read_text().splitlines()[-1])["crc"])
    lines = path.read_bytes().splitlines(keepends=True)
    for text in (b"".join(lines[:3]), b"".join(lines)[:-7]):
        path.write_bytes(text)
        with pytest.raises(InputError, match=r"damaged: line 4 is missing; by run\.yaml there were 4 lines"):
            Journal(path, known=end)
        assert path.read_bytes() == text
    path.write_bytes(b"".join(lines[:3]))
    journal = Journal(path)
    journal.append("label", plan=9)
    journal.append("label", plan=10)
    journal.close()
    with pytest.raises(InputError, match="damaged: line 4 is another one"):
        Journal(path, known=end)
    path.write_bytes(b"".join(lines))
    journal = Journal(path, known=end)
    journal.append("label", plan=3)
    journal.close()
    assert len(Journal(path, known=end).records) == 4


def test_an_empty_journal_is_refused(path: Path) -> None:
    path.write_bytes(b"")
    with pytest.raises(InputError, match="is empty, and all labels are missing with it"):
        Journal(path)


@pytest.mark.parametrize("byte", [0, 20, 60, 100])
def test_damage_elsewhere_names_the_line(path: Path, byte: int) -> None:
    lines = path.read_bytes().splitlines(keepends=True)
    at = len(lines[0]) + len(lines[1]) + byte
    whole = b"".join(lines)
    path.write_bytes(whole[:at] + b"\xff" + whole[at + 1 :])
    with pytest.raises(InputError, match=r"journal\.jsonl is damaged: line 3 of 4"):
        Journal(path)
    assert len(path.read_bytes()) == len(whole), "nothing is cut off"


def test_every_flipped_bit_before_the_last_line_is_noticed(path: Path) -> None:
    whole = path.read_bytes()
    last = len(whole.splitlines(keepends=True)[-1])
    for at in range(len(whole) - last):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1 << at % 8]) + whole[at + 1 :])
        with pytest.raises(InputError, match="is damaged: line"):
            Journal(path)


def test_another_file_is_not_taken_for_a_journal(path: Path) -> None:
    for text in (b"SQLite format 3\0\n" + path.read_bytes(), b"notes", b"notes\n", b"\n"):
        path.write_bytes(text)
        with pytest.raises(InputError, match="line 1 of"):
            Journal(path)
        assert path.read_bytes() == text


def test_text_that_looks_like_the_end_of_a_line_is_only_text(path: Path) -> None:
    journal = Journal(path)
    reason = 'he said: ", "crc": "00000000"}\n{"kind": "label"'
    journal.append("correction", reason=reason)
    journal.close()
    assert read(path)[-1]["reason"] == reason
    path.write_bytes(path.read_bytes()[:-4])
    assert len(read(path)) == 3, "torn, not damaged"


def test_a_new_journal_takes_the_place_of_an_old_one_at_once(path: Path) -> None:
    create(path, "12ab")
    journal = Journal(path, run="12ab")
    assert journal.records == []
    journal.close()
    assert list(path.parent.iterdir()) == [path]


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
        journal.append("label", plan=3)
    monkeypatch.undo()
    assert path.read_bytes() == before
    journal.append("label", plan=4)
    journal.close()
    assert [record["plan"] for record in read(path)] == [0, 1, 2, 4]


def test_a_record_that_cannot_be_taken_back_is_the_last(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else the next one would stand in the same line."""
    journal = Journal(path)
    write = os.write

    def fail(*args: object) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "write", lambda file, data: write(file, data[:30]))
    monkeypatch.setattr(os, "fsync", fail)
    monkeypatch.setattr(os, "ftruncate", fail)
    with pytest.raises(Stopped, match="Input/output error"):
        journal.append("label", plan=3)
    monkeypatch.undo()
    with pytest.raises(Stopped, match="cannot be written"):
        journal.append("label", plan=4)
    journal.close()
    assert [record["plan"] for record in read(path)] == [0, 1, 2, 3]


def test_seconds_add_up_over_all_starts(path: Path) -> None:
    seconds = [record["seconds"] for record in read(path)]
    assert seconds == sorted(seconds)
    journal = Journal(path)
    journal._before = 100.0
    journal.append("label", plan=3)
    journal.close()
    assert 100 <= Journal(path).seconds < 101


def test_a_file_that_cannot_be_opened(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="Is a directory"):
        Journal(tmp_path)
