"""How options are shown in figures: a name for people, and a colour that is the same in every figure."""

import zlib
from collections.abc import Iterable, Mapping, Sequence

COLOURS = ("#0173b2", "#de8f05", "#029e73", "#d55e00", "#cc78bc", "#ca9161", "#56b4e9", "#949494", "#fbafe4", "#b8ad00")
"""Seaborn's palette for colour-blind readers, its yellow darkened."""
BLUE, ORANGE, GREEN, RED, PURPLE, BROWN, SKY, GREY, *_ = COLOURS
STRONG = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY)
"""Colours of groups that have none of their own; the others follow where these do not suffice."""

OPTIONS: Mapping[str, tuple[str, str]] = {
    "sequential": ("Sequential", BLUE),
    "incremental": ("Incremental", ORANGE),
    "complete": ("Complete", GREEN),
    "greedy": ("Greedy", RED),
    "search": ("Search", SKY),
    "random_ss": ("Random, by prefix", PURPLE),
    "random_comp": ("Random, complete", BROWN),
    "tgn": ("TGN", BLUE),
    "fcgn": ("FCGN", GREEN),
    "lstm": ("LSTM", RED),
    "tgn_contact": ("TGN with contact", SKY),
    "learned": ("Learned", BLUE),
    "analytic": ("Analytic", GREY),
    "simulation": ("Simulation", BROWN),
    "oracle": ("Who knows the chances: the floor", GREY),
    "noisy": ("Noisy", ORANGE),
    "panda": ("Robot", PURPLE),
}
"""The name and the colour of options that have their own."""
WORLDS = {"analytic": "placed without noise", "noisy": "placed with noise", "panda": "placed by the robot"}
"""How plans are executed in the worlds that every config knows."""


def name_of(label: str) -> str:
    """A group of runs, by its label, in words: `random_ss, model.members=5` is `Random, by prefix; model.members=5`.

    Values of keys stay as one writes them on the command line.
    """
    parts = [OPTIONS[part][0] if part in OPTIONS else part for part in label.split(", ")]
    return "; ".join(parts)


def in_order(labels: Iterable[str]) -> list[str]:
    """Groups of runs as figures list them: in the order of `OPTIONS`, then those that begin with no option."""
    options = list(OPTIONS)
    first = {label: label.split(", ")[0] for label in labels}
    return sorted(first, key=lambda label: options.index(first[label]) if first[label] in options else len(options))


def world_of(name: str) -> str:
    """What happens in a world of an evaluation, in words."""
    return WORLDS.get(name) or f"world {name}"


def colours_of(labels: Sequence[str]) -> dict[str, str]:
    """A colour for each group of runs.

    An option has its own colour in every figure. Other groups get one by their label, and another one if that is taken.
    """
    parts = [label.split(", ") for label in labels]
    depth = min(map(len, parts), default=0)
    for place in range(depth):  # the first option that tells all groups apart
        own = [OPTIONS[part[place]][1] if part[place] in OPTIONS else None for part in parts]
        if None not in own and len(set(own)) == len(labels):
            return {label: colour for label, colour in zip(labels, own, strict=True) if colour}
    chosen = {label: OPTIONS[label][1] for label in labels if label in OPTIONS}
    for label in sorted(set(labels) - set(chosen)):
        free = [colour for colour in (*STRONG, *COLOURS) if colour not in chosen.values()] or [*COLOURS]
        by_label = STRONG[zlib.crc32(label.encode()) % len(STRONG)]
        chosen[label] = by_label if by_label in free else free[0]
    return {label: chosen[label] for label in labels}
