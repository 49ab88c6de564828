"""The experimentation phase: the active-learning loop (Section Problem Formulation)."""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from apf.acquisition import Sampler
from apf.domain import Predictor, Scored, World, carry_out
from apf.errors import Stopped
from apf.models import Ensemble
from apf.planning import Evaluator, regret_table
from apf.planning.objective import metrics_of
from apf.rng import stream
from apf.rundir.store import Store
from apf.settings import Count, CountOrNone, Seconds, settings
from apf.tracking import Metrics, Phase, Tracker

TRAIN, VALIDATION = "train", "validation"
CHOOSING, FIRST, BUILDING, TRAINING = "choosing plans", "first plans", "building", "training"
"""Kinds of work, as trackers show them."""


@settings
class Initial:
    """Random plans labelled before the first acquisition."""

    train: Count
    validation: Count


@settings
class Acquisition:
    """What each acquisition adds."""

    plans: Count
    """Plans proposed and executed."""
    validation: CountOrNone
    """How many of them go to the validation set, drawn at random."""
    rehearsed: CountOrNone = 0
    """How many of them are what the planner would choose for the tasks, of the objects of the experiment."""


@settings
class Execution:
    """How plans are carried out."""

    time_limit: Seconds | None
    """Seconds that one plan may take in a world; None: as long as it likes."""


