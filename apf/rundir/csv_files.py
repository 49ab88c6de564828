"""CSV files as people have them, read as text: any usual separator and encoding, with rows named as an editor counts.

pyarrow reads a file that is regular. One that is not is read again, row by row, with Python's csv module: that one
knows the line of each row, and says which is wrong.
"""

import codecs
import csv
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
from pyarrow.csv import ConvertOptions, ParseOptions, ReadOptions, read_csv

from apf.errors import InputError

SEPARATORS = (",", ";", "\t", "|")
HEAD = 1 << 20
"""The header and the first row must lie within the first so many bytes."""
ENCODINGS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
"""By the marks that files begin with; those without one must be UTF-8."""


@dataclass(frozen=True)
class CsvFile:
    """The layout of one CSV file. `lines` is the number of lines up to and with the header."""

    path: Path
    encoding: str
    separator: str
    headers: tuple[str, ...]
    lines: int
    width: int

    def read(self) -> list[pa.ChunkedArray]:
        """A column of text for each header: without blanks around values, null where nothing stands.

        Rows that are blank in all columns are left out. Raises InputError, naming the row, for one that has more or
        fewer fields than the header; separators at the end of a row are allowed.
        """
        columns = self._read_regular()
        return self._read_irregular() if columns is None else columns

    def row(self, index: int) -> int:
        """The line in the file [from 1] of a row of `read` [from 0]."""
        return next(line for i, (line, _) in enumerate(self._rows(strict=False)) if i == index)

    def _read_regular(self) -> list[pa.ChunkedArray] | None:
        """None if not all rows are as wide as the first, or another thing looks odd."""
        if self.width < len(self.headers):
            return None
        names = [str(i) for i in range(self.width)]
        try:
            table = read_csv(
                self.path,
                ReadOptions(
                    column_names=names,
                    skip_rows=self.lines,
                    encoding=self.encoding.removesuffix("-sig"),
                    block_size=4 << 20,
                ),
                ParseOptions(delimiter=self.separator, newlines_in_values=True),
                ConvertOptions(column_types=dict.fromkeys(names, pa.string())),
            )
        except (ValueError, pa.ArrowException):
            return None
        columns = [_trimmed(column) for column in table.columns]
        del table
        further = columns[len(self.headers) :]
        if any(column.null_count < len(column) for column in further):
            return None
        if any(pc.any(pc.match_substring_regex(column, r"[\r\n]")).as_py() for column in columns):
            return None  # a quote may have been opened and not closed, and rows taken for a part of the value
        columns = columns[: len(self.headers)]
        if all(column.null_count for column in columns):
            blank = pc.is_null(columns[0])
            for column in columns[1:]:
                blank = pc.and_(blank, pc.is_null(column))
            columns = [column.filter(pc.invert(blank)) for column in columns]
        return columns

    def _read_irregular(self) -> list[pa.ChunkedArray]:
        width = len(self.headers)
        rows = []
        for line, fields in self._rows(strict=True):
            while len(fields) > width and not fields[-1].strip():
                fields.pop()
            if len(fields) != width:
                remedy = (
                    "are these decimal commas? Write 0.1, or separate columns by ;"
                    if self.separator == "," and len(fields) > width
                    else "a separator too many?"
                    if len(fields) > width
                    else "a separator is missing, or a row was broken in two"
                )
                raise InputError(
                    f"{self.path}, row {line}: {len(fields)} field{'s' * (len(fields) != 1)}, "
                    f"where the header has {width}; {remedy}"
                )
            rows.append(fields)
        return [
            _trimmed(pa.chunked_array([pa.array([fields[i] for fields in rows], pa.string())])) for i in range(width)
        ]

    def _rows(self, strict: bool) -> Iterator[tuple[int, list[str]]]:
        """The rows that are not blank, each with the line that it begins in."""
        line = self.lines + 1
        try:
            with self.path.open(encoding=self.encoding, newline="") as file:
                for _ in range(self.lines):
                    file.readline()
                rows = csv.reader(file, delimiter=self.separator, strict=strict)
                for fields in rows:
                    if any(map(str.strip, fields)):
                        yield line, fields
                    line = self.lines + rows.line_num + 1
        except csv.Error:
            raise InputError(
                f'{self.path}, row {line}: a quotation mark (") is opened and not closed, or closes too early'
            ) from None
        except UnicodeError:
            raise _not_text(self.path, self.encoding) from None


