"""Tables on disk, CSV or parquet by their ending, written whole or not at all."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from apf.errors import InputError
from apf.files import make_folder, replacing

_OLD = tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1)
EXACT: dict[str, Any] = {"float_precision": "round_trip"} if _OLD else {}
"""Before version 3.1, pandas by itself changes every third number that it reads in its last digit."""


def check_ending(path: Path) -> None:
    """Raises InputError unless the file's ending is .csv or .parquet."""
    if path.suffix not in (".csv", ".parquet"):
        raise InputError(f"{path}: the ending must be .csv or .parquet")


def read_table(path: Path, columns: Sequence[str], units: Mapping[str, str], text: Sequence[str] = ()) -> pd.DataFrame:
    """The named columns of a CSV or parquet file, and `row`: where each stood, as an editor counts (the header is 1).

    Headers may carry their unit, as in `dim_x [m]`. Columns of `text` are read as they are written.

    Raises InputError if the file cannot be read, a column is missing or stands twice, or a header names another unit.
    """
    check_ending(path)
    try:
        if path.suffix == ".csv":
            headers = pd.read_csv(path, nrows=0).columns
            names = {h: str for h in headers if _without_unit(str(h), units, path) in text}
            table = pd.read_csv(
                path,
                dtype=names,
                keep_default_na=False,
                na_values={header: [""] for header in headers},
                skipinitialspace=True,
                skip_blank_lines=False,
                **EXACT,
                index_col=False,
            ).dropna(how="all")
        else:
            table = pd.read_parquet(path)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as a table: {str(error).splitlines()[0]}") from None
    table = table.rename(columns={header: _without_unit(str(header), units, path) for header in table.columns})
    twice = table.columns[table.columns.duplicated()]
    if len(twice):
        raise InputError(f"{path}: column {twice[0]} stands twice")
    missing = [column for column in columns if column not in table.columns]
    if missing:
        raise InputError(f"{path}: column {', '.join(missing)} is missing; it needs {', '.join(columns)}")
    table = table[list(columns)]
    return table.assign(row=table.index + 2).reset_index(drop=True)


def write_table(table: pd.DataFrame, path: Path, units: Mapping[str, str] | None = None) -> None:
    """Write a CSV or parquet file, replacing it in one step; with `units`, headers carry them.

    Raises InputError if the ending is another, or the file cannot be written.
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


def _without_unit(header: str, units: Mapping[str, str], path: Path) -> str:
    match = re.fullmatch(r"\s*(\w+)\s*(?:[\[(]\s*(\S+?)\s*[\])])?\s*", header)
    if not match:
        return header
    name, unit = match.groups()
    if unit and name in units and unit != units[name]:
        raise InputError(f"{path}: column {name} is in {unit}; it must be in {units[name]}")
    return name