@dataclass(frozen=True)
class Experiment:
    """One run: the parts that the config composed, and the loop that joins them.

    plans: how many to label in all, the initial ones included. every: labelled plans between evaluations. also: further
    numbers of labelled plans at which to evaluate.
    """

    seed: int
    plans: int
    every: int
    initial: Initial
    acquisition: Acquisition
    execution: Execution
    sampler: Sampler
    world: World
    model: Ensemble
    evaluator: Evaluator
    store: Store
    tracker: Tracker
    also: Sequence[int] = ()

    @property
    def steps(self) -> int:
        """Acquisitions that it takes to label all plans."""
        return math.ceil((self.plans - self.initial.train - self.initial.validation) / self.acquisition.plans)

    def labelled_after(self, step: int) -> int:
        """Plans labelled when a step is over."""
        return min(self.plans, self.initial.train + self.initial.validation + step * self.acquisition.plans)

    def run(self) -> None:
        """Label, learn, evaluate, until all plans are labelled.

        What the store holds already is not done again: a run that was stopped goes on where it was, and as every
        draw has a stream of its own, it ends as if it had never stopped.
        """
        self.tracker.plan(self.steps, self.work())
        for step in range(self.steps + 1):
            self.choose(step)
            self.execute(step)
            to_learn, to_evaluate = self.to_do(step)
            if to_learn:
                self.learn(step)
            if to_evaluate:
                self.evaluate(step, self.model, self.model.save)

    def to_do(self, step: int) -> tuple[bool, bool]:
        """Is a model to be trained after this step's plans, and is it to be evaluated?"""
        asks_model = self.sampler.score.asks_model or self.acquisition.rehearsed > 0
        to_propose = step < self.steps and not self.store.planned(step + 1) and asks_model
        to_evaluate = self.due(step) and not self.store.evaluated(step)
        return to_propose or to_evaluate, to_evaluate

    def work(self) -> Counter[str]:
        """The units of each kind of work that are to come."""
        work: Counter[str] = Counter()
        for step in range(self.steps + 1):
            planned = self.store.planned(step)
            plans = self.labelled_after(step) - (self.labelled_after(step - 1) if step else 0)
            to_learn, to_evaluate = self.to_do(step)
            work[CHOOSING] += not planned
            work[BUILDING if step else FIRST] += len(self.store.pending(step)) if planned else plans
            work[TRAINING] += to_learn
            work.update(self.evaluator.work() if to_evaluate else {})
        return work

    def due(self, step: int) -> bool:
        """Is this step evaluated? Whenever another `every` plans are labelled, at numbers of `also`, and at the end.

        The initial model is evaluated if a number of `also` asks for it.
        """
        labelled, before = self.labelled_after(step), self.labelled_after(step - 1) if step else 0
        every = step > 0 and labelled // self.every > before // self.every
        return every or any(before < plans <= labelled for plans in self.also) or step == self.steps

    def choose(self, step: int) -> None:
        """Decide which plans to try: random ones first, then those that the model would learn most from."""
        if self.store.planned(step):
            return
        self.tracker.begin(step, CHOOSING)
        rng = stream(self.seed, "propose", step)
        domain = self.store.domain
        if step == 0:
            train = self.sampler.start(domain, self.initial.train, rng)
            validation = self.sampler.start(domain, self.initial.validation, rng)
            splits = [TRAIN] * len(train) + [VALIDATION] * len(validation)
            self.store.plan(step, train + validation, splits)
        else:
            n = min(self.acquisition.plans, self.plans - self.store.count(until=step - 1))
            rehearsed = self.rehearse(step, min(self.acquisition.rehearsed, n - 1))  # the sampler proposes one, too
            others = n - len(rehearsed)
            proposed = self.sampler.propose(self.model, domain, self.store.labelled(), others, rng) + rehearsed
            held_out = rng.permutation(n) < round(n * self.acquisition.validation / self.acquisition.plans)
            self.store.plan(step, proposed, np.where(held_out, VALIDATION, TRAIN).tolist())

    def rehearse(self, step: int, n: int) -> list[Scored]:
        """What the planner would do with the model as it is. A planner finds the plans that a model is too sure of.

        Args:
            step: Of this step.
            n: How many plans.
        """
        rng = stream(self.seed, "rehearse", step)
        plans = self.evaluator.rehearse(self.model, n, rng)
        return [Scored(plan, float(self.sampler.score(self.model, plan, rng)[0])) for plan in plans]

    def execute(self, step: int) -> None:
        """Try each plan in the world. Its labels are on disk before the next one starts."""
        pending = self.store.pending(step)
        for place, (number, plan) in enumerate(pending, 1):
            self.tracker.begin(step, BUILDING if step else FIRST, place, len(pending))
            rng = stream(self.seed, "world", number)
            world, before = (self.world.initial_world, None) if step == 0 else (self.world, self.store.last_report)
            log = self.store.log_of(number)
            outcome = carry_out(world, plan, rng, self.execution.time_limit, f"plan {number}", before, log)
            self.store.record(number, outcome.labels, outcome.report)
        if pending:
            self.tracker.log(self.execution_metrics(step))

    def learn(self, step: int) -> None:
        """Train the ensemble from scratch on all that was labelled up to this step."""
        self.tracker.begin(step, TRAINING)
        train, validation = (self.store.labelled(split, until=step) for split in (TRAIN, VALIDATION))
        try:
            history = self.model.fit(train, validation, stream(self.seed, "train", step))
        except FloatingPointError as error:
            raise Stopped(f"training diverged in step {step}: {error}; try a lower training.learning_rate") from None
        losses = {f"loss/{name}": loss for name, loss in history.kept_losses.items()}
        if history.restarts:
            losses["members/restarted"] = float(history.restarts)
        self.store.record_training(step, losses)
        self.tracker.log(Metrics(step, Phase.LEARNED, self.store.count(until=step), losses))

    def evaluate(self, step: int, predictor: Predictor, save: Callable[[Path], None] | None = None) -> None:
        """Plan and test with the predictor; `save` writes its weights, if it has any.

        Args:
            step: Of this step.
            predictor: Judges plans.
            save: Writes the predictor's weights; None: it has none.
        """
        labelled = self.store.count(until=step)
        chosen = self.evaluator.plan(predictor, step, self.store)
        accuracy = self.evaluator.accuracy(predictor, step, labelled)
        self.store.record_evaluation(step, regret_table(chosen, step, labelled), accuracy, chosen, save)
        self.tracker.log(self.evaluation_metrics(step))

    def history(self) -> list[Metrics]:
        """All metrics that the store can tell of what was done, in the order in which they came."""
        evaluations = metrics_of(self.store.regret(), self.store.accuracy())
        history = []
        for step in range(self.steps + 1):
            if self.store.planned(step) and not self.store.pending(step):
                history.append(self.execution_metrics(step))
            labelled = self.store.count(until=step)
            if losses := self.store.training(step):
                history.append(Metrics(step, Phase.LEARNED, labelled, losses))
            if self.store.evaluated(step):
                history.append(Metrics(step, Phase.EVALUATED, labelled, evaluations.get(step, {})))
        return history

    def execution_metrics(self, step: int) -> Metrics:
        """The share of plans that succeeded, and the scores that they were chosen for."""
        feasible, scores = self.store.executed(step)
        metrics = {"data/feasible_share": float(feasible.mean())}
        if step:
            metrics |= {"score/mean": scores.mean(), "score/max": scores.max(), "score/min": scores.min()}
        metrics |= {
            f"world/{name}": value for name, value in self.world.summary([*self.store.reports(step).values()]).items()
        }
        return Metrics(step, Phase.EXECUTED, self.store.count(until=step), metrics)

    def evaluation_metrics(self, step: int) -> Metrics:
        """Median regret and plans that succeeded for each world and task, accuracy and its like for each length."""
        metrics = metrics_of(self.store.regret(step), self.store.accuracy(step))
        return Metrics(step, Phase.EVALUATED, self.store.count(until=step), metrics.get(step, {}))
