"""Balanced test sets: half of the packings succeed, half do not."""

from collections.abc import Callable

import numpy as np

from apf.errors import InputError
from apf.packing.boxes import BoxSet
from apf.packing.packings import Cell, Packings
from apf.packing.random_packings import Places, random_extensions, random_packings
from apf.packing.rule import packed

CHUNK = 20_000
"""Packings grown at once."""
MISSES = 200
"""After so many chunks in a row without what is looked for, there seems to be none."""


def balanced_packings(
    cell: Cell, boxes: BoxSet, length: int, n: int, rng: np.random.Generator, places: Places
) -> tuple[Packings, np.ndarray]:
    """n random packings, of which the first half succeed and the others fail, and their labels [n] bool.

    Packings that succeed grow box by box; a prefix that fails is dropped at once. No two packings share a prefix.

    Args:
        cell: Container and gripper.
        boxes: What is packed.
        length: Placements of a packing.
        n: How many.
        rng: The source of all draws.
        places: Distribution of x and y.

    Raises:
        ValueError: n is odd, or `length` is more than the boxes.
        InputError: No packing succeeds, or none fails.
    """
    if n % 2:
        raise ValueError(f"a balanced set needs an even number of packings, not {n}")

    def draw_packed() -> Packings:
        packings = random_packings(cell, boxes, 1, CHUNK, rng, places)
        for _ in range(length - 1):
            packings = random_extensions(packings[packed(packings)], rng, places)
        return packings[packed(packings)]

    def draw_failed() -> Packings:
        packings = random_packings(cell, boxes, length, n, rng, places)
        return packings[~packed(packings)]

    half = [
        _collect(draw, n // 2, f"no random packing of {length} boxes {what}; change domain.container or domain.places")
        for draw, what in ((draw_packed, "succeeds"), (draw_failed, "fails"))
    ]
    return Packings.concatenate(half), np.arange(n) < n // 2


def _collect(draw: Callable[[], Packings], n: int, none: str) -> Packings:
    """The first n packings that `draw` gives. Raises InputError, saying `none`, if it goes on giving none."""
    found, misses = [draw()], 0
    while sum(map(len, found)) < n:
        found.append(draw())
        misses = 0 if len(found[-1]) else misses + 1
        if misses == MISSES:
            raise InputError(none)
    return Packings.concatenate(found)[:n]
