"""Tables on disk, CSV or parquet by their ending: read as people have them, written whole or not at all.

Whatever is wrong with a file that is read is one InputError, which names file, row, column and remedy.
"""

import difflib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow.parquet import ParquetFile

from apf.errors import InputError
from apf.rundir.csv_files import open_csv
from apf.rundir.files import make_folder, replacing

PARTS = {"m": {"m": 1, "dm": 10, "cm": 100, "mm": 1000}, "kg": {"kg": 1, "g": 1000}}
"""The units that a header may name, by the unit that a column is read in: how many of one are one of the other."""
NUMBER = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$"
THOUSANDS = r"[+-]?\d{1,3}([.,' \u00a0\u2009\u202f\u2019]\d{3})+([.,]\d+)?"
WITH_UNIT = r"[+-]?[\d.,]+([eE][+-]?\d+)?\s*([a-zA-Z]{1,2})"


@dataclass(frozen=True)
class Names:
    """A column of names: the distinct ones, in the order of the file, and which of them each of R rows holds [R]."""

    distinct: tuple[Any, ...]
    codes: np.ndarray


@dataclass(frozen=True)
class Table:
    """The columns of a file that were asked for, R rows each.

    numbers: finite doubles [R] by column, in the units that were asked for. names: by column.
    units: the unit that each header names, where it names one. row: the row in the file of an index in 0..R - 1, as an
    editor counts (the header is 1).
    """

    path: Path
    numbers: dict[str, np.ndarray]
    names: dict[str, Names]
    units: dict[str, str]
    row: Callable[[int], int]

    def __len__(self) -> int:
        return len(next(iter(self.numbers.values())))

    def stack(self, columns: Sequence[str]) -> np.ndarray:
        """[R, columns]: the numbers of several columns."""
        return np.column_stack([self.numbers[column] for column in columns])

    def numbered(self, column: str, known: Sequence[str]) -> np.ndarray:
        """[R]: for each row, the place of its name among those that are known.

        Args:
            column: Of names, e.g. of objects.
            known: Names of all objects.

        Raises:
            InputError: A name is not among them; names the first such row.
        """
        names, number = self.names[column], {name: i for i, name in enumerate(known)}
        for code, name in enumerate(names.distinct):
            if str(name) not in number:
                row = int(np.argmax(names.codes == code))
                raise self.error(row, f"{column} {shown(name)} is not among the objects: {shown(', '.join(known))}")
        return np.array([number[str(name)] for name in names.distinct])[names.codes]

    def error(self, index: int, what: str) -> InputError:
        """What is wrong with a row, given by its index."""
        return InputError(f"{self.path}, row {self.row(int(index))}: {what}")


def check_ending(path: Path) -> None:
    """Raises InputError unless the file's ending is .csv or .parquet."""
    if path.suffix not in (".csv", ".parquet"):
        raise InputError(f"{path}: the ending must be .csv or .parquet")


def read_table(path: Path, numbers: Sequence[str], names: Sequence[str], units: Mapping[str, str]) -> Table:
    """The named columns of a CSV or parquet file.

    Args:
        path: the file. CSV may have other separators than commas (then also decimal commas), comments above the
            header, and any usual encoding. The index of a parquet file counts as columns.
        numbers: columns of numbers.
        names: columns of names; those of CSV and of text are text.
        units: the unit of each column that has one. Headers may carry it, as in `dim_x [m]`, or another of `PARTS`, as
            in `dim_x [mm]`: its values are then divided by so many.

    Raises InputError, naming file, row and column, if the file cannot be read, a column is missing or stands twice, a
    header names a unit that is not known, a row has too many or few fields, a value is no finite number, or a name is
    empty or has line breaks or other control characters in it.
    """
    check_ending(path)
    try:
        return _read(path, numbers, names, units)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError, NotImplementedError, pa.ArrowException) as error:
        reason = getattr(error, "strerror", None) or next(iter(str(error).splitlines()), type(error).__name__)
        raise InputError(f"{path}: cannot be read as a table: {shown(reason, 300)}") from None


def _read(path: Path, numbers: Sequence[str], names: Sequence[str], units: Mapping[str, str]) -> Table:
    """As `read_table`; what is wrong with bytes rather than values is still a library's exception."""
    needed = [*names, *numbers]
    headers, columns, row, decimal_comma = (_read_csv if path.suffix == ".csv" else _read_parquet)(path, needed)
    place, given = _find(path, headers, needed, units)
    found = {column: _flat(path, column, columns[place[column]]) for column in needed}
    del columns
    table = Table(path, {}, {}, given, row)
    for column in names:
        table.names[column] = _names(table, column, found.pop(column))
    table.numbers.update(_numbers(table, found, decimal_comma))
    for column, unit in given.items():
        if column in table.numbers and PARTS[units[column]][unit] != 1:
            table.numbers[column] /= PARTS[units[column]][unit]
    return table


