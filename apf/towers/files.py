"""Block files and tower files for people: CSV or parquet by their ending, SI units, lossless.

A block file has one row per block. A tower file has one row per placement, from the bottom up: the block in its
own frame, then the pose of its centre of geometry in the world.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from apf.errors import InputError
from apf.tables import read_table, write_table
from apf.towers.blocks import BlockSet
from apf.towers.rotations import QUATERNIONS, rotation_index
from apf.towers.towers import Towers

BLOCK_COLUMNS = ["block", "dim_x", "dim_y", "dim_z", "com_x", "com_y", "com_z", "mass"]
POSE_COLUMNS = ["x", "y", "z", "qx", "qy", "qz", "qw"]
TOWER_COLUMNS = ["tower", "position", *BLOCK_COLUMNS, *POSE_COLUMNS]
UNITS = {
    **dict.fromkeys(["dim_x", "dim_y", "dim_z", "com_x", "com_y", "com_z", "x", "y", "z"], "m"),
    "mass": "kg",
}
GAP = 1e-4
"""A block may float above, or sink into, what is below it by this much [m]: files round."""


@dataclass(frozen=True)
class NamedTowers:
    """The towers of one length in a file: the file's own name of each [N], and where it came in the file [N]."""

    towers: Towers
    names: tuple[Any, ...]
    order: tuple[int, ...]


def read_blocks(path: str | Path) -> BlockSet:
    """The blocks of a block file. Raises InputError, naming file and row, for anything that is not a block."""
    path = Path(path)
    table = read_table(path, BLOCK_COLUMNS, UNITS)
    _require_numbers(table, [c for c in BLOCK_COLUMNS if c != "block"], path)
    try:
        return _block_set(table)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def write_blocks(blocks: BlockSet, path: str | Path, units: bool = False) -> None:
    """Write a block file; `units=True` puts them into the header (`dim_x [m]`), which reading accepts too."""
    write_table(_block_table(blocks), Path(path), UNITS if units else None)


def write_towers(towers: Towers | Sequence[Towers], path: str | Path, units: bool = False) -> None:
    """Write a tower file of one or more batches; towers are numbered from 0 in the order given."""
    batches = [towers] if isinstance(towers, Towers) else list(towers)
    first = np.cumsum([0, *map(len, batches)])
    tables = [tower_table(batch, first=int(i)) for batch, i in zip(batches, first, strict=False)]
    write_table(pd.concat(tables, ignore_index=True), Path(path), UNITS if units else None)


def tower_table(towers: Towers, first: int = 0) -> pd.DataFrame:
    """[N * K rows, TOWER_COLUMNS]: one row per placement, towers numbered from `first`."""
    n, k = towers.block.shape
    table = pd.DataFrame({"tower": np.repeat(np.arange(first, first + n), k), "position": np.tile(np.arange(k), n)})
    blocks = _block_table(towers.blocks).iloc[towers.block.ravel()].reset_index(drop=True)
    xyz = np.concatenate([towers.xy, towers.z[..., None]], axis=-1).reshape(-1, 3)
    pose = pd.DataFrame(np.hstack([xyz, QUATERNIONS[towers.rotation.ravel()]]), columns=POSE_COLUMNS)
    return pd.concat([table, blocks, pose], axis=1)


def read_towers(path: str | Path) -> list[NamedTowers]:
    """The towers of a tower file, one batch for each length.

    Raises InputError, naming file, tower and row, for a missing column, a value that is no number, an impossible
    block, a rotation that is not axis-aligned, positions that do not count from 0, a block used twice in a tower, and a
    placement that overlaps what is below it, floats above it, or has nothing below it.
    """
    path = Path(path)
    table = read_table(path, TOWER_COLUMNS, UNITS)
    _require_numbers(table, [c for c in TOWER_COLUMNS if c not in ("tower", "block")], path)
    if table.empty:
        raise InputError(f"{path}: no towers; it needs at least one row below the header")
    blank = table.index[table["tower"].isna()]
    if len(blank):
        raise InputError(f"{path}, row {_row(blank[0])}: tower is empty; every placement needs its tower's name")

    distinct = table.drop_duplicates(BLOCK_COLUMNS)
    clash = distinct.index[distinct["block"].duplicated()]
    if len(clash):
        name = table.loc[clash[0], "block"]
        raise InputError(f"{path}, row {_row(clash[0])}: block {name} differs from an earlier row of the same name")
    try:
        blocks = _block_set(distinct)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None

    index = table["block"].map({name: i for i, name in enumerate(blocks.name)}).to_numpy(int)
    rotation = np.array([_rotation(q, path, i) for i, q in enumerate(table[["qx", "qy", "qz", "qw"]].to_numpy(float))])
    by_length: dict[int, list[tuple[Any, int, np.ndarray]]] = {}
    for order, (name, group) in enumerate(table.groupby("tower", sort=False)):
        rows = group.sort_values("position", kind="stable").index.to_numpy()
        _require_order(table, rows, name, path)
        by_length.setdefault(len(rows), []).append((name, order, rows))
    batches = []
    for members in by_length.values():
        names, orders = tuple(name for name, _, _ in members), tuple(order for _, order, _ in members)
        rows = np.array([rows for _, _, rows in members])
        towers = Towers(blocks, index[rows], rotation[rows], table[["x", "y"]].to_numpy(float)[rows])
        _require_contact(towers, table["z"].to_numpy(float)[rows], names, rows, path)
        batches.append(NamedTowers(towers, names, orders))
    return batches


