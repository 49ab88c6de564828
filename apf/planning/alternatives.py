"""Several plans to choose from: the best one, and the best of those that differ from all that were found before."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from apf.domain import Domain, Predictor, Task
from apf.errors import InputError
from apf.planning.planner import Choice, Planner, Problem
from apf.rng import stream

ROUNDING = 1e-5
"""Of a chance: the last digits depend on how many plans are judged together."""
FAR = 1e-3
"""Factor for the chance of a plan that is less likely to succeed than was asked."""


class Anything(Task):
    """Any plan is worth the same: the best one is the likeliest."""

    unit = ""

    def value(self, plans: Any) -> np.ndarray:
        """[N] of 1."""
        return np.ones(len(plans))


class Others(Task):
    """A task for which plans are worth nothing unless they differ from all plans that were found before."""

    def __init__(self, task: Task, domain: Domain, found: Sequence[Any]) -> None:
        """As `task` says, but for what was found.

        Args:
            task: Values the plans.
            domain: Says which plans differ.
            found: Batches of one plan.
        """
        self.task, self.domain, self.found = task, domain, found
        self.unit = task.unit

    def value(self, plans: Any) -> np.ndarray:
        """[N] V of plans that differ, 0 of all others."""
        value = self.task.value(plans)
        for plan in self.found:
            value = np.where(self.domain.differ(plans, plan), value, 0.0)
        return value


class Likely(Predictor):
    """A predictor for which a plan hardly ever succeeds if its chance is less than was asked."""

    def __init__(self, predictor: Predictor, least: float) -> None:
        """As `predictor` says, but for plans of chances below `least`."""
        self.predictor, self.least = predictor, least
        self.random, self.together = predictor.random, True

    def feasibility(self, plans: Any, rng: np.random.Generator) -> np.ndarray:
        """[N] P, or next to nothing."""
        chance = self.predictor.feasibility(plans, rng)
        return np.where(chance >= self.least, chance, FAR * chance)


def alternatives(
    planner: Planner,
    candidates: Any,
    task: Task,
    predictor: Predictor,
    domain: Domain,
    n: int = 1,
    least: float = 0.0,
    seed: int = 0,
) -> list[Choice]:
    """The plan of highest P x V that a planner finds, then the best that differs from this one, and so on.

    Which plans differ, the domain says (`Domain.differ`). The planner looks n times, each time for a plan that differs
    from all that were found before. If a chance is asked, it looks for the likeliest plan first.

    Args:
        planner: How to look.
        candidates: Random plans of one length.
        task: Gives V.
        predictor: Gives P.
        domain: Of the plans.
        n: How many plans.
        least: P of each plan, at least.
        seed: Of all draws.

    Returns:
        n choices, from the best on; fewer if no more are found that differ and are worth anything.

    Raises:
        InputError: No plan with this chance was found; the message says which chance is the highest that was.
    """
    judge = planner.judge(predictor)

    def best(candidates: Any, task: Task, judge: Predictor, *counters: int) -> Choice:
        problem = Problem(candidates, stream(seed, "search", *counters))
        (found,) = planner.choose([problem], {"task": task}, judge, domain)
        return found["task"]

    found: list[Choice] = []
    if least > 0:
        sure = best(candidates, Anything(), judge, n)
        least -= ROUNDING
        if sure.chance < least:
            asked = f"no plan was found that succeeds with a chance of at least {least + ROUNDING:g}"
            raise InputError(f"{asked}; the best chance that was found is {sure.chance:.2f}")
        candidates, judge = domain.concatenate([sure.plan, candidates]), Likely(judge, least)
    for number in range(n):
        choice = best(candidates, Others(task, domain, [each.plan for each in found]), judge, number)
        if choice.chance < least or (found and choice.expected <= 0):
            break
        found.append(choice)
    if not found:  # whatever is as likely as that is worth nothing
        found.append(Choice(sure.plan, float(task.value(sure.plan)[0]), sure.chance))
    return sorted(found, key=lambda choice: -choice.expected)
