"""Block files and tower files for people: CSV or parquet by their ending, lossless; m and kg unless headers say other.

A block file has one row per block. A tower file has one row per placement, from the bottom up: the block in its
own frame, then the pose of its centre of geometry in the world.
"""

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from apf.domain import NamedPlans
from apf.errors import InputError
from apf.rundir.tables import Table, read_table, shown, write_table
from apf.towers.blocks import SIDES, BlockSet, first_fault
from apf.towers.rotations import QUATERNIONS, not_axis_aligned, off_axis
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
RELATIVE_GAP = 1e-3
"""Or by this share of the taller of the two: the digits that files keep are often relative to the size."""
BELIEVED = (0.005, 1.0)
"""The sides [m] that are believed without a unit."""
LIKELY = (0.02, 0.5)
"""The longest side of a block, as most have it [m]: it tells which unit was meant."""
DENSITIES = (0.01, 25_000.0)
"""The densities [kg/m3] that are believed without units: a hundredth of air's (what is meant in cm is another ten times
lighter, while blocks of a made-up 1 kg may well be metres long), and just more than osmium's."""
_WHOLE = re.compile("0|-?[1-9][0-9]{0,17}")


def read_blocks(path: str | Path) -> BlockSet:
    """The blocks of a block file. Raises InputError, naming file and row, for anything that is not a block."""
    table = read_table(Path(path), BLOCK_COLUMNS[1:], BLOCK_COLUMNS[:1], UNITS)
    if not len(table):
        raise InputError(f"{path}: no blocks; it needs at least one row below the header")
    names = table.names["block"]
    return _block_set(table, [str(names.distinct[code]) for code in names.codes], np.arange(len(table)))


def write_blocks(blocks: BlockSet, path: str | Path, units: bool = False) -> None:
    """Write a block file; `units=True` puts them into the header (`dim_x [m]`), which reading accepts too.

    Args:
        blocks: The set.
        path: A .csv or .parquet file.
        units: Put units into the header?
    """
    write_table(_block_table(blocks), Path(path), UNITS if units else None)


def write_towers(towers: Towers | Sequence[Towers], path: str | Path, units: bool = False) -> None:
    """Write a tower file of one or more batches; towers are numbered from 0 in the order given.

    Args:
        towers: One batch or more.
        path: A .csv or .parquet file.
        units: Put units into the header?
    """
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


def read_towers(path: str | Path, blocks: BlockSet | None = None) -> list[NamedPlans]:
    """The towers of a tower file, one batch for each length.

    If all rotations are (1, 0, 0, 0), a line on standard error asks whether w came first.

    Args:
        path: A .csv or .parquet file.
        blocks: The blocks that the file names, whose own columns may then be missing; None: the file describes them.

    Raises InputError, naming file, tower and row, for a missing column, a value that is no number, an impossible or
    implausible block, a rotation that is not axis-aligned, positions that do not count from 0, a block used twice in a
    tower, and a placement that overlaps what is below it, floats above it, or has nothing below it.
    """
    path = Path(path)
    numbers = ["position", *(BLOCK_COLUMNS[1:] if blocks is None else []), *POSE_COLUMNS]
    table = read_table(path, numbers, ["tower", "block"], UNITS)
    if not len(table):
        raise InputError(f"{path}: no towers; it needs at least one row below the header")
    blocks, block = _blocks_of(table) if blocks is None else (blocks, table.numbered("block", blocks.name))
    rotation = _rotations(table)
    xy = table.stack(["x", "y"])
    far = (np.abs(xy) > SIDES[1]).any(1)
    if far.any():
        row = int(np.argmax(far))
        raise table.error(row, f"x, y = {xy[row, 0]:g}, {xy[row, 1]:g}; they must be within {SIDES[1]:g} m of 0, 0")

    tower = table.names["tower"]
    order, first, lengths = _bottom_up(table)
    _require_distinct_blocks(table, order, block)
    names = _whole_numbers(tower.distinct)
    batches = []
    for length in dict.fromkeys(lengths.tolist()):
        members = np.flatnonzero(lengths == length)
        rows = order[first[members, None] + np.arange(length)]
        towers = Towers(blocks, block[rows], rotation[rows], xy[rows])
        of_these = tuple(names[i] for i in members)
        _require_contact(table, towers, table.numbers["z"][rows], of_these, rows)
        batches.append(NamedPlans(towers, of_these, tuple(members.tolist())))
    return batches


