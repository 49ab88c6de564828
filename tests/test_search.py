"""The search planner: what it finds, and what it does not ask."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial, reduce
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

import apf.packing
import apf.towers
from apf.domain import Domain, Kind, Labelled, Predictor, Task
from apf.domain.variation import another, swapped
from apf.models import TGN, Ensemble, EnsembleSettings, Training
from apf.planning import Problem, SearchPlanner
from apf.planning.search import Judged, Rule
from apf.rng import stream

WORTH = 4.0 ** np.arange(5)


@dataclass(frozen=True, eq=False)
class Words:
    """Plans that are words: digit [N, K] of 0 to 3."""

    digit: np.ndarray

    def __len__(self) -> int:
        return len(self.digit)

    @property
    def length(self) -> int:
        return self.digit.shape[1]

    def __getitem__(self, rows: Any) -> "Words":
        return Words(self.digit[rows])


class WordDomain:
    """A tiny domain, all of whose plans can be looked at. A variation changes one digit, or two change places."""

    def vary(self, plans: Words, rng: np.random.Generator) -> Words:
        digit, rows = plans.digit.copy(), np.arange(len(plans))
        place = rng.integers(plans.length, size=len(plans))
        digit[rows, place] = another(digit[rows, place], 4, rng)
        order = np.where(rng.random((len(plans), 1)) < 0.2, swapped(*digit.shape, rng), np.arange(plans.length))
        return Words(np.take_along_axis(digit, order, axis=1))

    def concatenate(self, parts: list[Words]) -> Words:
        return Words(np.concatenate([part.digit for part in parts]))

    def feasible(self, plans: Words) -> np.ndarray:
        return plans.digit.sum(1) <= 6


class Sum(Task):
    """A value of its own for each word."""

    unit = ""

    def value(self, plans: Words) -> np.ndarray:
        return plans.digit @ WORTH[: plans.length] + 1


class Last(Task):
    unit = ""

    def value(self, plans: Words) -> np.ndarray:
        return plans.digit[:, -1].astype(float)


class Chances(Predictor):
    """Each digit succeeds with a chance of its own in each place. Keeps the words that it was asked about."""

    def __init__(self, seed: int = 0, length: int = 5) -> None:
        self.chance = reduce(np.multiply.outer, np.random.default_rng(seed).beta(2, 1, (length, 4)))
        self.asked: list[np.ndarray] = []

    def feasibility(self, plans: Words, rng: np.random.Generator) -> np.ndarray:
        self.asked.append(plans.digit)
        return self.chance[tuple(plans.digit.T)]


class Draws(Predictor):
    """Another answer each time."""

    random = True

    def feasibility(self, plans: Words, rng: np.random.Generator) -> np.ndarray:
        return rng.random(len(plans))


ALL_WORDS = Words(np.array(list(itertools.product(range(4), repeat=5))))
WORDS: Any = WordDomain()


def planner(**others: Any) -> SearchPlanner:
    return SearchPlanner(**{"candidates": 20, "start": 20, "generations": 40, "children": 20, "parents": 6, **others})


def some_words(seed: int, n: int = 20) -> Words:
    return Words(np.random.default_rng(seed).integers(4, size=(n, 5)))


def choose(searcher: SearchPlanner, starts: list[Any], tasks: Mapping[str, Task], judge: Predictor, domain: Any) -> Any:
    problems = (Problem(plans, stream(0, "problem", number)) for number, plans in enumerate(starts))
    return list(searcher.choose(problems, tasks, judge, domain))


def asked_of_all(
    searcher: SearchPlanner, start: Judged, task: Task, judge: Predictor, domain: Any, seed: int
) -> Judged:
    """The search in its plainest form: the predictor is asked about every child."""
    kept, rng = start.best(searcher.parents), stream(seed, "variations for task")
    for _ in range(searcher.generations):
        children = domain.vary(kept.plans[np.arange(searcher.children) % len(kept.value)], rng)
        judged = Judged(children, task.value(children), judge.feasibility(children, rng))
        kept = kept.joined(judged, domain).best(searcher.parents)
    return kept.best(1)


@pytest.mark.parametrize("task", [Sum(), Last()])
@pytest.mark.parametrize("seed", range(5))
def test_it_finds_the_best_of_all_plans(task: Task, seed: int) -> None:
    judge = Chances(seed)
    expected = (judge.feasibility(ALL_WORDS, np.random.default_rng()) * task.value(ALL_WORDS)).max()
    ((found,),) = (each.values() for each in choose(planner(), [some_words(seed)], {"task": task}, judge, WORDS))
    assert found.expected == expected
    assert found.value == task.value(found.plan)[0]
    assert found.chance == judge.feasibility(found.plan, np.random.default_rng())[0]
    assert (len(found.plan), found.index) == (1, None)


@pytest.mark.parametrize("task", [Sum(), Last()])
@pytest.mark.parametrize("seed", range(5))
def test_with_the_rule_it_finds_the_best_plan_that_is_feasible(task: Task, seed: int) -> None:
    expected = task.value(ALL_WORDS)[WORDS.feasible(ALL_WORDS)].max()
    ((found,),) = (each.values() for each in choose(planner(), [some_words(seed)], {"task": task}, Rule(WORDS), WORDS))
    assert (found.value, found.chance) == (expected, 1.0)
    standing = some_words(seed)[WORDS.feasible(some_words(seed))]
    assert planner().reference(standing, {"task": task}, WORDS, stream(0, "reference", seed)) == {"task": expected}


def test_where_nothing_is_feasible_the_reference_is_0() -> None:
    assert planner().reference(some_words(0, 0), {"task": Sum()}, WORDS, stream(0, "reference")) == {"task": 0.0}


@given(
    seed=st.integers(0, 1000),
    parents=st.integers(1, 12),
    children=st.integers(1, 12),
    generations=st.integers(1, 12),
    n=st.integers(1, 12),
)
def test_what_is_not_asked_about_changes_nothing(
    seed: int, parents: int, children: int, generations: int, n: int
) -> None:
    searcher = planner(parents=parents, children=children, generations=generations)
    judge, plain, plans = Chances(seed), Chances(seed), some_words(seed, n)
    start = Judged(plans, Sum().value(plans), judge.feasibility(plans, np.random.default_rng()))
    found = searcher.search({"task": start}, {"task": Sum()}, judge, WORDS, seed)["task"]
    expected = asked_of_all(searcher, start, Sum(), plain, WORDS, seed)
    np.testing.assert_array_equal(found.plans.digit, expected.plans.digit)
    assert found.expected == expected.expected >= start.expected.max()
    assert sum(map(len, judge.asked)) <= n + sum(map(len, plain.asked))


def test_plans_that_cannot_win_are_not_asked_about() -> None:
    """With one parent, only children of a value above P x V of the best plan so far are asked about."""
    judge = Chances()
    judge.chance = judge.chance**0.01  # the most valuable words are the best, and little else is asked about
    searcher = planner(parents=1, generations=30)
    choose(searcher, [some_words(0)], {"sum": Sum()}, judge, WORDS)
    start, *children, alone = judge.asked
    best = (judge.chance[tuple(start.T)] * Sum().value(Words(start))).max()
    for asked in children:
        assert (Sum().value(Words(asked)) > best).all()
        best = max(best, (judge.chance[tuple(asked.T)] * Sum().value(Words(asked))).max())
    assert sum(map(len, children)) < 30 * 20 / 2
    assert len(alone) == 1


def test_a_choice_depends_neither_on_other_tasks_nor_on_other_problems() -> None:
    tasks: dict[str, Task] = {"sum": Sum(), "last": Last()}
    starts = [some_words(seed) for seed in range(3)]
    searcher = planner(generations=3, children=5)  # too few to find the best: what is found is chance
    together = choose(searcher, starts, tasks, Chances(), WORDS)
    again = choose(searcher, starts, tasks, Chances(), WORDS)
    alone = choose(searcher, starts[:1], {"last": Last()}, Chances(), WORDS)
    for one, other in zip(together, again, strict=True):
        assert list(one) == ["sum", "last"]
        for name in tasks:
            assert one[name].plan.digit.tolist() == other[name].plan.digit.tolist()
    assert alone[0]["last"].plan.digit.tolist() == together[0]["last"].plan.digit.tolist()
    assert alone[0]["last"].expected == together[0]["last"].expected


def test_it_starts_from_the_first_candidates_of_which_some_may_succeed() -> None:
    hopeless, good = Words(np.full((7, 5), 3)), Words(np.zeros((2, 5), int))
    judge = Chances()
    judge.chance = np.zeros((4,) * 5)
    judge.chance[0, 0, 0, 0, 0] = 1.0
    candidates = WORDS.concatenate([hopeless, good])
    ((found,),) = (
        each.values() for each in choose(planner(start=4, generations=1), [candidates], {"sum": Sum()}, judge, WORDS)
    )
    assert [asked.max(1).tolist() for asked in judge.asked[:2]] == [[3, 3, 3, 3], [3, 3, 3, 0]]
    assert (found.plan.digit.tolist(), found.chance) == ([[0] * 5], 1.0)


def test_a_predictor_that_draws_is_not_asked_again_about_what_was_found() -> None:
    (found,) = choose(planner(), [some_words(0)], {"sum": Sum()}, Draws(), WORDS)
    assert found["sum"].chance > 0.9, "the luckiest of many draws; another draw would be anything"


DOMAINS: dict[str, tuple[Domain, list[Task], Predictor]] = {
    "towers": (
        apf.towers.TowerDomain(),
        [apf.towers.Tallest(), apf.towers.Overhang(), apf.towers.Unsupported()],
        apf.towers.AnalyticPredictor(),
    ),
    "packing": (
        apf.packing.PackingDomain(),
        [apf.packing.Volume(), apf.packing.Value(), apf.packing.Flat()],
        apf.packing.AnalyticPredictor(),
    ),
}


@pytest.mark.parametrize("name", DOMAINS)
def test_it_beats_many_times_as_many_random_plans(name: str) -> None:
    """Of 20 times as many random plans, who knows the rule finds none that is worth more, on the whole."""
    domain, tasks, judge = DOMAINS[name]
    searcher = SearchPlanner(candidates=20_000)
    candidates = [domain.problem(4, searcher.candidates, stream(3, "problem", number)) for number in range(4)]
    by_name = {type(task).__name__: task for task in tasks}
    chosen = choose(searcher, candidates, by_name, judge, domain)
    for task_name, task in by_name.items():
        best = [float((domain.feasible(plans) * task.value(plans)).max()) for plans in candidates]
        found = [choice[task_name] for choice in chosen]
        assert all(choice.chance == 1.0 and domain.feasible(choice.plan)[0] for choice in found)
        assert np.mean([choice.value for choice in found]) > 0.99 * np.mean(best)
    assert sum(choice[task_name].value for choice in chosen) > sum(best), "the last task is not all about objects"


@pytest.mark.parametrize("kind", Kind)
def test_with_networks_a_plan_is_the_same_however_many_problems_there_are(kind: Kind) -> None:
    """Networks round as the batch has it. Problems are searched one by one, so the plans are equal bit for bit."""
    domain = apf.towers.TowerDomain()
    settings = EnsembleSettings(members=3, network=partial(TGN, hidden=8))
    judge = Ensemble(settings, kind, domain, Training(updates=20), torch.device("cpu"), odds=1.5)
    plans = domain.random_plans(3, 100, stream(0, "plans"))
    judge.fit([Labelled(plans, apf.towers.AnalyticWorld().execute(plans, stream(0, "world")))], [], stream(0, "fit"))
    tasks: dict[str, Task] = {"tallest": apf.towers.Tallest(), "overhang": apf.towers.Overhang()}
    starts = [domain.problem(3, 200, stream(0, "problem", number)) for number in range(3)]
    searcher = planner(candidates=200, start=200, generations=5)
    together = choose(searcher, starts, tasks, judge, domain)
    for n in (1, 3):
        for one, other in zip(together, choose(searcher, starts[:n], tasks, judge, domain), strict=False):
            for name in tasks:
                assert domain.encode(one[name].plan) == domain.encode(other[name].plan)
                assert one[name].chance == other[name].chance
                assert one[name].chance == searcher.judge(judge).feasibility(one[name].plan)[0]


@pytest.mark.parametrize("wrong", [{"start": 0}, {"generations": 0}, {"children": 0}, {"parents": 0}, {"odds": 0}])
def test_wrong_settings_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match=next(iter(wrong))):
        planner(**wrong)
