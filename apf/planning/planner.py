"""The Monte Carlo planner: of many random plans, the one of highest expected value (Section Evaluation phase)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import PositiveInt

from apf.predictor import Predictor
from apf.settings import settings
from apf.tasks import Task

TIE = 1e-5
"""Candidates this close to the best, relatively, are scored once more, each alone: the rounding of a product of
matrices depends on how many rows it has, and the choice must not."""


@dataclass(frozen=True)
class Choice:
    """The chosen candidate: its row, its value V, and its expected value P x V."""

    index: int
    value: float
    expected: float


class Pool:
    """The candidates of one problem, and what is known so far of each one's chance of success.

    bound: [N] an upper bound of P(feasible): 1 at first, then that of ever longer prefixes, at last P itself.
    known: [N] bool, whether the bound is P. All tasks of a problem share what was computed.
    """

    def __init__(self, candidates: Any, predictor: Predictor, rng: np.random.Generator) -> None:
        self.candidates = candidates
        self.predictor = predictor
        self.rng = rng
        n, length = len(candidates), candidates.length
        self.bound = np.ones(n)
        self._next_length = np.full(n, 2 if predictor.by_prefix else length, np.int8)

    @property
    def known(self) -> np.ndarray:
        """[N] bool: is the bound P itself?"""
        return self._next_length > self.candidates.length

    def tighten(self, rows: np.ndarray) -> None:
        """Look at one placement more of each of the given candidates [M], none of which is known yet."""
        lengths = self._next_length[rows]
        for length in np.unique(lengths):
            some = rows[lengths == length]
            self.bound[some] *= self._chance(some, int(length))
            self._next_length[some] += 1

    def alone(self, row: int) -> float:
        """P of one candidate, computed apart from all others."""
        return float(self.predictor.feasibility(self.candidates[row : row + 1], self.rng)[0])

    def _chance(self, rows: np.ndarray, length: int) -> np.ndarray:
        plans = self.candidates[rows]
        if self.predictor.by_prefix:
            return self.predictor.last_feasibility(plans.prefix(length))
        return self.predictor.feasibility(plans, self.rng)


@settings
class MonteCarloPlanner:
    """argmax of P(phi = 1 | a) V(a) over random candidates."""

    candidates: PositiveInt
    """Random plans considered for each problem."""
    chunk: PositiveInt = 32768
    """Plans looked at between two decisions which to look at next; at most a third of all candidates."""

    def pool(self, candidates: Any, predictor: Predictor, rng: np.random.Generator) -> Pool:
        """The candidates of a problem, for `plan`. A predictor that draws is asked once, for all of them."""
        pool = Pool(candidates, predictor, rng)
        if predictor.random:
            pool.tighten(np.arange(len(candidates)))
        return pool

    def plan(self, task: Task, pool: Pool) -> Choice:
        """The best of the candidates, the first among equals: branch and bound, exact.

        P <= 1, and no plan is likelier to succeed than a prefix of it, so bound x V limits what a candidate can
        reach. Those of the highest limit are looked at next, one placement further each time, until none that is
        not known can still win. With a good predictor that takes a few thousand of a hundred thousand candidates.
        """
        values = task.value(pool.candidates)
        chunk = max(1, min(self.chunk, len(values) // 3))
        while True:
            limit = pool.bound * values
            known = pool.known
            best = limit[known].max(initial=0.0)
            open_rows = np.flatnonzero(~known & (limit >= best * (1 - TIE)) & (limit > 0))
            if not len(open_rows):
                break
            if len(open_rows) > chunk:
                open_rows = open_rows[np.argpartition(-limit[open_rows], chunk)[:chunk]]
            pool.tighten(open_rows)
        near = np.flatnonzero(known & (limit >= best * (1 - TIE))) if best > 0 else np.array([0])
        expected = limit[near]
        if len(near) > 1 and not pool.predictor.random:
            expected = np.array([pool.alone(row) * values[row] for row in near])
        winner = int(expected.argmax())
        return Choice(int(near[winner]), float(values[near[winner]]), float(expected[winner]))
