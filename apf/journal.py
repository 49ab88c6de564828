"""An append-only file of checksummed records: whatever was appended survives what ends the process or the power.

One JSON object a line, in the order of events. `at` is when, `seconds` how long the run had been running by then, all
its starts together; `crc`, the last key, is the CRC-32 of the line up to it. A torn last line is cut off on opening;
any other line that does not fit its checksum is damage that no crash explains, and is refused.
"""

import contextlib
import json
import os
import time
import zlib
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from apf.errors import InputError, Stopped
from apf.files import sync

Record = dict[str, Any]


class Journal:
    """Records in memory and on disk. A record is on disk before `append` returns."""

    def __init__(self, path: Path) -> None:
        """Open or begin the file. Raises InputError if it is damaged or cannot be written."""
        self.path = path
        try:
            new = not path.exists()
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
            if new:
                sync(path.parent)
            text = path.read_bytes()
        except OSError as error:
            raise InputError(f"{path}: cannot be opened: {error.strerror}") from None
        self.records, self._size = parse(text, path)
        self.torn = self._size < len(text)
        """Was something cut off, that had not been completely written?"""
        if self.torn:
            os.ftruncate(self._file, self._size)
            os.fsync(self._file)
        self._before = self.records[-1]["seconds"] if self.records else 0.0
        self._opened = time.monotonic()

    @property
    def seconds(self) -> float:
        """How long the run has been running, up to the last record of each earlier start, and since this one."""
        return round(self._before + time.monotonic() - self._opened, 3)

    def append(self, kind: str, **content: Any) -> Record:
        """Make a record durable. Raises Stopped, the file being as before, if it cannot be written."""
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        record = {"kind": kind, **content, "at": now, "seconds": self.seconds}
        line = encode(record)
        try:
            if (written := os.write(self._file, line)) < len(line):
                os.write(self._file, line[written:])
            os.fsync(self._file)
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._size)
            raise Stopped(f"{self.path}: cannot be written: {error.strerror}") from None
        self._size += len(line)
        self.records.append(record)
        return record

    def close(self) -> None:
        """Release the file."""
        os.close(self._file)


def encode(record: Record) -> bytes:
    """A record as its line."""
    text = json.dumps(record, ensure_ascii=False, allow_nan=False)[:-1]
    return f'{text}, "crc": "{zlib.crc32(text.encode()):08x}"}}\n'.encode()


def parse(text: bytes, path: Path) -> tuple[list[Record], int]:
    """The records of a journal, and how many bytes they take: what was torn at its end is left out.

    Raises InputError if a line is not what was written, and whole ones follow it.
    """
    lines = text.split(b"\n")
    decoded = [_decode(line) for line in lines[:-1]]
    whole = next((n for n, record in enumerate(decoded) if record is None), len(decoded))
    if any(decoded[whole:]):
        raise InputError(
            f"{path} is damaged: line {whole + 1} of {len(decoded)} is not what was written; put back a copy of the "
            f"file, or keep the {whole} lines before it and no others: what they lack is then done again"
        )
    records = [record for record in decoded[:whole] if record is not None]
    return records, sum(len(line) + 1 for line in lines[:whole])


def _decode(line: bytes) -> Record | None:
    body, mark, rest = line.rpartition(b', "crc": "')
    if not mark or rest != b'%08x"}' % zlib.crc32(body):
        return None
    record: Record = json.loads(body + b"}")
    return record