def open_csv(path: Path, wanted: Callable[[str], bool], needed: str) -> CsvFile:
    """The layout of a CSV file: its encoding, its separator, and the header below blank lines and comments (#).

    Args:
        path: the file.
        wanted: is this header one of the columns that the caller looks for? The separator is the one that gives most.
        needed: these columns, in words.

    Raises InputError if the file is no text, or none of the columns is found; OSError if it cannot be read.
    """
    with path.open("rb") as file:
        start = file.read(HEAD)
    encoding = next((name for mark, name in ENCODINGS.items() if start.startswith(mark)), "utf-8")
    try:
        text = codecs.getincrementaldecoder(encoding)().decode(start, final=len(start) < HEAD)
    except UnicodeError:
        raise _not_text(path, encoding) from None
    if "\0" in text:
        raise InputError(f"{path}: cannot be read as a table: it is no text; save it as CSV (UTF-8)")
    return _layout(path, encoding, text, wanted, needed)


def _layout(path: Path, encoding: str, text: str, wanted: Callable[[str], bool], needed: str) -> CsvFile:
    skipped, given, first = 0, "", None
    lines = list(io.StringIO(text, newline=""))
    for skipped, line in enumerate(lines):
        bare = line.strip().strip('"')
        if match := re.fullmatch(r"(?i)sep=([^\s\w\"]|\t)[,;\t|]*", line.strip(" \r\n").strip('"')):
            given = match[1]
        elif not bare.strip("".join(SEPARATORS) + ' "'):
            continue
        elif bare.startswith("#"):
            below = _split(lines[skipped:], given, wanted, bare.lstrip("# "))
            if sum(map(wanted, below[1])) > 1:  # a header behind a #, as numpy.savetxt writes it
                first = below
                break
        else:
            first = _split(lines[skipped:], given, wanted, line)
            break
    if first is None:
        raise InputError(f"{path}: cannot be read as a table: it is empty")
    separator, headers, used, width = first
    if not any(map(wanted, headers)):
        raise InputError(
            f"{path}, row {skipped + 1}: no column names there; the first row must name the columns {needed}, "
            "separated by commas, semicolons or tabs (comments begin with #)"
        )
    while not headers[-1].strip():
        headers.pop()
    return CsvFile(path, encoding, separator, tuple(headers), skipped + used, width or len(headers))


def _split(lines: list[str], given: str, wanted: Callable[[str], bool], first: str) -> tuple[str, list[str], int, int]:
    """Separator, headers, the lines that they take, and how many fields the first row below has (0: there is none)."""
    best: tuple[str, list[str], int, int] = (",", [], 1, 0)
    for separator in dict.fromkeys([*given, *SEPARATORS]):
        rows = csv.reader([first, *lines[1:]], delimiter=separator)
        try:
            headers = next(rows)
            used = rows.line_num
            below = next((len(fields) for fields in rows if any(map(str.strip, fields))), 0)
        except csv.Error:
            continue
        if sum(map(wanted, headers)) > sum(map(wanted, best[1])):
            best = separator, headers, used, below
    return best


def _trimmed(column: pa.ChunkedArray) -> pa.ChunkedArray:
    column = pc.utf8_trim_whitespace(column)
    return pc.if_else(pc.equal(column, ""), pa.scalar(None, pa.string()), column)


def _not_text(path: Path, encoding: str) -> InputError:
    """What to say of a file that does not decode: the row, where one can be told."""
    where = ""
    if encoding.startswith("utf-8"):
        with path.open("rb") as file:
            for line, content in enumerate(file, start=1):
                try:
                    content.decode("utf-8")
                except UnicodeError:
                    where = f" in row {line}"
                    break
    return InputError(
        f"{path}: cannot be read as a table: it is not {encoding.removesuffix('-sig').upper()} text{where}; "
        "save it as CSV UTF-8"
    )