def _whole_numbers(names: tuple[Any, ...]) -> tuple[Any, ...]:
    """Names that are all written as whole numbers of up to 18 digits, as such; others (`007`, `a`) as they are."""
    whole = all(isinstance(name, str) and _WHOLE.fullmatch(name) for name in names)
    return tuple(map(int, names)) if whole else names


def _block_table(blocks: BlockSet) -> pd.DataFrame:
    numbers = np.hstack([blocks.dims, blocks.com, blocks.mass[:, None]])
    table = pd.DataFrame(numbers, columns=BLOCK_COLUMNS[1:])
    table.insert(0, "block", list(blocks.name))
    return table


def _block_set(table: Table, names: Sequence[str], rows: np.ndarray) -> BlockSet:
    """The blocks that some rows of a file describe. Raises InputError, naming file and row."""
    values = table.stack(BLOCK_COLUMNS[1:])[rows]
    dims, com, mass = values[:, :3], values[:, 3:6], values[:, 6]
    fault = first_fault(names, dims, com, mass)
    if fault and not (dims[fault[0]] > BELIEVED[1]).any():
        raise table.error(rows[fault[0]], fault[1])
    _require_plausible(table, names, dims, mass, rows)
    if fault:  # a centre of mass far outside its block: the units of its sides are told first, if they are at fault
        raise table.error(rows[fault[0]], fault[1])
    return BlockSet(tuple(names), dims, com, mass)


def _blocks_of(table: Table) -> tuple[BlockSet, np.ndarray]:
    """The blocks of a tower file, and the one of each row. Raises InputError if two rows differ about a block."""
    named = table.names["block"]
    names = [str(name) for name in named.distinct]
    first = np.full(len(names), len(table))
    np.minimum.at(first, named.codes, np.arange(len(table)))
    clash = np.full(len(table), False)
    for column in BLOCK_COLUMNS[1:]:
        values = table.numbers[column]
        clash |= values != values[first[named.codes]]
    blocks = _block_set(table, names, first)
    if clash.any():
        row = int(np.argmax(clash))
        raise table.error(row, f"block {names[named.codes[row]]} differs from an earlier row of the same name")
    return blocks, named.codes


def _require_plausible(
    table: Table, names: Sequence[str], dims: np.ndarray, mass: np.ndarray, rows: np.ndarray
) -> None:
    """Plain numbers that no block has in m and kg are likely to be mm or g. A unit in the header is believed."""
    sides, all_units = BLOCK_COLUMNS[1:4], [*BLOCK_COLUMNS[1:4], "mass"]
    with np.errstate(all="ignore"):  # of a block that is refused anyway
        density = mass / dims.prod(1)
    checks = [
        (sides, (dims > BELIEVED[1]).any(1), f"has a side above {BELIEVED[1]:g} m"),
        (sides, (dims < BELIEVED[0]).any(1), f"has a side below {BELIEVED[0] * 1000:g} mm"),
        (all_units, density < DENSITIES[0], "is a hundred times lighter than air"),
        (all_units, density > DENSITIES[1], "is heavier than any material"),
    ]
    for columns, bad, what in checks:
        if bad.any() and not table.units.keys() >= set(columns):
            i = int(np.argmax(bad))
            size = " x ".join(f"{side:g}" for side in dims[i])
            raise table.error(
                rows[i],
                f"block {names[i]}, {size} m and {mass[i]:g} kg, {what}; without units, sides are in m and masses in "
                f"kg: write the units in the header, {_remedy(dims[i])}",
            )


def _remedy(dims: np.ndarray) -> str:
    """How headers name the units of a block that is not believed in m and kg, of which the sides are [3]."""
    likely = (unit for unit, n in (("mm", 1000), ("cm", 100)) if LIKELY[0] <= dims.max() / n <= LIKELY[1])
    unit = next(likely, None)
    if unit is not None:
        return f"dim_x [{unit}] if they are in {unit} (dim_x [m] if they are meant), and mass [g] or mass [kg]"
    return "as in dim_x [mm] and mass [g], or dim_x [m] and mass [kg] if they are meant"


