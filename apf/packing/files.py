"""Box files and packing files for people: CSV or parquet by their ending, lossless; m unless headers say other.

A box file has one row per box. A packing file has one row per placement: the box with its sides, its orientation (one
of `ORIENTATIONS`: the axis that is vertical, the turn about it), and its centre, from the middle of the container.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from apf.domain import NamedPlans
from apf.errors import InputError
from apf.packing.boxes import ORIENTATIONS, BoxSet, first_fault
from apf.packing.packings import Cell, Packings
from apf.rundir.tables import Table, read_table, shown, write_table

SIDE_COLUMNS = ["dim_x", "dim_y", "dim_z"]
BOX_COLUMNS = ["box", *SIDE_COLUMNS, "value"]
PACKING_COLUMNS = ["packing", "position", "box", *SIDE_COLUMNS, "orientation", "x", "y"]
UNITS = dict.fromkeys([*SIDE_COLUMNS, "x", "y"], "m")
MOST = 32_767
"""Boxes of a set are numbered by int16."""


def read_boxes(path: str | Path) -> BoxSet:
    """The boxes of a box file. Raises InputError, naming file and row, for anything that is not a box."""
    table = read_table(Path(path), BOX_COLUMNS[1:], BOX_COLUMNS[:1], UNITS)
    if not 0 < len(table) <= MOST:
        raise InputError(f"{path}: {len(table)} boxes; it needs 1 to {MOST} rows below the header")
    named = table.names["box"]
    names = [str(named.distinct[code]) for code in named.codes]
    return _box_set(table, names, table.numbers["value"], np.arange(len(table)))


def write_boxes(boxes: BoxSet, path: str | Path, units: bool = False) -> None:
    """Write a box file; `units=True` puts them into the header (`dim_x [m]`), which reading accepts too.

    Args:
        boxes: The set.
        path: A .csv or .parquet file.
        units: Put units into the header?
    """
    columns = dict(zip(SIDE_COLUMNS, boxes.dims.T, strict=True))
    table = pd.DataFrame({"box": list(boxes.name), **columns, "value": boxes.value})
    write_table(table, Path(path), dict.fromkeys(SIDE_COLUMNS, "m") if units else None)


def packing_table(packings: Packings) -> pd.DataFrame:
    """[N * K rows, PACKING_COLUMNS]: one row per placement, packings numbered from 0."""
    n, k = packings.box.shape
    box = packings.box.ravel()
    columns = [
        np.repeat(np.arange(n), k),
        np.tile(np.arange(k), n),
        np.array(packings.boxes.name)[box],
        *packings.boxes.dims[box].T,
        np.array(ORIENTATIONS)[packings.orientation.ravel()],
        *packings.xy.reshape(-1, 2).T,
    ]
    return pd.DataFrame(dict(zip(PACKING_COLUMNS, columns, strict=True)))


def write_packings(packings: Packings, path: str | Path, units: bool = False) -> None:
    """Write a packing file; `units` as in `write_boxes`.

    Args:
        packings: One batch or more.
        path: A .csv or .parquet file.
        units: Put units into the header?
    """
    write_table(packing_table(packings), Path(path), UNITS if units else None)


def read_packings(path: str | Path, cell: Cell, boxes: BoxSet | None = None) -> list[NamedPlans]:
    """The packings of a packing file, one batch for each length, in this cell.

    Args:
        path: A .csv or .parquet file.
        cell: Container and gripper.
        boxes: The boxes that the file names, whose sides may then be missing; None: the file tells them.

    Whether a packing succeeds is not asked: that is what labels say. Raises InputError, naming file and row, for a
    missing column, a value that is no number, an impossible box, an orientation that is none, a place outside the
    container, positions that do not count from 0, and a box used twice in a packing.
    """
    path = Path(path)
    names = ["packing", "box", "orientation"]
    table = read_table(path, ["position", *(SIDE_COLUMNS if boxes is None else []), "x", "y"], names, UNITS)
    if not len(table):
        raise InputError(f"{path}: no packings; it needs at least one row below the header")
    if boxes is None:
        boxes, of_row = _boxes_of(table), table.names["box"].codes
    else:
        of_row = table.numbered("box", boxes.name)
    orientation = _orientations(table)
    xy = table.stack(["x", "y"])
    outside = (np.abs(xy) > cell.container.half).any(1)
    if outside.any():
        row = int(np.argmax(outside))
        x, y = cell.container.half
        raise table.error(
            row,
            f"x, y = {xy[row, 0]:g}, {xy[row, 1]:g} is outside the container: x is -{x:g} to {x:g} m, y -{y:g} to "
            f"{y:g} m, from the middle (domain.container)",
        )
    packing, box = table.names["packing"], table.names["box"]
    batches: dict[int, list[tuple[int, np.ndarray]]] = {}
    position = table.numbers["position"]
    order = np.lexsort((position, packing.codes))
    for number, rows in enumerate(np.split(order, np.cumsum(np.bincount(packing.codes))[:-1])):
        which = f"packing {shown(packing.distinct[number])}"
        wrong = position[rows] != np.arange(len(rows))
        if wrong.any():
            row = rows[np.argmax(wrong)]
            raise table.error(
                row, f"{which}: position is {position[row]:g} instead of {np.argmax(wrong)}; it counts 0, 1, 2, ..."
            )
        if len(set(box.codes[rows])) < len(rows):
            row = next(row for i, row in enumerate(rows) if box.codes[row] in box.codes[rows[:i]])
            raise table.error(row, f"{which} uses box {shown(box.distinct[box.codes[row]])} twice")
        batches.setdefault(len(rows), []).append((number, rows))
    result = []
    for members in batches.values():
        rows = np.array([rows for _, rows in members])
        plans = Packings(cell, boxes, of_row[rows].astype(np.int16), orientation[rows], xy[rows])
        numbers = tuple(number for number, _ in members)
        result.append(NamedPlans(plans, tuple(_name(packing.distinct[number]) for number in numbers), numbers))
    return result


def _name(name: object) -> object:
    """A whole number as such, if it is written as Python writes it; any other name as it is."""
    text = str(name)
    return int(text) if text.isdecimal() and text == str(int(text)) else name


def _box_set(table: Table, names: Sequence[str], value: np.ndarray, rows: np.ndarray) -> BoxSet:
    """The boxes that some rows of a file describe. Raises InputError, naming file and row."""
    dims = table.stack(SIDE_COLUMNS)[rows]
    if fault := first_fault(names, dims, value):
        raise table.error(rows[fault[0]], fault[1])
    return BoxSet(tuple(names), dims, value)


def _boxes_of(table: Table) -> BoxSet:
    """The boxes of a packing file; labels do not ask their value. Raises InputError if two rows differ about a box."""
    named = table.names["box"]
    if len(named.distinct) > MOST:
        raise InputError(f"{table.path}: {len(named.distinct)} boxes; there may be {MOST}")
    names = [str(name) for name in named.distinct]
    _, first = np.unique(named.codes, return_index=True)
    dims = table.stack(SIDE_COLUMNS)
    boxes = _box_set(table, names, np.zeros(len(names)), first)
    differs = (dims != dims[first[named.codes]]).any(1)
    if differs.any():
        row = int(np.argmax(differs))
        raise table.error(row, f"box {names[named.codes[row]]} has other sides than in an earlier row")
    return boxes


def _orientations(table: Table) -> np.ndarray:
    """[R] int8: which of `ORIENTATIONS` each row has."""
    named = table.names["orientation"]
    for code, name in enumerate(named.distinct):
        if name not in ORIENTATIONS:
            raise table.error(
                int(np.argmax(named.codes == code)),
                f"orientation = {shown(name)}; it must be one of {', '.join(ORIENTATIONS)}: the box's axis that is "
                "vertical, and the quarter turn about it",
            )
    return np.array([ORIENTATIONS.index(name) for name in named.distinct], np.int8)[named.codes]
