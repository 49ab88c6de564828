"""A plain implementation of the tower domain: what `apf` is compared with, for results and for time.

Written in the style usual for such code: a block is an object, a tower a list of blocks from the bottom up, all work a
loop over them. `reference_learning` does the same for networks, training, scores and planning.
"""

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from apf.towers import QUATERNIONS, BlockSet, Towers


class Vector(NamedTuple):
    """Three lengths [m]."""

    x: float
    y: float
    z: float


ORIGIN = Vector(0.0, 0.0, 0.0)


class Quaternion(NamedTuple):
    """A rotation; w last."""

    x: float
    y: float
    z: float
    w: float


@dataclass
class Block:
    """A cuboid, its sides along the world's axes.

    dims: sides [m]. com: centre of mass relative to the centre of geometry [m]. mass [kg]. position: centre of
    geometry in the world [m].
    """

    name: str
    dims: Vector
    com: Vector
    mass: float
    position: Vector = ORIGIN


Tower = list[Block]

ORIENTATIONS = [Quaternion(*q) for q in QUATERNIONS.tolist()]
"""The 24 axis-aligned rotations."""

QUARTER_TURNS = [Quaternion(0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2)) for angle in np.arange(4) * np.pi / 2]
"""0, 90, 180, 270 degrees about the vertical."""


def rotation_matrix(q: Quaternion) -> np.ndarray:
    """[3, 3], of a unit quaternion."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotated(block: Block, turn: Quaternion) -> Block:
    """A copy of the block, turned about its centre of geometry."""
    matrix = rotation_matrix(turn)
    copy = deepcopy(block)
    copy.dims = Vector(*np.abs(matrix @ np.array(block.dims)))
    copy.com = Vector(*(matrix @ np.array(block.com)))
    return copy


# -- towers ---------------------------------------------------------------------------------------------------------


def random_tower(
    blocks: Sequence[Block], length: int, rng: np.random.Generator, sd: float = 0.5, limit: float = 0.95
) -> Tower:
    """A tower of `length` different blocks. sd, limit: of the offsets, in units of half the summed sides."""
    tower: Tower = []
    for index in rng.choice(len(blocks), length, replace=False):
        orientation = ORIENTATIONS[rng.integers(len(ORIENTATIONS))]
        place(tower, blocks[index], orientation, np.clip(rng.normal(0.0, sd, 2), -limit, limit))
    return tower


def place(tower: Tower, block: Block, orientation: Quaternion, offset: np.ndarray) -> None:
    """Add a block on top. offset: [2] from the block below, in units of half their summed sides."""
    block = rotated(block, orientation)
    if tower:
        below = tower[-1]
        reach = (np.array(below.dims) + np.array(block.dims))[:2] / 2
        xy = np.array(below.position)[:2] + offset * reach
        z = below.position.z + below.dims.z / 2 + block.dims.z / 2
    else:
        xy, z = np.zeros(2), block.dims.z / 2
    block.position = Vector(xy[0], xy[1], z)
    tower.append(block)


def four_views(tower: Tower) -> list[Tower]:
    """The tower turned by 0, 90, 180 and 270 degrees about the vertical through the origin."""
    views = []
    for turn in QUARTER_TURNS:
        matrix = rotation_matrix(turn)
        view = []
        for block in tower:
            turned = rotated(block, turn)
            turned.position = Vector(*(matrix @ np.array(block.position)))
            view.append(turned)
        views.append(view)
    return views


def features(tower: Tower) -> np.ndarray:
    """[K, 10], what a network sees: mass, centre of mass, sides, position from the bottom block; about unit range."""
    bottom = np.array(tower[0].position)
    return np.array(
        [
            np.concatenate(
                [
                    [(block.mass - 0.55) * 2],
                    np.array(block.com) / 0.1,
                    np.array(block.dims) / 0.1 - 1,
                    (np.array(block.position) - bottom) / 0.1,
                ]
            )
            for block in tower
        ]
    )


# -- labels ---------------------------------------------------------------------------------------------------------


def prefix_labels(tower: Tower) -> list[int]:
    """Label of each prefix: 1 stood, 0 fell, -1 not attempted, as one before it fell."""
    labels = [-1] * len(tower)
    for length in range(1, len(tower) + 1):
        labels[length - 1] = int(stands(tower[:length]))
        if not labels[length - 1]:
            break
    return labels


def stands(tower: Tower) -> bool:
    """Does every block carry those above it?"""
    return all(is_balanced(tower[i], tower[i + 1 :]) for i in range(len(tower) - 1))


def is_balanced(below: Block, above: Tower) -> bool:
    """Is the joint centre of mass of the blocks above within their contact patch on the block below?"""
    masses = np.array([block.mass for block in above])
    coms = np.array([np.array(block.position) + np.array(block.com) for block in above])
    joint = (masses[:, None] * coms).sum(0) / masses.sum()
    low = np.maximum(lower_corner(below), lower_corner(above[0]))
    high = np.minimum(upper_corner(below), upper_corner(above[0]))
    return bool(((low < joint) & (joint < high))[:2].all())


def lower_corner(block: Block) -> np.ndarray:
    """[3] the block's corner of least x, y and z [m]."""
    return np.array(block.position) - np.array(block.dims) / 2


