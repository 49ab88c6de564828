"""An append-only file of checksummed records. Appended records survive a crash of the process and a power cut.

Each line is a JSON object, in the order of events. `at` is the time of the record. `seconds` is the run's time by then,
all its starts together. `follows` is the checksum of the line before. `crc`, the last key, is the CRC-32 of its line up
to this key. So the lines are a chain: a line that is missing, doubled, swapped or of another journal is found. The
first line names the format of the file and the run; this line has the same form in every format.

A write that was cut short tears the last line. The next opening moves the torn line into a file of its own beside the
journal. No crash explains more damage than that: such a journal is refused, and the message names the line.
"""

import contextlib
import json
import os
import time
import zlib
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from apf.errors import InputError, Stopped
from apf.rundir.files import replacing

Record = dict[str, Any]
FORMAT = 6
"""Format of the journals that this version writes and reads."""
HEADER = 1
"""Number of lines before the first record."""
BEGINS = '{"kind": "journal", '
"""How each journal begins."""
MARK = b', "crc": "'
"""Comes before the checksum, once in each line: quotes within a text are escaped."""


@dataclass(frozen=True)
class End:
    """The end of a journal: its number of lines, and the checksum of the last one."""

    lines: int
    crc: str


class Journal:
    """Records in memory and on disk. A record is on disk before `append` returns."""

    def __init__(self, path: Path, run: str = "", known: End | None = None) -> None:
        """Open or begin the file.

        Args:
            path: Of the file.
            run: Identifier of the run that the journal must belong to.
            known: The end of the journal as `run.yaml` has it; the lines up to there must still be the same.

        Raises:
            InputError: The file is damaged, of another run, or cannot be written.
        """
        self.path = path
        try:
            if not path.exists():
                create(path, run)
            self._file = os.open(path, os.O_RDWR | os.O_APPEND | getattr(os, "O_BINARY", 0))
            text = path.read_bytes()
        except OSError as error:
            raise InputError(f"{path}: cannot be opened: {error.strerror}") from None
        try:
            contents = parse(text, path, run, known)
            self.torn = keep_aside(path, contents.torn) if contents.torn else None
            """The file that keeps the torn last line; None: no line was torn."""
            if contents.torn:
                os.ftruncate(self._file, contents.size)
            elif contents.size > len(text):  # all but the end of the last line
                os.write(self._file, b"\n")
            if contents.size != len(text):
                os.fsync(self._file)
        except OSError as error:
            os.close(self._file)
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None
        except InputError:
            os.close(self._file)
            raise
        self.records, self._size, self._crcs = contents.records, contents.size, contents.crcs
        self._broken = False
        self._before = self.records[-1].get("seconds", 0.0) if self.records else 0.0
        self._opened = time.monotonic()

    @property
    def notice(self) -> str | None:
        """One line for the user about a torn line that was found on opening; None: there was none."""
        if self.torn is None:
            return None
        return f"the last record of the journal was torn: what it held is done again; {self.torn.name} keeps the rest"

    @property
    def end(self) -> End:
        """The end of the journal as it is now."""
        return End(len(self._crcs), self._crcs[-1])

    @property
    def seconds(self) -> float:
        """Seconds of the run: those of earlier starts, each up to its last record, and those since this start."""
        return round(self._before + time.monotonic() - self._opened, 3)

    def append(self, kind: str, **content: Any) -> Record:
        """Write a record, synced to the disk. If that fails, the file stays as before, and Stopped is raised."""
        record = {"kind": kind, **content, "at": now(), "seconds": self.seconds}
        line, crc = encode(record, self._crcs[-1])
        if self._broken:
            raise Stopped(f"{self.path}: cannot be written: an earlier record is there in part")
        try:
            rest = memoryview(line)
            while rest:
                rest = rest[os.write(self._file, rest) :]
            os.fsync(self._file)
        except OSError as error:
            self._broken = True
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._size)
                self._broken = False
            raise Stopped(f"{self.path}: cannot be written: {error.strerror}") from None
        self._size += len(line)
        self._crcs.append(crc)
        self.records.append(record)
        return record

    def close(self) -> None:
        """Release the file."""
        os.close(self._file)


def create(path: Path, run: str) -> None:
    """Begin the journal of a run, in one step. An older file there is replaced."""
    with replacing(path) as half:
        half.write_bytes(encode({"kind": "journal", "format": FORMAT, "run": run, "at": now()}, "")[0])


