"""How good is a predictor? Regret on planning problems, accuracy on balanced test sets (Section Evaluation)."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any, Protocol

import numpy as np
import pandas as pd
from pydantic import AfterValidator, Field

from apf.domain import Domain, Outcome, Predictor, Task, World, carry_out
from apf.planning.measures import MEASURES
from apf.planning.planner import Planner, Problem
from apf.rng import stream
from apf.rundir.chosen import ChosenPlan
from apf.rundir.columns import ACCURACY_COLUMNS, REGRET_COLUMNS
from apf.rundir.evaluations import Execution
from apf.settings import Count, CountOrNone, Length, Seed, settings

PLANNING, TESTING = "planning", "testing"
"""Kinds of work, as trackers show them."""


def _even(n: int) -> int:
    if n % 2:
        raise ValueError("must be even: half of the plans are feasible")
    return n


def _each_once(lengths: list[int]) -> list[int]:
    twice = [length for i, length in enumerate(lengths) if length in lengths[:i]]
    if twice:
        raise ValueError(f"{twice[0]} stands twice; each length once")
    return lengths


@settings
class EvaluationSettings:
    """When and on what to evaluate. Problems and test sets depend on `seed` alone: they are the same in all runs."""

    every: Count
    """Labelled plans between two evaluations; the last step is always evaluated."""
    problems: CountOrNone
    """Planning problems, the same for each task."""
    length: Length
    """Placements of a plan of a problem."""
    lengths: Annotated[list[Length], AfterValidator(_each_once)]
    """Lengths of plans to report accuracy for."""
    test_plans: Annotated[CountOrNone, AfterValidator(_even)]
    """Plans of each length, half of them feasible."""
    seed: Seed
    worlds: Annotated[dict[str, World], Field(min_length=1)]
    """Where a chosen plan is executed for its reward, each by a name of its own."""
    also: list[Count] = field(default_factory=list)
    """Further numbers of labelled plans at which to evaluate, e.g. where much is learned between those of `every`."""


class Kept(Protocol):
    """Keeps what came of the plans of an evaluation, so that one that was stopped goes on where it was."""

    def outcome(self, execution: Execution, plan: Any) -> Outcome | None:
        """What came of this plan before; None: nothing yet."""
        ...

    def record_outcome(self, execution: Execution, plan: Any, outcome: Outcome) -> None:
        """Keep what came of this plan.

        Args:
            execution: Of which evaluation, and where.
            plan: A batch of one.
            outcome: What came of it.
        """
        ...

    def log_of(self, execution: Execution) -> Path:
        """Where a world may log this execution, as in `World.log_to`."""
        ...


class Evaluator:
    """Evaluates predictors, always on the same problems and the same test plans, and rehearses others for them."""

    def __init__(
        self,
        settings: EvaluationSettings,
        domain: Domain,
        planner: Planner,
        tasks: Mapping[str, Task],
        on_progress: Callable[[int, str, int, int], None] = lambda step, kind, number, of: None,
        time_limit: float | None = None,
    ) -> None:
        """Nothing is computed yet.

        Args:
            settings: Numbers of problems and test plans, and the worlds.
            domain: The domain of the plans.
            planner: Chooses a plan for each problem.
            tasks: By their names in the config.
            on_progress: Is called when a unit of work begins, with the step, the kind of work, the unit's number and
                the number of units.
            time_limit: Seconds that one chosen plan may take in a world; None: no limit.
        """
        self.settings, self.domain, self.planner, self.tasks = settings, domain, planner, tasks
        self.on_progress, self.time_limit = on_progress, time_limit
        self._best_values: dict[int, dict[str, float]] = {}
        self._search_values: dict[int, dict[str, float]] = {}
        self._test_sets: dict[int, tuple[Any, np.ndarray]] = {}

    def work(self) -> dict[str, int]:
        """The units of each kind of work of one evaluation."""
        lengths = len(self.settings.lengths) if self.settings.test_plans else 0
        return {PLANNING: self.settings.problems, TESTING: lengths}

    def plan(self, predictor: Predictor, step: int, kept: Kept | None = None) -> list[ChosenPlan]:
        """A plan for each problem and each task, executed once in each world.

        Args:
            predictor: Judges the candidates.
            step: Of the run.
            kept: Keeps what came of plans, and knows what came of some; None: nothing is kept.
        """
        chosen: list[ChosenPlan] = []
        choices = self.planner.choose(self._problems(step), self.tasks, predictor, self.domain)
        judge = self.planner.judge(predictor)
        for problem, found in enumerate(choices):
            plans = self.domain.concatenate([choice.plan for choice in found.values()])
            chances = judge.prefix_feasibility(plans, stream(self.settings.seed, "chances", step, problem))
            chances[:, -1] = [choice.chance for choice in found.values()]
            for number, (name, choice) in enumerate(found.items()):
                references = self._best_values[problem][name], self._search_values[problem][name]
                outcomes = self._outcomes(step, number, name, problem, choice.plan, kept)
                chosen.append(
                    ChosenPlan(name, problem, choice.plan, choice.value, chances[number], *references, outcomes)
                )
        return chosen

    def rehearse(self, predictor: Predictor, n: int, rng: np.random.Generator) -> list[Any]:
        """What the planner would choose if n problems were of the objects of the experiment, each with one task.

        Args:
            predictor: Judges the candidates.
            n: How many plans.
            rng: The source of all draws.

        Returns:
            The plans, each a batch of one. They are of all tasks in turn.
        """
        names = rng.permutation(list(self.tasks)).tolist()
        plans = []
        for name in itertools.islice(itertools.cycle(names), n):
            candidates = self.domain.problem(self.settings.length, self.planner.candidates, rng, evaluation=False)
            problem, task = Problem(candidates, rng), {name: self.tasks[name]}
            [choices] = self.planner.choose([problem], task, predictor, self.domain)
            plans.append(choices[name].plan)
        return plans

    def _outcomes(
        self, step: int, number: int, task: str, problem: int, plan: Any, kept: Kept | None
    ) -> dict[str, Outcome]:
        """What comes of a chosen plan in each world; `number` is that of the task."""
        outcomes = {}
        for world_name, world in self.settings.worlds.items():
            execution = Execution(step, task, problem, world_name)
            outcome = kept.outcome(execution, plan) if kept else None
            if outcome is None:
                rng = stream(self.settings.seed, f"reward in {world_name}", step, problem, number)
                what = f"the plan chosen for {task} in problem {problem}"
                log = kept.log_of(execution) if kept else None
                outcome = carry_out(world, plan, rng, self.time_limit, what, log=log)
                if kept:
                    kept.record_outcome(execution, plan, outcome)
            outcomes[world_name] = outcome
        return outcomes

    def accuracy(self, predictor: Predictor, step: int, labelled: int) -> pd.DataFrame:
        """[lengths rows, ACCURACY_COLUMNS]: what `apf.planning.measures` says of the test plans of each length.

        Args:
            predictor: Judges the test plans.
            step: Of the run.
            labelled: Plans that are labelled by then.
        """
        rows = []
        lengths = self.settings.lengths if self.settings.test_plans else []
        for number, length in enumerate(lengths, 1):
            self.on_progress(step, TESTING, number, len(lengths))
            plans, labels = self.test_set(length)
            rng = stream(self.settings.seed, "accuracy", step, length)
            probability = predictor.feasibility(plans, rng)
            measured = (measure(probability, labels) for measure in MEASURES.values())
            rows.append((step, labelled, length, *measured, len(plans)))
        return pd.DataFrame(rows, columns=ACCURACY_COLUMNS)

    def test_set(self, length: int) -> tuple[Any, np.ndarray]:
        """Balanced plans and their labels [N] bool; the same for every predictor and step."""
        if length not in self._test_sets:
            rng = stream(self.settings.seed, "test set", length)
            self._test_sets[length] = self.domain.balanced(length, self.settings.test_plans, rng)
        return self._test_sets[length]

    def _problems(self, step: int) -> Iterator[Problem]:
        """Each problem. Its candidates are drawn again each time, which saves memory."""
        for number in range(self.settings.problems):
            self.on_progress(step, PLANNING, number + 1, self.settings.problems)
            rng = stream(self.settings.seed, "problem", number)
            candidates = self.domain.problem(self.settings.length, self.planner.candidates, rng)
            self._find_references(number, candidates)
            yield Problem(candidates, stream(self.settings.seed, "predictor", step, number))

    def _find_references(self, problem: int, candidates: Any) -> None:
        """For each task, the largest value of a candidate that succeeds (0: none does), and the planner's reference."""
        if problem not in self._best_values:
            standing = candidates[self.domain.feasible(candidates)]
            self._best_values[problem] = {
                name: float(task.value(standing).max(initial=0.0)) for name, task in self.tasks.items()
            }
            rng = stream(self.settings.seed, "reference", problem)
            self._search_values[problem] = self.planner.reference(standing, self.tasks, self.domain, rng)


def regret_table(chosen: Sequence[ChosenPlan], step: int, labelled: int) -> pd.DataFrame:
    """[plans x worlds rows, REGRET_COLUMNS] of chosen plans.

    Normalised regret is (best_value - reward) / best_value: the reward is the plan's value if it succeeds and 0 if it
    fails. It is NaN where no candidate succeeds. search_regret is the same with search_value for best_value.

    Args:
        chosen: What an evaluation chose.
        step: Of the run.
        labelled: Plans that are labelled by then.
    """
    rows = []
    for each in chosen:
        for world, outcome in each.outcomes.items():
            feasible = bool((outcome.labels == 1).all())
            reward = each.value * feasible
            known = (each.value, each.chance, each.best_value, _regret(each.best_value, reward), feasible)
            searched = (each.search_value, _regret(each.search_value, reward))
            rows.append((step, labelled, each.task, each.problem, world, *known, *searched))
    return pd.DataFrame(rows, columns=REGRET_COLUMNS)


def _regret(best: float, reward: float) -> float:
    """The share of the best value that the reward lacks; NaN if there is no best value."""
    return (best - reward) / best if best > 0 else np.nan