def upper_corner(block: Block) -> np.ndarray:
    """[3] the block's corner of greatest x, y and z [m]."""
    return np.array(block.position) + np.array(block.dims) / 2


def displaced(tower: Tower, noise: float, rng: np.random.Generator) -> Tower:
    """The tower as it comes to stand in the noisy world; noise: standard deviation of x and y [m]."""
    copy = deepcopy(tower)
    for block in copy:
        dx, dy = rng.normal(0.0, noise, 2)
        block.position = Vector(block.position.x + dx, block.position.y + dy, block.position.z)
    return copy


# -- objectives -----------------------------------------------------------------------------------------------------


def height(tower: Tower) -> float:
    """The height of the tower [m]."""
    return sum(block.dims.z for block in tower)


def overhang(tower: Tower) -> float:
    """From the bottom block's centre of geometry to the furthest vertical side of the top block [m]."""
    bottom, top = tower[0], tower[-1]
    shift = np.abs(np.array(top.position) - np.array(bottom.position))
    return float((shift + np.array(top.dims) / 2)[:2].max())


def unsupported(tower: Tower) -> float:
    """The area of the blocks' undersides that is not on the block below [m^2]."""
    total = 0.0
    for below, block in pairwise(tower):
        low = np.maximum(lower_corner(below), lower_corner(block))
        high = np.minimum(upper_corner(below), upper_corner(block))
        x, y, _ = np.maximum(high - low, 0.0)
        total += block.dims.x * block.dims.y - x * y
    return float(total)


VALUES: dict[str, Callable[[Tower], float]] = {"tallest": height, "overhang": overhang, "unsupported": unsupported}
"""The objectives, by the names that the configs give them."""


# -- from arrays to objects -----------------------------------------------------------------------------------------


def block_list(blocks: BlockSet) -> list[Block]:
    """The blocks of a set, each in its own frame."""
    rows = zip(blocks.name, blocks.dims.tolist(), blocks.com.tolist(), blocks.mass.tolist(), strict=True)
    return [Block(name, Vector(*dims), Vector(*com), mass) for name, dims, com, mass in rows]


def tower_list(towers: Towers) -> list[Tower]:
    """The same towers as objects, one after another."""
    blocks, z = block_list(towers.blocks), towers.z
    result = []
    for n in range(len(towers)):
        tower = []
        for k in range(towers.length):
            block = rotated(blocks[towers.block[n, k]], ORIENTATIONS[towers.rotation[n, k]])
            x, y = towers.xy[n, k].tolist()
            block.position = Vector(x, y, float(z[n, k]))
            tower.append(block)
        result.append(tower)
    return result
