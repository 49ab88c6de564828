"""What an evaluation says of predictors whose quality is known."""

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd
import pytest
from pydantic import ValidationError

from apf.domain import Predictor, Task, World
from apf.errors import Stopped
from apf.planning import EvaluationSettings, Evaluator, MonteCarloPlanner, Planner, SearchPlanner, regret_table
from apf.planning.measures import MEASURES
from apf.rng import stream
from apf.rundir.columns import ACCURACY_COLUMNS, REGRET_COLUMNS
from apf.towers import AnalyticWorld, Overhang, Tallest, TowerDomain, Towers, stands


class Oracle(Predictor):
    """Knows which towers stand, and says something of it."""

    def __init__(self, says: Callable[[np.ndarray], np.ndarray]) -> None:
        self.says = says

    def feasibility(self, plans: Towers, rng: np.random.Generator | None = None) -> np.ndarray:
        return self.says(stands(plans))


@pytest.fixture
def evaluator(domain: TowerDomain) -> Evaluator:
    settings = EvaluationSettings(
        every=10, problems=0, length=3, lengths=[2, 3], test_plans=40, seed=0, worlds={"analytic": AnalyticWorld()}
    )
    return Evaluator(settings, domain, MonteCarloPlanner(candidates=10), {})


@pytest.mark.parametrize(
    ("says", "accuracy", "auc"),
    [
        (lambda stood: np.where(stood, 0.9, 0.1), 1.0, 1.0),
        (lambda stood: np.where(stood, 0.3, 0.1), 0.5, 1.0),  # in the right order, but sure of none
        (lambda stood: np.where(stood, 0.1, 0.9), 0.0, 0.0),
        (lambda stood: np.full(len(stood), 0.7), 0.5, 0.5),  # a tie with every other
        (lambda stood: np.where(stood, np.arange(len(stood)) % 2, 0.0), 0.75, 0.75),  # half of those that stand
    ],
)
def test_accuracy_asks_for_the_right_side_of_one_half_and_auc_for_the_right_order(
    evaluator: Evaluator, says: Callable[[np.ndarray], np.ndarray], accuracy: float, auc: float
) -> None:
    table = evaluator.accuracy(Oracle(says), step=3, labelled=70)
    assert table["length"].tolist() == [2, 3]
    assert table["accuracy"].tolist() == [accuracy] * 2
    assert table["auc"].tolist() == [auc] * 2
    assert [*MEASURES] == ["accuracy", "auc", "nll", "ece"]
    for name, measure in MEASURES.items():
        labels = evaluator.test_set(3)[1]
        assert table[name].iloc[1] == measure(says(labels), labels)
    assert set(table["n"]) == {40}


class Says(Predictor):
    """Gives each tower the chance that a function of it says."""

    def __init__(self, chance: Callable[[Towers], np.ndarray]) -> None:
        self.chance = chance

    def feasibility(self, plans: Towers, rng: np.random.Generator | None = None) -> np.ndarray:
        return self.chance(plans)


class Draws(Predictor):
    """Says anything, and keeps the first number that it drew each time."""

    random = True

    def __init__(self) -> None:
        self.drew: list[float] = []

    def feasibility(self, plans: Towers, rng: np.random.Generator | None = None) -> np.ndarray:
        assert rng is not None
        self.drew.append(rng.random())
        return rng.random(len(plans))


class Falls(World):
    """Every tower falls at its last placement; keeps what was tried, and a number drawn each time."""

    def __init__(self) -> None:
        self.tried: list[Towers] = []
        self.drew: list[float] = []

    def execute(self, plans: Towers, rng: np.random.Generator) -> np.ndarray:
        self.tried.append(plans)
        self.drew.append(rng.random())
        return np.array([[1] * (plans.length - 1) + [0]])


class Slow(World):
    def execute(self, plans: Towers, rng: np.random.Generator) -> np.ndarray:
        time.sleep(30)
        return np.ones((1, plans.length), np.int8)