def now() -> str:
    """The time now, in the form that records have."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def encode(record: Record, follows: str) -> tuple[bytes, str]:
    """A record as its line, and the checksum of the line. follows: the checksum of the line before."""
    text = json.dumps({**record, "follows": follows}, ensure_ascii=False, allow_nan=False)[:-1].encode()
    crc = f"{zlib.crc32(text):08x}"
    return text + MARK + crc.encode() + b'"}\n', crc


def keep_aside(path: Path, torn: bytes) -> Path:
    """Write what will be cut off a journal into a new file beside it, durably. Returns its path."""
    number = 1
    while os.path.lexists(aside := path.with_name(f"{path.stem}.torn-{number}{path.suffix}")):
        number += 1
    with replacing(aside) as half:
        half.write_bytes(torn)
    return aside


@dataclass
class Contents:
    """What a journal's file holds.

    records: all but the first line. crcs: of each line. size: bytes that they take, the last line end included.
    torn: what is behind them.
    """

    records: list[Record] = field(default_factory=list)
    crcs: list[str] = field(default_factory=list)
    size: int = 0
    torn: bytes = b""


def parse(text: bytes, path: Path, run: str = "", known: End | None = None) -> Contents:
    """What is written in a journal; arguments as `Journal` takes them.

    Raises InputError, naming the first line that is wrong, unless it is the last one and may have been torn.

    Args:
        text: The bytes of the file.
        path: Of the file, for messages.
        run: The id of the run.
        known: Where the journal ended when the run finished, if it has.
    """
    lines = text.split(b"\n")
    total = len(lines) - (not lines[-1])
    contents = Contents()
    for number, line in enumerate(lines[:total], 1):
        found = _decode(line)
        if found is None:
            if line.endswith(b"\r") and _decode(line[:-1]):
                raise InputError(
                    f"{path}: line {number} ends as Windows ends lines (CRLF); an editor, git or a mail program has "
                    f"changed the file; change it back, e.g. with dos2unix: no record is lost"
                )
            if number == total and number > HEADER and line.count(MARK) < 2:
                contents.torn = text[contents.size :]
                break
            raise _damaged(path, number, f" of {total} is not what was written")
        record, follows, crc = found
        if number == HEADER:
            _check_header(record, path, run)
        elif follows != contents.crcs[-1]:
            twice = f" is line {contents.crcs.index(crc) + 1} once more" if crc in contents.crcs else ""
            between = "; lines are missing or swapped, or it is of another journal"
            raise _damaged(path, number, twice or f" of {total} does not follow line {number - 1}{between}")
        else:
            contents.records.append(record)
        contents.crcs.append(crc)
        contents.size += len(line) + 1
    have = len(contents.crcs)
    if not have:
        raise InputError(f"{path} is empty, and all labels are missing with it; put back a copy of the file")
    if known and (have < known.lines or contents.crcs[known.lines - 1] != known.crc):
        wrong = f"line {have + 1} is missing" if have < known.lines else f"line {known.lines} is another one"
        raise InputError(
            f"{path} is damaged: {wrong}; by run.yaml there were {known.lines} lines; put back a copy of the file, or "
            "remove `journal` from run.yaml: what is missing is then done again"
        )
    return contents


def _decode(line: bytes) -> tuple[Record, str, str] | None:
    """The record of a line, the checksum of the line before it, and its own; None if it is not what was written."""
    body, mark, rest = line.rpartition(MARK)
    crc = f"{zlib.crc32(body):08x}"
    if not mark or rest != crc.encode() + b'"}':
        return None
    try:
        record = json.loads(body + b"}")
        return record, record.pop("follows", ""), crc
    except (ValueError, AttributeError):
        return None


def _check_header(record: Record, path: Path, run: str) -> None:
    written = record.get("format", 1)
    if record.get("kind") != "journal" or written != FORMAT:
        needed = "a newer" if isinstance(written, int) and written > FORMAT else "an older"
        raise InputError(
            f"{path} has format {written}, and this version of apf reads format {FORMAT}: it takes {needed} apf, "
            "as `versions` in run.yaml names it"
        )
    if record.get("run") != run:
        raise InputError(
            f"{path} is the journal of run {record.get('run')}, and by run.yaml this run is {run}: put back its own"
        )


def _damaged(path: Path, number: int, what: str) -> InputError:
    rest = f", or keep the {number - 1} lines before it and no others: what they lack is then done again"
    return InputError(
        f"{path} is damaged: line {number}{what}; put back a copy of the file{rest if number > 1 else ''}"
    )