def write_table(table: pd.DataFrame, path: Path, units: Mapping[str, str] | None = None) -> None:
    """Write a CSV or parquet file, replacing it in one step; with `units`, headers carry them.

    Raises InputError if the ending is another, or the file cannot be written.

    Args:
        table: What to write.
        path: A .csv or .parquet file.
        units: Of columns; None: headers without units.
    """
    check_ending(path)
    if units:
        table = table.rename(columns={c: f"{c} [{unit}]" for c, unit in units.items()})
    try:
        make_folder(path.parent)
        with replacing(path) as half:
            if path.suffix == ".csv":
                table.to_csv(half, index=False)
            else:
                table.to_parquet(half, index=False)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def shown(value: object, length: int = 60) -> str:
    """A value of a file, for a message: in one line, and no longer than `length`."""
    text = "(empty)" if value is None else str(value)
    text = text if text.isprintable() else ascii(text)
    return text if len(text) <= length else f"{text[: length - 3]}..."


Content = tuple[list[str], Mapping[int, pa.ChunkedArray], Callable[[int], int], bool]
"""Headers, columns by their place among them, the row of an index, and whether numbers may have decimal commas."""


def _read_csv(path: Path, needed: Sequence[str]) -> Content:
    file = open_csv(path, lambda header: _name_and_unit(header)[0] in needed, ", ".join(needed))
    headers = list(file.headers)
    return headers, dict(enumerate(file.read())), file.row, file.separator != ","


def _read_parquet(path: Path, needed: Sequence[str]) -> Content:
    """What pandas stores of its own is left alone: an index that it keeps as columns is found among them."""
    with ParquetFile(path) as file:
        headers = [str(name) for name in file.schema_arrow.names]
        kept = sorted({h for h in headers if _name_and_unit(h)[0] in needed})
        table = file.read(columns=kept)
    columns = {headers.index(name): table.column(i) for i, name in enumerate(table.column_names)}
    for name, values in _counted_index(table).items():
        if name in needed and name not in headers:
            columns[len(headers)] = values
            headers.append(name)
    return headers, columns, lambda index: index + 2, True


def _counted_index(table: pa.Table) -> dict[str, pa.ChunkedArray]:
    """An index that counts, which pandas keeps as its name, start and step alone."""
    try:
        (index,) = json.loads((table.schema.metadata or {})[b"pandas"])["index_columns"]
        start, step = int(index["start"]), int(index["step"])
        return {index["name"]: pa.chunked_array([start + step * np.arange(table.num_rows)])}
    except (KeyError, TypeError, ValueError, OverflowError):
        return {}


def _name_and_unit(header: str) -> tuple[str, str | None]:
    match = re.fullmatch(r"\s*(\w+)\s*(?:[\[(]\s*(\S+?)\s*[\])])?\s*", header)
    return (match[1], match[2]) if match else (header.strip(), None)


def _find(
    path: Path, headers: Sequence[str], needed: Sequence[str], units: Mapping[str, str]
) -> tuple[dict[str, int], dict[str, str]]:
    """The place of each column among the headers, and the unit that its header names, if it names one."""
    place: dict[str, int] = {}
    given: dict[str, str] = {}
    for i, header in enumerate(headers):
        name, unit = _name_and_unit(header)
        if name not in needed:
            continue
        if name in place:
            raise InputError(f"{path}: column {name} stands twice")
        place[name] = i
        if unit and name in units:
            if unit not in PARTS[units[name]]:
                raise InputError(
                    f"{path}: column {name} is in {shown(unit)}; it must be in {' or '.join(PARTS[units[name]])}"
                )
            given[name] = unit
    missing = [column for column in needed if column not in place]
    if missing:
        others = {h.strip().lower(): h for h in headers if h.strip() and _name_and_unit(h)[0] not in needed}
        close = difflib.get_close_matches(missing[0].lower(), others, n=1)
        remedy = (
            f"did you mean it by {shown(others[close[0]])}? Its header must be {missing[0]}"
            + (f" or, say, {missing[0]} [{list(PARTS[units[missing[0]]])[-1]}]" if missing[0] in units else "")
            if close
            else f"there are {shown(', '.join(h for h in headers if h.strip()), 300)}"
        )
        raise InputError(f"{path}: column {', '.join(missing)} is missing; {remedy}")
    return place, given


