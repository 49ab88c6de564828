"""Frames as files: what is given as a frame is read, checked and refused as the file would be."""

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from apf.errors import InputError

Table = str | Path | pd.DataFrame
"""A .csv or .parquet file, or a frame in the columns of such a file."""


@contextlib.contextmanager
def as_files(**tables: Any) -> Iterator[dict[str, Path]]:
    """Context: a file for each table, by the same names. Frames are written for the time of the context.

    Raises InputError if a frame cannot be written. In a message, a frame is called by its name here.
    """
    with tempfile.TemporaryDirectory(prefix="apf-") as folder:
        try:
            yield {name: _as_file(table, Path(folder, f"{name}.parquet")) for name, table in tables.items()}
        except InputError as error:
            raise InputError(_named(str(error), folder, list(tables))) from None


def _as_file(table: Table, path: Path) -> Path:
    if not isinstance(table, pd.DataFrame):
        return Path(table)
    try:
        table.rename(columns=str).to_parquet(path)
    except (ValueError, TypeError, ArithmeticError) as error:  # pyarrow's own are among these
        reason = next(iter(str(error).splitlines()), type(error).__name__)
        raise InputError(f"{path}: cannot be read as a table: {reason}") from None
    return path


def _named(message: str, folder: str, names: list[str]) -> str:
    for name in names:
        path = Path(folder, f"{name}.parquet")
        message = message.replace(f"{name}: {path}", str(path)).replace(str(path), f"the frame of {name}")
    return message