class Worthless(Task):
    unit = "m"

    def value(self, plans: Towers) -> np.ndarray:
        return np.zeros(len(plans))


class Counting:
    """A domain that keeps how often it was asked what stands."""

    def __init__(self, domain: TowerDomain) -> None:
        self.domain, self.judged = domain, 0

    def feasible(self, plans: Towers) -> np.ndarray:
        self.judged += 1
        return self.domain.feasible(plans)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.domain, name)


TASKS: dict[str, Task] = {"tallest": Tallest(), "overhang": Overhang()}
CANDIDATES = 300


def settings_with(**others: Any) -> EvaluationSettings:
    given = {"every": 10, "problems": 2, "length": 3, "lengths": [2], "test_plans": 4, "seed": 5}
    return EvaluationSettings(**{**given, "worlds": {"analytic": AnalyticWorld()}, **others})


def evaluator_with(
    domain: Any,
    tasks: Mapping[str, Task] = TASKS,
    candidates: int = CANDIDATES,
    limit: float | None = None,
    planner: Planner | None = None,
    **others: Any,
) -> tuple[Evaluator, list[str]]:
    """An evaluator of small problems, and the list that it writes its progress to."""
    said: list[tuple[int, str, int, int]] = []
    planner = planner or MonteCarloPlanner(candidates=candidates)
    return Evaluator(settings_with(**others), domain, planner, tasks, lambda *what: said.append(what), limit), said


def regret_of(evaluator: Evaluator, predictor: Predictor, step: int, labelled: int) -> pd.DataFrame:
    return regret_table(evaluator.plan(predictor, step), step, labelled)


def problem(domain: TowerDomain, number: int, candidates: int = CANDIDATES) -> Towers:
    return domain.problem(3, candidates, stream(5, "problem", number))


def test_columns_are_those_that_the_tables_on_disk_have() -> None:
    assert " ".join(REGRET_COLUMNS) == (
        "step plans task problem world value chance best_value regret feasible search_value search_regret"
    )
    assert " ".join(ACCURACY_COLUMNS) == "step plans length accuracy auc nll ece n"


