"""Balanced test sets: half of the towers stand, half do not."""

import numpy as np

from apf.towers.blocks import BlockSet
from apf.towers.stability import stands
from apf.towers.towers import PUBLISHED_OFFSET, Offset, Towers, random_extensions, random_towers

CHUNK = 20_000
"""Towers grown at once: enough to be fast, few enough to stay in the cache."""


def random_standing(blocks: BlockSet, length: int, n: int, rng: np.random.Generator, offset: Offset) -> Towers:
    """n independent random towers that stand, distributed as `random_towers` given that they do.

    Towers grow block by block and those that fell are dropped at once, so that even seven blocks (a few in
    10,000 stand) take seconds; each survivor grew alone, so no two share a prefix.

    Args:
        blocks: The set.
        length: Blocks of a tower.
        n: How many towers.
        rng: The source of all draws.
        offset: Distribution of x-y offsets.
    """
    found = [random_towers(blocks, length, 0, rng)]
    while sum(map(len, found)) < n:
        towers = random_towers(blocks, 1, CHUNK, rng)
        for _ in range(length - 1):
            towers = random_extensions(towers, rng, offset)
            towers = towers[stands(towers)]
        found.append(towers)
    return Towers.concatenate(found)[:n]


def random_fallen(blocks: BlockSet, length: int, n: int, rng: np.random.Generator, offset: Offset) -> Towers:
    """n independent random towers that do not stand, distributed as `random_towers` given that they do not.

    Args:
        blocks: The set.
        length: Blocks of a tower.
        n: How many towers.
        rng: The source of all draws.
        offset: Distribution of x-y offsets.
    """
    found = [random_towers(blocks, length, 0, rng)]
    while sum(map(len, found)) < n:
        towers = random_towers(blocks, length, 2 * n, rng, offset)
        found.append(towers[~stands(towers)])
    return Towers.concatenate(found)[:n]


def balanced_towers(
    blocks: BlockSet, length: int, n: int, rng: np.random.Generator, offset: Offset = PUBLISHED_OFFSET
) -> tuple[Towers, np.ndarray]:
    """A test set of n towers, half standing and half not (Section Model Architecture and Generalization).

    Args:
        blocks: The set.
        length: Blocks of a tower.
        n: How many towers; an even number.
        rng: The source of all draws.
        offset: Distribution of x-y offsets.

    Returns:
        The towers, and their labels [n] bool.

    Raises:
        ValueError: n is odd.
    """
    if n % 2:
        raise ValueError(f"a balanced set needs an even number of towers, not {n}")
    standing = random_standing(blocks, length, n // 2, rng, offset)
    fallen = random_fallen(blocks, length, n // 2, rng, offset)
    return Towers.concatenate([standing, fallen]), np.arange(n) < n // 2