def _rotations(table: Table) -> np.ndarray:
    """[R]: which of the 24 rotations each row has."""
    quaternions = table.stack(POSE_COLUMNS[3:])
    rotation, bad = off_axis(quaternions)
    if bad.any():
        row = int(np.argmax(bad))
        raise table.error(row, not_axis_aligned(quaternions[row]))
    if (quaternions == [1, 0, 0, 0]).all():
        print(
            f"{table.path}: all blocks have qx, qy, qz, qw = 1, 0, 0, 0, half a turn about x; was w written first? "
            "A block that is not turned has 0, 0, 0, 1",
            file=sys.stderr,
        )
    return rotation


def _bottom_up(table: Table) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows [R] tower by tower and from the bottom up; where each tower begins among them [T]; their lengths [T]."""
    tower, position = table.names["tower"], table.numbers["position"]
    order = np.lexsort((position, tower.codes))
    lengths = np.bincount(tower.codes, minlength=len(tower.distinct))
    first = np.cumsum(lengths) - lengths
    bad = position[order] != np.arange(len(order)) - np.repeat(first, lengths)
    if bad.any():
        number = tower.codes[order[np.argmax(bad)]]
        rows = order[first[number] : first[number] + lengths[number]]
        said = ", ".join(f"{p:g}" for p in position[rows[:20]]) + (", ..." if len(rows) > 20 else "")
        raise InputError(
            f"{table.path}, row {table.row(int(order[np.argmax(bad)]))}: tower {shown(tower.distinct[number])}: "
            f"position = {said}; it must count 0, 1, 2, ... from the bottom up"
        )
    return order, first, lengths


def _require_distinct_blocks(table: Table, order: np.ndarray, block: np.ndarray) -> None:
    tower = table.names["tower"]
    pairs = tower.codes[order].astype(np.int64) * (block.max() + 1) + block[order]
    twice = pd.Series(pairs).duplicated().to_numpy()
    if twice.any():
        row = int(order[np.argmax(twice)])
        name, which = shown(tower.distinct[tower.codes[row]]), table.names["block"].distinct[block[row]]
        raise table.error(row, f"tower {name} uses block {shown(which)} twice")


def _require_contact(table: Table, towers: Towers, z: np.ndarray, names: Sequence[Any], rows: np.ndarray) -> None:
    """Each block stands on the table or on the one below: no gap, no overlap, and some area in common."""
    height = towers.dims[..., 2]
    top = z + height / 2
    floor = np.zeros((len(z), 1))
    right = np.concatenate([floor, top[:, :-1]], axis=1) + height / 2
    gap = np.maximum(GAP, RELATIVE_GAP * np.maximum(height, np.concatenate([floor, height[:, :-1]], axis=1)))
    sides = towers.dims[..., :2]
    apart = np.abs(np.diff(towers.xy, axis=1)) >= (sides[:, 1:] + sides[:, :-1]) / 2
    beside = np.concatenate([np.zeros((len(z), 1), bool), apart.any(-1)], axis=1)
    bad = ~(np.abs(z - right) <= gap) | beside
    if not bad.any():
        return
    tower, position = np.argwhere(bad)[0]
    here, rests = z[tower, position], right[tower, position]
    where = f"tower {shown(names[tower])}, position {position}"
    if abs(here - rests) > gap[tower, position]:
        what = "floats" if here > rests else "overlaps what is below"
        said = f"{where}: {what}: z = {here:g}; it rests on what is below at z = {rests:g} [m]"
        unit = next(
            (unit for unit, n in (("mm", 1000), ("cm", 100)) if abs(here / n - rests) <= gap[tower, position]), ""
        )
        said += f"; if z is in {unit}, its header must be z [{unit}]" if unit and "z" not in table.units else ""
        raise table.error(rows[tower, position], said)
    raise table.error(rows[tower, position], f"{where}: floats: nothing of the block below is under it")
