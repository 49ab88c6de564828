"""The search planner: from random plans, generations of variations of the best (an evolution strategy)."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from apf.domain import Domain, Predictor, Task
from apf.planning.planner import Choice, Odds, Pessimism, Planner, Problem
from apf.rng import stream
from apf.settings import Count, settings

DIGITS = 6
"""Of P, by which plans are told apart: the last ones depend on how many plans were judged together."""


@dataclass(frozen=True, eq=False)
class Judged:
    """N plans, the value V of each if it succeeds [N], and the predicted chance P of each to succeed [N]."""

    plans: Any
    value: np.ndarray
    chance: np.ndarray

    @property
    def expected(self) -> np.ndarray:
        """[N] P x V."""
        return self.chance * self.value

    def best(self, n: int) -> "Judged":
        """The n plans of highest P x V, from the best on; the first among equals.

        Of plans of one V and one P, the first alone: most likely they are the same plan.
        """
        order = np.argsort(-self.expected, kind="stable")
        _, first = np.unique(np.column_stack([self.value, self.chance.round(DIGITS)])[order], axis=0, return_index=True)
        rows = order[np.sort(first)[:n]]
        return Judged(self.plans[rows], self.value[rows], self.chance[rows])

    def joined(self, other: "Judged", domain: Domain) -> "Judged":
        """These plans, then others."""
        plans = domain.concatenate([self.plans, other.plans])
        return Judged(plans, np.append(self.value, other.value), np.append(self.chance, other.chance))


class Rule(Predictor):
    """Knows which plans are feasible in a world without noise."""

    def __init__(self, domain: Domain) -> None:
        self.domain = domain

    def feasibility(self, plans: Any, rng: np.random.Generator) -> np.ndarray:
        """[N] of 0 and 1."""
        return self.domain.feasible(plans).astype(float)


@settings
class SearchPlanner(Planner):
    """argmax of P(phi = 1 | a) V(a), by local search from random plans."""

    odds: Odds = 1.0
    pessimism: Pessimism | None = 1.0
    start: Count = 1000
    """Random plans that the search starts from."""
    generations: Count = 30
    children: Count = 100
    """Variations in each generation, as many of each parent."""
    parents: Count = 10
    """Best plans so far, which are varied next. Several keep the search from ending where only one of them leads."""

    def choose(
        self, problems: Iterable[Problem], tasks: Mapping[str, Task], predictor: Predictor, domain: Domain
    ) -> Iterator[dict[str, Choice]]:
        """As `Planner.choose`; one problem after another, all tasks of a problem side by side.

        A choice does not depend on other problems. It depends on other tasks only if the predictor draws at random, or
        by the rounding of its answers.
        """
        judge = self.judge(predictor)
        for problem in problems:
            seed = int(problem.rng.integers(2**63))
            rng = stream(seed, "predictor")
            plans, chance = self._start(problem.candidates, judge, rng)
            starts = {name: Judged(plans, task.value(plans), chance) for name, task in tasks.items()}
            found = {}
            for name, best in self.search(starts, tasks, judge, domain, seed).items():
                alone = best.chance if judge.random else judge.feasibility(best.plans, rng)
                found[name] = Choice(best.plans, float(best.value[0]), float(alone[0]))
            yield found

    def search(
        self, starts: Mapping[str, Judged], tasks: Mapping[str, Task], predictor: Predictor, domain: Domain, seed: int
    ) -> dict[str, Judged]:
        """The best plan found for each task (a batch of one).

        A plan whose value is no higher than P x V of the worst parent cannot become a parent, since P <= 1. The
        predictor is not asked about such a plan, and the search finds the same as if it were.

        Args:
            starts: Plans that each search starts from.
            tasks: By the same names; each gives V.
            predictor: Gives P. It is asked about the plans of all tasks together, which is faster.
            domain: Varies plans.
            seed: Of all draws. Each task has a stream of its own.
        """
        parents = {name: start.best(self.parents) for name, start in starts.items()}
        rngs, rng = {name: stream(seed, f"variations for {name}") for name in tasks}, stream(seed, "children")
        for _ in range(self.generations):
            children = {name: self._children(parents[name], task, domain, rngs[name]) for name, task in tasks.items()}
            chance = predictor.feasibility(domain.concatenate([plans for plans, _ in children.values()]), rng)
            ends = np.cumsum([len(plans) for plans, _ in children.values()])
            for (name, (plans, value)), part in zip(children.items(), np.split(chance, ends[:-1]), strict=True):
                parents[name] = parents[name].joined(Judged(plans, value, part), domain).best(self.parents)
        return {name: each.best(1) for name, each in parents.items()}

    def reference(
        self, standing: Any, tasks: Mapping[str, Task], domain: Domain, rng: np.random.Generator
    ) -> dict[str, float]:
        """As `Planner.reference`; the search starts from the feasible candidates of highest value. 0: there is none."""
        if not len(standing):
            return dict.fromkeys(tasks, 0.0)
        starts = {name: Judged(standing, task.value(standing), np.ones(len(standing))) for name, task in tasks.items()}
        found = self.search(starts, tasks, Rule(domain), domain, int(rng.integers(2**63)))
        return {name: float(best.value[0]) for name, best in found.items()}

    def _children(
        self, parents: Judged, task: Task, domain: Domain, rng: np.random.Generator
    ) -> tuple[Any, np.ndarray]:
        """Variations of the parents that may become parents, and V of each."""
        children = domain.vary(parents.plans[np.arange(self.children) % len(parents.value)], rng)
        value = task.value(children)
        if len(parents.value) < self.parents:
            return children, value
        rows = np.flatnonzero(value > parents.expected[-1])
        return children[rows], value[rows]

    def _start(self, candidates: Any, predictor: Predictor, rng: np.random.Generator) -> tuple[Any, np.ndarray]:
        """The first candidates and P of each [start], or the next ones if none of the first may succeed."""
        for begin in range(0, len(candidates), self.start):
            plans = candidates[np.arange(begin, min(begin + self.start, len(candidates)))]
            chance = predictor.feasibility(plans, rng)
            if chance.any():
                break
        return plans, chance
