"""How a claim is decided: a statistic, its bound, the interval of a bootstrap, and a verdict."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from analysis.evidence import Evidence, MissingError
from analysis.protocol import note_on

DECIDED = ["value", "low", "high", "runs", "verdict", "needed", "note"]
"""Columns of the table that a decision fills."""
ENOUGH = 2
"""Runs of what learns, at least, without which nothing is decided."""
HOPELESS = 1000
"""More runs than that are not counted out."""


@dataclass(frozen=True)
class Claim:
    """A claim, and what decides it: `measure`, what `statistic` says in words, above or below a bound.

    names: whose runs decide it. towers: of the only evaluation that it is about, which some of the runs may lack.
    """

    text: str
    statistic: str
    names: tuple[str, ...]
    measure: Callable[[Evidence], float]
    above: float | None = None
    below: float | None = None
    towers: int | None = None

    @property
    def rule(self) -> str:
        """The statistic and its bound."""
        return f"{self.statistic} {'>' if self.above is not None else '<'} {self.bound:g}"

    @property
    def bound(self) -> float:
        """The bound, from above or below."""
        return next(bound for bound in (self.above, self.below) if bound is not None)

    def decide(self, evidence: Evidence, draws: int, rng: np.random.Generator) -> dict[str, object]:
        """What the columns `DECIDED` hold.

        Args:
            evidence: What the runs say. Runs of another protocol decide nothing.
            draws: Bootstrap samples.
            rng: The source of all draws.
        """
        counts = {name: evidence.count(name, self.towers) for name in self.names}
        runs = " + ".join(map(str, counts.values()))
        protocol = note_on({name: evidence.sources[name] for name in self.names if name in evidence.sources})
        undecided = {**dict.fromkeys(DECIDED, np.nan), "runs": runs, "verdict": "undecided", "needed": ""}
        try:
            value = self.measure(evidence)
        except MissingError as missing:
            return {**undecided, "note": "; ".join(filter(None, [str(missing), protocol]))}
        low, high = np.nanquantile([self.measure(evidence.drawn(rng)) for _ in range(draws)], [0.025, 0.975])
        figures = {"value": value, "low": low, "high": high}
        few = [name for name, count in counts.items() if count < ENOUGH and not name.startswith("predictor ")]
        too_few = f"too few runs of {', '.join(few)} to tell how much they differ" if few else ""
        if too_few or protocol:
            return {**undecided, **figures, "note": "; ".join(filter(None, [too_few, protocol]))}
        verdict = self.verdict(low, high)
        needed = runs_needed(max(counts.values()), value, low, high, self.bound) if verdict == "undecided" else ""
        return {**figures, "runs": runs, "verdict": verdict, "needed": needed, "note": ""}

    def verdict(self, low: float, high: float) -> str:
        """Does the claim hold, if its statistic is somewhere from low to high?"""
        if self.above is not None:
            return "holds" if low > self.above else "fails" if high < self.above else "undecided"
        bound = self.below if self.below is not None else np.inf
        return "holds" if high < bound else "fails" if low > bound else "undecided"


def runs_needed(runs: int, value: float, low: float, high: float, bound: float) -> str:
    """How many runs of each name would decide, were the value to stay: a number, or `more than 1,000`.

    The interval shrinks with the square root of the number of runs. With h, from the value to the end of the interval
    beyond the bound, and d, from the value to the bound, the bound lies outside once runs (h / d)^2 are exceeded. That
    takes problems to be drawn anew with each run; where all runs share theirs, it is too few.

    Args:
        runs: Of the name that has most now.
        value: Of the statistic.
        low: Lower end of its interval.
        high: Upper end.
        bound: What the statistic is compared with. The interval holds the bound.

    Returns:
        The number as text; empty if the interval is not known.
    """
    if not np.isfinite([value, low, high]).all():
        return ""
    half, distance = (value - low, value - bound) if value > bound else (high - value, bound - value)
    if distance <= 0 or runs * (half / distance) ** 2 >= HOPELESS:
        return f"more than {HOPELESS:,}"
    return str(math.floor(runs * (half / distance) ** 2) + 1)
