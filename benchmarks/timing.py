"""How the benchmarks take time: all sides in turn, in one process, on one thread; medians."""

import gc
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any

TURN = 0.1
"""Seconds for which one side does its work before it is the next one's turn. The first time is with cold caches."""

TIMES, TURNS = 20, 20
"""How often a side does its work in a turn, and how many turns it has in a round, at most."""


@dataclass(frozen=True)
class Timed:
    """Something to time. What `setup` returns is handed to `work` and takes no time. The time counts `scale` times.

    A scale other than 1 stands for work of which only a fraction is done; honest where the cost is linear in it.
    """

    work: Callable[..., object]
    scale: float = 1.0
    setup: Callable[[], Any] | None = None

    def turn(self) -> list[float]:
        """The seconds of each time in a turn, with the garbage collector off as in `timeit`."""
        seconds: list[float] = []
        while sum(seconds) < TURN and len(seconds) < TIMES:
            prepared = () if self.setup is None else (self.setup(),)
            gc.disable()
            try:
                start = time.perf_counter()
                self.work(*prepared)
                seconds.append(time.perf_counter() - start)
            finally:
                gc.enable()
        return seconds


def medians(sides: Sequence[Timed], enough: float) -> list[float]:
    """The median time of each side [s].

    They take turns: what slows the machine for a while slows all sides. A side that has worked for `enough` seconds is
    left out, and the first one's end is the end.
    """
    seconds: list[list[float]] = [[] for _ in sides]
    for _ in range(TURNS):
        for side, mine in zip(sides, seconds, strict=True):
            if sum(mine) < enough:
                mine += side.turn()
        if sum(seconds[0]) >= enough:
            break
    return [median(mine) * side.scale for side, mine in zip(sides, seconds, strict=True)]


@dataclass(frozen=True)
class Target:
    """What an operation should reach; what is None is not asked for."""

    ratio: float | None = None
    """Times the reference's speed."""
    rate: float | None = None
    """Units per second."""
    limit_share: float | None = None
    """Of the machine's limit."""
    seconds: float | None = None

    def __str__(self) -> str:
        parts = [
            "" if self.ratio is None else f">= {self.ratio:g} x reference",
            "" if self.rate is None else f">= {self.rate:.0f}/s",
            "" if self.limit_share is None else f">= {self.limit_share:g} of the limit",
            "" if self.seconds is None else f"<= {self.seconds:g} s",
        ]
        return ", ".join(part for part in parts if part)


@dataclass(frozen=True)
class Case:
    """One operation, ready to be timed: that ours equals the reference has been checked.

    amount: how many `unit`s ours handles. Reference and limit: parts whose times add up. note: what was timed.
    """

    title: str
    unit: str
    amount: float
    ours: Timed
    target: Target
    reference: Sequence[Timed] = ()
    limit: Sequence[Timed] = ()
    note: str = ""
    repetitions: int = 5


@dataclass(frozen=True)
class Row:
    """One row of the table. What does not apply is None."""

    operation: str
    seconds: float
    rate: float
    reference_ratio: float | None
    limit_share: float | None
    target: str
    holds: bool
    unit: str = field(metadata={"csv": False})
    note: str = field(metadata={"csv": False})


def measure(case: Case, enough: float, on_progress: Callable[[str], None] = lambda what: None) -> Row:
    """Time ours, the limit and the reference, several rounds.

    enough: seconds of ours in a round. seconds, ratio and share are medians over the rounds.
    """
    ours, ratios, shares = [], [], []
    for repetition in range(case.repetitions):
        on_progress(f"{case.title}: round {repetition + 1} of {case.repetitions}")
        mine, *others = medians([case.ours, *case.limit, *case.reference], enough)
        limit, reference = others[: len(case.limit)], others[len(case.limit) :]
        ours.append(mine)
        if limit:
            shares.append(sum(limit) / mine)
        if reference:
            ratios.append(sum(reference) / mine)
    seconds, rate = median(ours), case.amount / median(ours)
    ratio = median(ratios) if ratios else None
    share = median(shares) if shares else None
    target = case.target
    holds = (
        at_least(ratio, target.ratio)
        and at_least(rate, target.rate)
        and at_least(share, target.limit_share)
        and (target.seconds is None or seconds <= target.seconds)
    )
    return Row(case.title, seconds, rate, ratio, share, str(target), holds, case.unit, case.note)


def at_least(value: float | None, wanted: float | None) -> bool:
    """Is the value what is wanted, if anything is?"""
    return wanted is None or (value is not None and value >= wanted)
