"""The Monte Carlo planner: of many random plans, the one of highest expected value (Section Evaluation phase)."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from apf.domain import Domain, Predictor, Task
from apf.planning.planner import Choice, Odds, Pessimism, Planner, Problem
from apf.settings import Many, settings

ROUNDS = ((0.2, 0.5), (1.0,))
"""Shares of the members that are asked about each prefix, round by round. Most candidates are hopeless, and a few
members can tell. So half of the members are asked about all prefixes before the other half."""

NARROWING = 0.5
"""Share of a wave's candidates that get the next query too: those of the highest limit."""

GROWTH = 8
"""The size of the next wave, as a multiple of this one's. A wave is a set of candidates that get their queries
together."""

TIE = 1e-5
"""Candidates within this relative distance of the best one are scored once more, each alone. The rounding of a product
of matrices depends on its number of rows; the choice must not."""


@dataclass(frozen=True)
class Query:
    """One question about a candidate: how likely do these members call its prefix of this length?

    silent: [prefixes] number of members that have not judged each prefix after this query.
    """

    length: int
    members: slice
    silent: np.ndarray

    @property
    def n_members(self) -> int:
        """Number of members that the query asks."""
        return self.members.stop - self.members.start


def _queries(lengths: range, members: int, rounds: Sequence[Sequence[float]]) -> list[Query]:
    """All queries of a candidate, in their order."""
    asked, queries = dict.fromkeys(lengths, 0), []
    for shares in rounds:
        for length in lengths:
            for end in (math.ceil(share * members) for share in shares):
                if end > asked[length]:
                    some, asked[length] = slice(asked[length], end), end
                    queries.append(Query(length, some, members - np.array(list(asked.values()))))
    return queries


class Pool:
    """The candidates of one problem, with an upper bound of each candidate's chance of success.

    All tasks of a problem share the bounds.

    bound: [N] upper bound of P(feasible): 1 at first, then the bound of ever longer prefixes, at last P itself. The
    bound assumes that members which were not asked yet say 1. known: [N] bool, is the bound P itself?
    """

    def __init__(self, candidates: Any, predictor: Predictor, rng: np.random.Generator) -> None:
        """No query has been asked yet.

        Args:
            candidates: N plans of one length.
            predictor: Judges the candidates.
            rng: The source of the predictor's draws.
        """
        self.candidates = candidates
        self.predictor = predictor
        self.rng = rng
        self.at_once = predictor.random or predictor.together
        self.members = predictor.members if predictor.mean_of_members and not self.at_once else 1  # asked apart
        by_prefix = predictor.by_prefix and not self.at_once
        lengths = range(2 if by_prefix else candidates.length, candidates.length + 1)
        self.queries = _queries(lengths, self.members, ROUNDS)
        self.bound = np.ones(len(candidates))
        self.n_queries = np.zeros(len(candidates), np.int16)
        self._sums = np.zeros((len(candidates), len(lengths)))  # of the members' probabilities of each prefix

    @property
    def known(self) -> np.ndarray:
        """[N] bool: is the bound P itself?"""
        return self.n_queries == len(self.queries)

    def query(self, number: int, rows: np.ndarray) -> None:
        """Ask query `number` of candidates [M] that had all queries before it."""
        query = self.queries[number]
        self._sums[rows, query.length - self.candidates.length - 1] += self._chance(rows, query) * query.n_members
        self.bound[rows] = ((self._sums[rows] + query.silent) / self.members).prod(1)
        self.n_queries[rows] += 1

    def promising(self, values: np.ndarray, rows: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Those of the candidates `rows` (default: all) whose bound x V may still exceed the best known P x V."""
        limit, known = self.bound * values, self.known
        best = limit[known].max(initial=0.0)
        open_ = ~known & (limit >= best * (1 - TIE)) & (limit > 0)
        return np.flatnonzero(open_) if isinstance(rows, slice) else rows[open_[rows]]

    def alone(self, row: int) -> float:
        """P of one candidate, computed apart from all others."""
        return float(self.predictor.feasibility(self.candidates[row : row + 1], self.rng)[0])

    def _chance(self, rows: np.ndarray, query: Query) -> np.ndarray:
        plans = self.candidates.prefix(query.length)[rows]
        if self.at_once:
            return self.predictor.feasibility(plans, self.rng)
        if self.members > 1:
            return self.predictor.last_feasibility(plans, query.members)
        if self.predictor.by_prefix:
            return self.predictor.last_feasibility(plans)
        return self.predictor.feasibility(plans, self.rng)


@settings
class MonteCarloPlanner(Planner):
    """argmax of P(phi = 1 | a) V(a) over random candidates."""

    odds: Odds | None = None
    pessimism: Pessimism | None = None
    first: Many = 1024
    """Plans of the first wave, which is to find a good one; the next waves are larger."""
    chunk: Many = 32768
    """Plans of the largest wave: bounds memory."""

    def choose(
        self, problems: Iterable[Problem], tasks: Mapping[str, Task], predictor: Predictor, domain: Domain
    ) -> Iterator[dict[str, Choice]]:
        """As `Planner.choose`; one problem after another."""
        predictor = self.judge(predictor)
        for problem in problems:
            pool = self.pool(problem.candidates, predictor, problem.rng)
            yield {name: self.plan(task, pool) for name, task in tasks.items()}

    def pool(self, candidates: Any, predictor: Predictor, rng: np.random.Generator) -> Pool:
        """The candidates of a problem, for `plan`.

        A predictor that draws at random is asked once, about all candidates. So is one that judges many plans about as
        fast as a few.

        Args:
            candidates: Plans of one length.
            predictor: Judges plans.
            rng: The source of the predictor's draws.
        """
        pool = Pool(candidates, predictor, rng)
        if pool.at_once:
            pool.query(0, np.arange(len(candidates)))
        return pool

    def plan(self, task: Task, pool: Pool) -> Choice:
        """The best of the candidates, the first among equals: branch and bound, exact.

        No plan is likelier to succeed than a prefix of it. So bound x V is an upper limit of a candidate's expected
        value. The planner takes the candidates in waves, those of the highest limit first. Each query of a wave goes
        only to candidates that may still win, until P is known of a few. The first wave is small: the good plan that
        this wave finds spares most queries of the next waves.
        """
        values = task.value(pool.candidates)
        wave = min(self.first, self.chunk)
        while len(rows := pool.promising(values)):
            rows = _highest(wave, rows, pool.bound * values)
            for number in range(len(pool.queries)):
                ready = rows[pool.n_queries[rows] == number]
                if len(ready):
                    pool.query(number, _highest(math.ceil(wave * NARROWING**number), ready, pool.bound * values))
                    rows = pool.promising(values, rows)
            wave = min(GROWTH * wave, self.chunk)
        limit, known = pool.bound * values, pool.known
        best = limit[known].max(initial=0.0)
        near = np.flatnonzero(known & (limit >= best * (1 - TIE))) if best > 0 else np.array([0])
        chance = pool.bound[near]
        if not pool.predictor.random and (len(near) > 1 or not known[near].all()):
            chance = np.array([pool.alone(row) for row in near])
        winner = int((chance * values[near]).argmax())
        row = int(near[winner])
        return Choice(pool.candidates[row : row + 1], float(values[row]), float(chance[winner]), row)


def _highest(n: int, rows: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """The n of these rows [M] that have the highest limit [N]; all rows if there are fewer than n."""
    return rows if len(rows) <= n else rows[np.argpartition(-limit[rows], n)[:n]]