class TestRegret:
    def test_who_knows_what_stands_regrets_nothing_where_it_stands(self, domain: TowerDomain) -> None:
        worlds = {"analytic": AnalyticWorld(), "falls": Falls()}
        evaluator, said = evaluator_with(domain, worlds=worlds)
        table = regret_of(evaluator, Says(lambda plans: stands(plans).astype(float)), step=3, labelled=70)
        assert table.columns.tolist() == REGRET_COLUMNS
        assert said == [(3, "planning", 1, 2), (3, "planning", 2, 2)]
        expected = []
        for number in range(2):
            candidates = problem(domain, number)
            for name, task in TASKS.items():
                best = task.value(candidates)[stands(candidates)].max()
                assert best > 0
                for world in worlds:
                    fell = world == "falls"
                    expected.append([3, 70, name, number, world, best, 1.0, best, float(fell), not fell])
        assert table.iloc[:, :10].astype(object).to_numpy().tolist() == expected
        assert table[["search_value", "search_regret"]].isna().all().all(), "this planner looks at candidates alone"

    def test_who_believes_in_every_tower_gets_nothing_for_those_that_fall(self, domain: TowerDomain) -> None:
        evaluator, _ = evaluator_with(domain, problems=5)
        table = regret_of(evaluator, Says(lambda plans: np.ones(len(plans))), step=0, labelled=0)
        tallest = table[table["task"] == "tallest"]
        for number, row in zip(range(5), tallest.itertuples(), strict=True):
            candidates = problem(domain, number)
            values = TASKS["tallest"].value(candidates)
            stood = bool(stands(candidates[values.argmax() : values.argmax() + 1])[0])
            assert (row.feasible, row.value) == (stood, values.max())
            best = values[stands(candidates)].max()
            assert row.best_value == best
            assert row.regret == (pytest.approx((best - values.max()) / best) if stood else 1.0)
        assert not tallest["feasible"].all()

    def test_a_tower_that_stands_but_is_not_the_best_costs_the_difference(self, domain: TowerDomain) -> None:
        candidates = problem(domain, 0)
        values = TASKS["overhang"].value(candidates)
        standing = np.flatnonzero(stands(candidates))
        second = np.sort(values[standing])[-2]

        def all_but_the_best(plans: Towers) -> np.ndarray:
            return stands(plans) & (TASKS["overhang"].value(plans) <= second)

        evaluator, _ = evaluator_with(domain, {"overhang": TASKS["overhang"]}, problems=1)
        (row,) = regret_of(evaluator, Says(all_but_the_best), step=0, labelled=0).itertuples()
        best = values[standing].max()
        assert row.value == second
        assert row.best_value == best
        assert row.regret == pytest.approx((best - second) / best)
        assert 0 < row.regret < 1

    def test_where_nothing_is_worth_anything_there_is_no_regret(self, domain: TowerDomain) -> None:
        evaluator, _ = evaluator_with(domain, {"worthless": Worthless()})
        table = regret_of(evaluator, Says(stands), step=0, labelled=0)
        assert table["regret"].isna().tolist() == [True, True]
        assert table["best_value"].tolist() == [0.0, 0.0]

    def test_where_nothing_stands_there_is_no_regret(self, domain: TowerDomain) -> None:
        evaluator, _ = evaluator_with(domain, candidates=1, problems=10)
        table = regret_of(evaluator, Says(lambda plans: np.ones(len(plans))), step=0, labelled=0)
        stood = [bool(stands(problem(domain, number, 1))[0]) for number in range(10)]
        assert table["regret"].notna().tolist() == [value for value in stood for _ in TASKS]
        assert table["best_value"].gt(0).tolist() == [value for value in stood for _ in TASKS]
        assert set(table["best_value"][table["regret"].isna()]) == {0.0}

    def test_every_draw_is_its_own_and_the_same_each_time(self, domain: TowerDomain) -> None:
        drawn: list[list[float]] = []
        chances: list[list[float]] = []
        for step in (3, 3, 4):
            worlds = {"one": Falls(), "other": Falls()}
            predictor = Draws()
            evaluator, _ = evaluator_with(domain, worlds=worlds)
            regret_of(evaluator, predictor, step=step, labelled=70)
            assert len(predictor.drew) == 6, "once about candidates, twice about prefixes of the choices"
            chances.append(predictor.drew[1::3])
            drawn.append([*predictor.drew[0::3], *worlds["one"].drew, *worlds["other"].drew])
            assert all(len(tower) == 1 for world in worlds.values() for tower in world.tried)
        purposes = [stream(5, "predictor", 3, number) for number in range(2)]
        for world in ("one", "other"):
            purposes += [stream(5, f"reward in {world}", 3, number, task) for number in range(2) for task in range(2)]
        assert drawn[0] == [rng.random() for rng in purposes]
        assert drawn[0] == drawn[1]
        assert chances[0] == [stream(5, "chances", 3, number).random() for number in range(2)]
        assert chances[0] == chances[1] != chances[2]
        assert len({*drawn[0], *drawn[2]}) == 20

    def test_what_stands_is_worked_out_once_for_each_problem(self, domain: TowerDomain) -> None:
        counting = Counting(domain)
        evaluator, _ = evaluator_with(counting)
        tables = [regret_of(evaluator, Says(stands), step=step, labelled=0) for step in (0, 1)]
        assert counting.judged == 2
        assert tables[0]["best_value"].tolist() == tables[1]["best_value"].tolist()

    def test_a_tower_that_takes_too_long_ends_it(self, domain: TowerDomain) -> None:
        evaluator, _ = evaluator_with(domain, limit=0.05, worlds={"slow": Slow()})
        with pytest.raises(Stopped, match=r"the plan chosen for tallest in problem 0 took longer .*0\.05 s"):
            regret_of(evaluator, Says(stands), step=0, labelled=0)

    def test_the_chance_of_each_prefix_is_kept(self, domain: TowerDomain) -> None:
        """A predictor that halves the chance with each block says 1, 1/2, 1/4 of the prefixes of three blocks."""
        evaluator, _ = evaluator_with(domain, worlds={"analytic": AnalyticWorld(), "falls": Falls()})
        chosen = evaluator.plan(Says(lambda plans: np.full(len(plans), 0.5 ** (plans.length - 1))), step=0)
        assert [(each.task, each.problem) for each in chosen] == [(t, n) for n in range(2) for t in TASKS]
        for each in chosen:
            assert each.chances.tolist() == [1.0, 0.5, 0.25]
            assert each.chance == 0.25
            assert len(each.plan) == 1
            assert each.value == TASKS[each.task].value(each.plan)[0]
            assert each.outcomes["falls"].labels.tolist() == [1, 1, 0]
            assert (each.outcomes["analytic"].labels == 1).all() == stands(each.plan)[0]

    def test_a_search_regrets_what_a_search_that_knows_the_rule_would_have_found(self, domain: TowerDomain) -> None:
        searcher = SearchPlanner(candidates=CANDIDATES, start=100, generations=10, children=20, parents=5)
        counting = Counting(domain)
        evaluator, _ = evaluator_with(
            counting, planner=searcher, worlds={"analytic": AnalyticWorld(), "falls": Falls()}
        )
        table = regret_of(evaluator, Says(lambda plans: stands(plans).astype(float)), step=3, labelled=70)
        judged = counting.judged
        for row in table.itertuples():
            assert row.search_value >= row.best_value > 0, "it starts from the best candidates"
            reward = row.value * row.feasible
            assert row.search_regret == pytest.approx((row.search_value - reward) / row.search_value)
        assert (table["search_value"] > table["best_value"]).any()
        again = regret_of(evaluator, Says(lambda plans: stands(plans).astype(float)), step=3, labelled=70)
        assert counting.judged == judged, "the reference is searched once for each problem"
        pd.testing.assert_frame_equal(again, table)

    def test_a_planner_plans_with_odds_of_its_own(self, domain: TowerDomain) -> None:
        """What is planned, and the chances that are kept, go by the planner's odds; accuracy by the predictor's."""

        class WithOdds(Says):
            odds = 1.5

            def with_odds(self, odds: float) -> "WithOdds":
                other = WithOdds(self.chance)
                other.odds = odds
                return other

            def feasibility(self, plans: Towers, rng: np.random.Generator | None = None) -> np.ndarray:
                return super().feasibility(plans, rng) * self.odds

        quarter = WithOdds(lambda plans: np.full(len(plans), 0.4))
        for odds, chance in ((None, 0.4 * 1.5), (1.0, 0.4), (0.5, 0.2)):
            planners: list[Planner] = [MonteCarloPlanner(candidates=20, odds=odds)]
            planners += [SearchPlanner(candidates=20, odds=odds)] if odds else []
            for planner in planners:
                evaluator, _ = evaluator_with(domain, planner=planner)
                for each in evaluator.plan(quarter, step=0):
                    assert each.chances == pytest.approx([1.0, chance, chance])
                assert evaluator.accuracy(quarter, 0, 0)["accuracy"].tolist() == [0.5], "0.6 calls every plan feasible"

    def test_the_chances_are_those_of_the_chosen_plan(self, domain: TowerDomain) -> None:
        """Of a predictor that knows the blocks: each problem has blocks of its own."""
        predictor = Says(lambda plans: np.prod(np.cos(5 * plans.dims[..., 0] + 40 * plans.xy[..., 0]) ** 2, axis=-1))
        evaluator, _ = evaluator_with(domain, problems=4)
        for each in evaluator.plan(predictor, step=0):
            expected = predictor.prefix_feasibility(each.plan, np.random.default_rng())[0]
            np.testing.assert_allclose(each.chances, expected, rtol=1e-12)

    def test_without_problems_there_are_no_rows(self, domain: TowerDomain) -> None:
        evaluator, _ = evaluator_with(domain, problems=0)
        table = regret_of(evaluator, Says(stands), step=0, labelled=0)
        assert (len(table), table.columns.tolist()) == (0, REGRET_COLUMNS)


