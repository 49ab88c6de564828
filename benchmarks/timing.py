"""How the benchmarks take time: all sides in turn, in one process, on one thread; medians."""

import gc
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any

ENOUGH = 2
"""Seconds after which a round has seen enough of something short: its first time is with cold caches, and others are
while the machine is slow, which a median leaves out."""

MOST = 20
"""How often a round does something very short."""


@dataclass(frozen=True)
class Timed:
    """Something to time. What `setup` returns is handed to `work` and takes no time. The time counts `scale` times.

    A scale other than 1 stands for work of which only a fraction is done; honest where the cost is linear in it.
    """

    work: Callable[..., object]
    scale: float = 1.0
    setup: Callable[[], Any] | None = None

    def seconds(self) -> float:
        """The median of doing it as often as there is time for, with the garbage collector off as in `timeit`."""
        seconds: list[float] = []
        while sum(seconds) < ENOUGH and len(seconds) < MOST:
            prepared = () if self.setup is None else (self.setup(),)
            gc.disable()
            try:
                start = time.perf_counter()
                self.work(*prepared)
                seconds.append(time.perf_counter() - start)
            finally:
                gc.enable()
        return median(seconds) * self.scale


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


def measure(case: Case, on_progress: Callable[[str], None] = lambda what: None) -> Row:
    """Time ours, the limit and the reference in turn, several times over.

    seconds is the median of ours. The ratios are medians over the rounds: what slows the machine for a while slows
    both sides of a round.
    """
    ours, ratios, shares = [], [], []
    for repetition in range(case.repetitions):
        on_progress(f"{case.title}: round {repetition + 1} of {case.repetitions}")
        ours.append(case.ours.seconds())
        if case.limit:
            shares.append(sum(part.seconds() for part in case.limit) / ours[-1])
        if case.reference:
            ratios.append(sum(part.seconds() for part in case.reference) / ours[-1])
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
