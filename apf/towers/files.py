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
    table = read_table(path, BLOCK_COLUMNS, UNITS, text=["block"])
    _require_numbers(table, [c for c in BLOCK_COLUMNS if c != "block"], path)
    return _block_set(table, path)


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
    table = read_table(path, TOWER_COLUMNS, UNITS, text=["block", "tower"])
    _require_numbers(table, [c for c in TOWER_COLUMNS if c not in ("tower", "block")], path)
    if table.empty:
        raise InputError(f"{path}: no towers; it needs at least one row below the header")
    blank = table.index[table["tower"].isna()]
    if len(blank):
        raise InputError(
            f"{path}, row {table['row'][blank[0]]}: tower is empty; every placement needs its tower's name"
        )
    table["tower"] = _whole_numbers(table["tower"])

    distinct = table.drop_duplicates(BLOCK_COLUMNS)
    clash = distinct.index[distinct["block"].duplicated()]
    if len(clash):
        name = table.loc[clash[0], "block"]
        raise InputError(
            f"{path}, row {table['row'][clash[0]]}: block {name} differs from an earlier row of the same name"
        )
    blocks = _block_set(distinct, path)

    index = table["block"].map({name: i for i, name in enumerate(blocks.name)}).to_numpy(int)
    rotation = np.array(
        [_rotation(q, path, row) for row, q in zip(table["row"], table[["qx", "qy", "qz", "qw"]].to_numpy(float))]
    )
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
        _require_contact(towers, table["z"].to_numpy(float)[rows], names, table["row"].to_numpy()[rows], path)
        batches.append(NamedTowers(towers, names, orders))
    return batches


def _whole_numbers(names: pd.Series) -> pd.Series:
    """Names that are all written as whole numbers, as such; others (`007`, `a`) as they are."""
    numbers = pd.to_numeric(names, errors="coerce")
    whole = numbers.notna().all() and (numbers % 1 == 0).all() and (numbers.astype(int).astype(str) == names).all()
    return numbers.astype(int) if whole else names


def _block_table(blocks: BlockSet) -> pd.DataFrame:
    numbers = np.hstack([blocks.dims, blocks.com, blocks.mass[:, None]])
    table = pd.DataFrame(numbers, columns=BLOCK_COLUMNS[1:])
    table.insert(0, "block", list(blocks.name))
    return table


def _block_set(table: pd.DataFrame, path: Path) -> BlockSet:
    """Raises InputError, naming file and row."""
    numbers = table[BLOCK_COLUMNS[1:]].to_numpy(float)
    names = tuple(table["block"])
    dims, com, mass = numbers[:, :3], numbers[:, 3:6], numbers[:, 6]
    for i, row in enumerate(table["row"]):
        try:
            one = slice(i, i + 1)
            BlockSet(names[one], dims[one], com[one], mass[one])
            if names[i] in names[:i]:
                raise InputError(f"block {names[i]}: the name stands twice; names must be unique")
        except InputError as error:
            raise InputError(f"{path}, row {row}: {error}") from None
    if not names:
        raise InputError(f"{path}: no blocks; it needs at least one row below the header")
    return BlockSet(names, dims, com, mass)


def _require_numbers(table: pd.DataFrame, columns: list[str], path: Path) -> None:
    for column in columns:
        numbers = pd.to_numeric(table[column], errors="coerce").astype(float)
        bad = np.flatnonzero(~np.isfinite(numbers))
        if len(bad):
            value = table[column].iloc[bad[0]]
            raise InputError(f"{path}, row {table['row'].iloc[bad[0]]}: {column} = {value}; it must be a finite number")
        table[column] = numbers
    if table["block"].isna().any():
        raise InputError(
            f"{path}, row {table['row'].iloc[int(np.argmax(table['block'].isna()))]}: block is empty; it needs a name"
        )
    table["block"] = table["block"].astype(str)


def _rotation(quaternion: np.ndarray, path: Path, row: int) -> int:
    try:
        return int(rotation_index(quaternion))
    except InputError as error:
        raise InputError(f"{path}, row {row}: {error}") from None


def _require_order(table: pd.DataFrame, rows: np.ndarray, name: object, path: Path) -> None:
    positions = table["position"].to_numpy()[rows]
    if not np.array_equal(positions, np.arange(len(rows))):
        shown = ", ".join(f"{p:g}" for p in positions)
        raise InputError(f"{path}: tower {name}: position = {shown}; it must count 0, 1, 2, ... from the bottom up")
    twice = table["block"].iloc[rows].duplicated().to_numpy()
    if twice.any():
        row = rows[np.argmax(twice)]
        raise InputError(f"{path}, row {table['row'][row]}: tower {name} uses block {table['block'].iloc[row]} twice")


def _require_contact(towers: Towers, z: np.ndarray, names: Sequence[Any], rows: np.ndarray, path: Path) -> None:
    """Each block stands on the table or on the one below: no gap, no overlap, and some area in common."""

    height = towers.dims[..., 2]
    top = z + height / 2
    right = np.concatenate([np.zeros((len(z), 1)), top[:, :-1]], axis=1) + height / 2
    sides = towers.dims[..., :2]
    apart = np.abs(np.diff(towers.xy, axis=1)) >= (sides[:, 1:] + sides[:, :-1]) / 2
    beside = np.concatenate([np.zeros((len(z), 1), bool), apart.any(-1)], axis=1)
    bad = np.argwhere((np.abs(z - right) > GAP) | beside)
    if len(bad):
        tower, position = bad[0]
        here, rests = z[tower, position], right[tower, position]
        where = f"{path}, row {rows[tower, position]}: tower {names[tower]}, position {position}"
        if abs(here - rests) > GAP:
            what = "floats" if here > rests else "overlaps what is below"
            raise InputError(f"{where}: {what}: z = {here:g}; it rests on what is below at z = {rests:g} [m]")
        raise InputError(f"{where}: floats: nothing of the block below is under it")