def _flat(path: Path, column: str, values: pa.ChunkedArray) -> pa.ChunkedArray:
    """The values as numbers or text. Raises InputError if the column holds anything else."""
    if pa.types.is_dictionary(values.type):
        values = values.cast(values.type.value_type)
    kind = values.type
    if pa.types.is_decimal(kind):
        return values.cast(pa.string())  # whose reading rounds correctly
    if pa.types.is_integer(kind) or pa.types.is_floating(kind):
        return values
    if (
        pa.types.is_null(kind)
        or pa.types.is_string(kind)
        or pa.types.is_large_string(kind)
        or str(kind) == "string_view"
    ):
        return values.cast(pa.large_string() if pa.types.is_large_string(kind) else pa.string())
    raise InputError(f"{path}: column {column} holds values of type {shown(kind)}; it must hold numbers or text")


def _names(table: Table, column: str, values: pa.ChunkedArray) -> Names:
    text = _is_text(values)
    if text and table.path.suffix == ".parquet":
        values = pc.utf8_trim_whitespace(values)
        values = pc.if_else(pc.equal(values, ""), pa.scalar(None, values.type), values)
    elif pa.types.is_floating(values.type):
        values = pc.if_else(pc.is_nan(values), pa.scalar(None, values.type), values)
    if values.null_count:
        raise table.error(_first(pc.is_null(values)), f"{column} is empty; it needs a name")
    encoded = pc.dictionary_encode(values.combine_chunks())
    encoded = encoded.combine_chunks() if isinstance(encoded, pa.ChunkedArray) else encoded
    codes, distinct = encoded.indices.to_numpy(), encoded.dictionary
    if text:
        odd = pc.match_substring_regex(distinct, r"\p{Cc}|\p{Zl}|\p{Zp}")
        if pc.any(odd).as_py():
            code = _first(odd)
            what = f"{column} = {distinct[code].as_py()!a}; a name must not hold line breaks or control characters"
            raise table.error(int(np.argmax(codes == code)), what)
    return Names(tuple(distinct.to_pylist()), codes)


def _numbers(table: Table, columns: Mapping[str, pa.ChunkedArray], decimal_comma: bool) -> dict[str, np.ndarray]:
    """Doubles, each the nearest to what is written."""
    try:
        numbers = {column: _doubles(values) for column, values in columns.items()}
    except pa.ArrowInvalid:
        numbers = {}
    if not numbers:
        texts = {column: values for column, values in columns.items() if _is_text(values)}
        commas, points = (sum(_count(v, mark) for v in texts.values()) for mark in (",", "."))
        swap = decimal_comma and commas > points
        for column, values in columns.items():
            if column in texts:
                texts[column] = values = _pointed(table, column, values, swap)
            numbers[column] = _doubles(values)
    for column, found in numbers.items():
        bad = ~np.isfinite(found)
        if bad.any():
            index = int(np.argmax(bad))
            raise _no_number(table, column, index, columns[column][index].as_py(), "")
    return numbers


def _doubles(values: pa.ChunkedArray) -> np.ndarray:
    return np.array(values.cast(pa.float64(), safe=False).to_numpy(), float)


def _pointed(table: Table, column: str, values: pa.ChunkedArray, swap: bool) -> pa.ChunkedArray:
    """Text with decimal points; `swap`: the file's numbers have commas. Raises InputError for what is no number."""
    bare = pc.utf8_trim_whitespace(values)
    wrong = pc.invert(pc.match_substring_regex(bare, NUMBER.replace(r"\.", ",") if swap else NUMBER))
    wrong = pc.and_(pc.fill_null(wrong, False), pc.not_equal(pc.fill_null(bare, ""), ""))
    if pc.any(wrong).as_py():
        index = _first(wrong)
        value = bare[index].as_py()
        raise _no_number(table, column, index, value, _remedy(value, swap, column))
    bare = pc.if_else(pc.equal(bare, ""), pa.scalar(None, bare.type), bare)
    return pc.replace_substring(bare, ",", ".") if swap else bare


def _remedy(value: str, swap: bool, column: str) -> str:
    """What to do about text that is no number, where it can be guessed."""
    if (re.fullmatch(THOUSANDS, value) and len(re.sub(r"[\d+-]", "", value)) > 1) or (swap and "." in value):
        return ", without thousands separators" + (" (other numbers here have decimal commas)" if swap else "")
    if "," in value:
        return ": is this a decimal comma? Write points, or commas in all numbers of a file with columns separated by ;"
    if match := re.fullmatch(WITH_UNIT, value):
        return f": write the unit in the header, as in {column} [{match[2]}]"
    return ""


def _no_number(table: Table, column: str, index: int, value: object, remedy: str) -> InputError:
    return table.error(index, f"{column} = {shown(value)}; it must be a finite number{remedy}")


def _is_text(values: pa.ChunkedArray) -> bool:
    return not (pa.types.is_integer(values.type) or pa.types.is_floating(values.type))


def _count(values: pa.ChunkedArray, mark: str) -> int:
    return pc.sum(pc.match_substring(values, mark)).as_py() or 0


def _first(mask: pa.ChunkedArray) -> int:
    return int(pc.index(mask, True).as_py())