def _block_table(blocks: BlockSet) -> pd.DataFrame:
    numbers = np.hstack([blocks.dims, blocks.com, blocks.mass[:, None]])
    table = pd.DataFrame(numbers, columns=BLOCK_COLUMNS[1:])
    table.insert(0, "block", list(blocks.name))
    return table


def _block_set(table: pd.DataFrame) -> BlockSet:
    numbers = table[BLOCK_COLUMNS[1:]].to_numpy(float)
    names = tuple(str(name) for name in table["block"])
    return BlockSet(names, numbers[:, :3], numbers[:, 3:6], numbers[:, 6])


def _row(index: int) -> int:
    """The row as an editor counts it: the header is row 1."""
    return int(index) + 2


def _require_numbers(table: pd.DataFrame, columns: list[str], path: Path) -> None:
    for column in columns:
        numbers = pd.to_numeric(table[column], errors="coerce").astype(float)
        bad = np.flatnonzero(~np.isfinite(numbers))
        if len(bad):
            value = table[column].iloc[bad[0]]
            raise InputError(f"{path}, row {_row(bad[0])}: {column} = {value}; it must be a finite number")
        table[column] = numbers
    if table["block"].isna().any():
        raise InputError(f"{path}, row {_row(int(np.argmax(table['block'].isna())))}: block is empty; it needs a name")
    table["block"] = table["block"].astype(str)


def _rotation(quaternion: np.ndarray, path: Path, index: int) -> int:
    try:
        return int(rotation_index(quaternion))
    except InputError as error:
        raise InputError(f"{path}, row {_row(index)}: {error}") from None


def _require_order(table: pd.DataFrame, rows: np.ndarray, name: object, path: Path) -> None:
    positions = table["position"].to_numpy()[rows]
    if not np.array_equal(positions, np.arange(len(rows))):
        shown = ", ".join(f"{p:g}" for p in positions)
        raise InputError(f"{path}: tower {name}: position = {shown}; it must count 0, 1, 2, ... from the bottom up")
    twice = table["block"].iloc[rows].duplicated().to_numpy()
    if twice.any():
        row = rows[np.argmax(twice)]
        raise InputError(f"{path}, row {_row(row)}: tower {name} uses block {table['block'].iloc[row]} twice")


def _require_contact(towers: Towers, z: np.ndarray, names: Sequence[Any], rows: np.ndarray, path: Path) -> None:
    """Each block stands on the table or on the one below: no gap, no overlap, and some area in common."""

    def refuse(bad: np.ndarray, why: str) -> None:
        if bad.any():
            tower, position = np.argwhere(bad)[0]
            where = f"{path}, row {_row(rows[tower, position])}: tower {names[tower]}, position {position}"
            raise InputError(f"{where}: {why.format(z=z[tower, position], right=right[tower, position])}")

    height = towers.dims[..., 2]
    top = z + height / 2
    right = np.concatenate([np.zeros((len(z), 1)), top[:, :-1]], axis=1) + height / 2
    refuse(z > right + GAP, "floats: z = {z:g}; it rests on what is below at z = {right:g} [m]")
    refuse(z < right - GAP, "overlaps what is below: z = {z:g}; it rests there at z = {right:g} [m]")
    sides = towers.dims[..., :2]
    apart = np.abs(np.diff(towers.xy, axis=1)) >= (sides[:, 1:] + sides[:, :-1]) / 2
    beside = np.concatenate([np.zeros((len(z), 1), bool), apart.any(-1)], axis=1)
    refuse(beside, "floats: nothing of the block below is under it")