class TestAccuracy:
    def test_a_chance_of_one_half_is_no_yes(self, evaluator: Evaluator) -> None:
        table = evaluator.accuracy(Says(lambda plans: np.full(len(plans), 0.5)), step=3, labelled=70)
        assert table["accuracy"].tolist() == [0.5, 0.5]
        table = evaluator.accuracy(Says(lambda plans: np.where(stands(plans), 0.5, 0.0)), step=3, labelled=70)
        assert table["accuracy"].tolist() == [0.5, 0.5]

    def test_test_sets_are_balanced_of_evaluation_blocks_and_always_the_same(self, domain: TowerDomain) -> None:
        evaluator, said = evaluator_with(domain, lengths=[2, 4], test_plans=20)
        table = evaluator.accuracy(Says(stands), step=3, labelled=70)
        assert table.columns.tolist() == ACCURACY_COLUMNS
        assert table.to_numpy().tolist() == [[3, 70, 2, 1.0, 1.0, 0.0, 0.0, 20], [3, 70, 4, 1.0, 1.0, 0.0, 0.0, 20]]
        assert said == [(3, "testing", 1, 2), (3, "testing", 2, 2)]
        for length in (2, 4):
            plans, labels = evaluator.test_set(length)
            assert plans.blocks == domain.evaluation_blocks or plans.blocks.equals(domain.evaluation_blocks)
            assert (plans.length, labels.sum(), labels.dtype) == (length, 10, bool)
            np.testing.assert_array_equal(labels, stands(plans))
            expected, _ = domain.balanced(length, 20, stream(5, "test set", length))
            np.testing.assert_array_equal(plans.xy, expected.xy)
            again, _ = evaluator.test_set(length)
            assert again is plans, "drawn once"
            others = evaluator_with(domain, lengths=[2, 4], test_plans=20)[0].test_set(length)
            np.testing.assert_array_equal(others[0].xy, plans.xy)
            different = evaluator_with(domain, test_plans=20, seed=6)[0].test_set(length)
            assert not np.array_equal(different[0].xy, plans.xy)

    def test_every_draw_is_its_own(self, domain: TowerDomain) -> None:
        predictor = Draws()
        evaluator, _ = evaluator_with(domain, lengths=[2, 3])
        for step in (0, 1, 1):
            evaluator.accuracy(predictor, step=step, labelled=0)
        purposes = [stream(5, "accuracy", step, length) for step in (0, 1) for length in (2, 3)]
        assert predictor.drew[:4] == [rng.random() for rng in purposes]
        assert predictor.drew[2:4] == predictor.drew[4:]

    def test_without_test_towers_there_are_no_rows(self, domain: TowerDomain) -> None:
        evaluator, said = evaluator_with(domain, test_plans=0)
        table = evaluator.accuracy(Says(stands), step=0, labelled=0)
        assert (len(table), table.columns.tolist(), said) == (0, ACCURACY_COLUMNS, [])


@pytest.mark.parametrize(
    "wrong",
    [
        {"every": 0},
        {"problems": -1},
        {"length": 1},
        {"lengths": [2, 1]},
        {"test_plans": 3},
        {"test_plans": -2},
        {"seed": -1},
        {"worlds": {}},
    ],
)
def test_wrong_settings_are_refused(wrong: dict[str, Any]) -> None:
    settings_with(every=1, problems=0, length=2, lengths=[2, 3], test_plans=0, seed=0)
    with pytest.raises(ValidationError, match=next(iter(wrong))):
        settings_with(**wrong)


def test_odd_numbers_of_test_towers_say_why() -> None:
    with pytest.raises(ValidationError, match="must be even: half of the plans are feasible"):
        settings_with(test_plans=5)
