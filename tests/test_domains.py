"""What every domain must offer, whatever its plans are made of."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest
from pydantic import ValidationError

import apf.packing
import apf.towers
from apf.domain import Domain, Labelled, NamedPlans, Predictor, Task, World, are_labels
from apf.errors import InputError
from apf.rundir.tables import write_table


def towers() -> Domain:
    sources = (apf.towers.BlockSource(blocks=8, seed=seed) for seed in (0, 1))
    return apf.towers.TowerDomain(**dict(zip(("training", "evaluation"), sources, strict=True)))


def packing() -> Domain:
    sources = (apf.packing.BoxSource(boxes=12, seed=seed) for seed in (0, 1))
    return apf.packing.PackingDomain(**dict(zip(("training", "evaluation"), sources, strict=True)))


PARTS: dict[Callable[[], Domain], tuple[list[World], list[Task], list[Predictor]]] = {
    towers: (
        [apf.towers.AnalyticWorld(), apf.towers.NoisyWorld(noise=0.003)],
        [apf.towers.Tallest(), apf.towers.Overhang(), apf.towers.Unsupported()],
        [apf.towers.AnalyticPredictor(), apf.towers.SimulationPredictor(perturbations=3, noise=0.005)],
    ),
    packing: (
        [apf.packing.AnalyticWorld(), apf.packing.NoisyWorld(noise=0.003)],
        [apf.packing.Volume(), apf.packing.Value(), apf.packing.Flat()],
        [apf.packing.AnalyticPredictor(), apf.packing.SimulationPredictor(perturbations=3, noise=0.005)],
    ),
}


@pytest.fixture(scope="module", params=PARTS, ids=lambda make: make.__name__)
def make(request: pytest.FixtureRequest) -> Callable[[], Domain]:
    return request.param


@pytest.fixture(scope="module")
def domain(make: Callable[[], Domain]) -> Domain:
    return make()


@pytest.fixture(scope="module")
def worlds(make: Callable[[], Domain]) -> list[World]:
    return PARTS[make][0]


@pytest.fixture(scope="module")
def tasks(make: Callable[[], Domain]) -> list[Task]:
    return PARTS[make][1]


@pytest.fixture(scope="module")
def predictors(make: Callable[[], Domain]) -> list[Predictor]:
    return PARTS[make][2]


def rng_of(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def same(domain: Domain, one: Any, other: Any) -> bool:
    """The same plans, bit for bit?"""
    return one.length == other.length and domain.encode(one) == domain.encode(other)


@pytest.mark.parametrize("length", [1, 2, 5])
def test_random_plans_have_their_number_and_length_and_follow_the_seed(domain, length):
    plans = domain.random_plans(length, 30, rng_of())
    assert (len(plans), plans.length) == (30, length)
    assert same(domain, plans, domain.random_plans(length, 30, rng_of()))
    assert not same(domain, plans, domain.random_plans(length, 30, rng_of(1)))
    distinct = {json.dumps(plan) for plan in domain.encode(plans)}
    assert len(distinct) == 30 or length == 1, "plans are drawn independently"


def test_no_plans_are_plans(domain):
    plans = domain.random_plans(3, 0, rng_of())
    assert len(plans) == 0
    assert domain.features(plans).shape == (0, 3, domain.n_features)
    assert domain.feasible(plans).shape == (0,)
    assert domain.encode(plans) == []
    assert len(domain.extend(plans, rng_of())) == 0


def test_a_first_placement_succeeds(domain):
    assert domain.feasible(domain.random_plans(1, 2000, rng_of())).all()


@pytest.mark.parametrize("length", [2, 3, 4, 5])
def test_random_plans_are_neither_nearly_all_feasible_nor_nearly_none(domain, length):
    share = domain.feasible(domain.random_plans(length, 50_000, rng_of(length))).mean()
    assert 0.001 < share < 0.9


def test_extensions_keep_what_they_extend(domain):
    plans = domain.random_plans(2, 40, rng_of())
    longer = domain.extend(plans, rng_of(1))
    assert (len(longer), longer.length) == (40, 3)
    assert same(domain, longer.prefix(2), plans)
    assert same(domain, longer, domain.extend(plans, rng_of(1)))


def test_rows_and_parts(domain):
    plans = domain.random_plans(3, 20, rng_of())
    mask = np.arange(20) % 3 == 0
    assert same(domain, plans[mask], plans[np.flatnonzero(mask)])
    assert same(domain, domain.concatenate([plans[:7], plans[7:]]), plans)
    assert same(domain, plans.prefix(3), plans)


def test_a_plan_that_holds_an_infeasible_prefix_is_infeasible(domain):
    plans = domain.random_plans(4, 5000, rng_of(2))
    for length in (1, 2, 3):
        assert not (domain.feasible(plans) & ~domain.feasible(plans.prefix(length))).any()


def test_lengths_that_cannot_be_made_are_refused_by_key(domain):
    for evaluation in (False, True):
        domain.check_length(5, "evaluation.length", evaluation=evaluation)
        with pytest.raises(InputError, match=r"^evaluation\.length: "):
            domain.check_length(100, "evaluation.length", evaluation=evaluation)


def test_features_are_of_about_unit_range(domain):
    plans = domain.random_plans(5, 2000, rng_of(3))
    x = domain.features(plans)
    assert x.shape == (2000, 5, domain.n_features)
    assert x.dtype == np.float32
    assert 0 < domain.n_position < domain.n_features
    assert np.isfinite(x).all()
    assert np.abs(x).mean() < 2
    assert np.abs(x).max() < 10
    assert (x.reshape(-1, domain.n_features).std(0) > 0.05).all(), "each feature tells something"


def test_features_of_a_prefix_are_those_of_the_plan(domain):
    plans = domain.random_plans(4, 50, rng_of(4))
    np.testing.assert_array_equal(domain.features(plans.prefix(2)), domain.features(plans)[:, :2])


def test_views_are_features_of_the_same_shape(domain):
    plans = domain.random_plans(3, 50, rng_of(5))
    views = list(domain.views(plans))
    assert views
    assert all(view.shape == domain.features(plans).shape and view.dtype == np.float32 for view in views)
    assert len({view.tobytes() for view in views}) == len(views), "each view shows another side"


@pytest.mark.parametrize("length", [2, 4])
def test_balanced_sets_are_half_feasible(domain, length):
    plans, labels = domain.balanced(length, 60, rng_of(length))
    assert (len(plans), plans.length, labels.dtype) == (60, length, bool)
    assert labels.sum() == 30
    np.testing.assert_array_equal(labels, domain.feasible(plans))
    again, _ = domain.balanced(length, 60, rng_of(length))
    assert same(domain, plans, again)


def test_problems_have_their_candidates(domain, tasks):
    candidates = domain.problem(4, 500, rng_of(6))
    assert (len(candidates), candidates.length) == (500, 4)
    assert same(domain, candidates, domain.problem(4, 500, rng_of(6)))
    for task in tasks:
        value = task.value(candidates)
        assert value.shape == (500,)
        assert (value >= 0).all()
        assert len(np.unique(value)) > 1, "a plan matters for the task"
        assert task.title
        assert isinstance(task.unit, str)


def test_what_json_holds_gives_the_same_plans_bit_for_bit(domain):
    plans = domain.random_plans(3, 40, rng_of(7))
    encoded = json.loads(json.dumps(domain.encode(plans)))
    decoded = domain.decode(encoded)
    assert same(domain, decoded, plans)
    np.testing.assert_array_equal(domain.features(decoded), domain.features(plans))
    assert [domain.encoded_length(plan) for plan in encoded] == [3] * 40
    key = next(iter(encoded[0]))
    for other in ({}, {"a": 1}, encoded[0] | {key: encoded[0][key][:-1]}, encoded[0] | {key: [10**6] * 3}):
        with pytest.raises(ValueError, match="plan"):
            domain.encoded_length(other)


def test_plans_of_a_problem_are_kept_with_the_objects_of_the_evaluation(domain):
    """A problem has some of these objects; their numbers in it are not those in the whole set."""
    plans = domain.problem(3, 20, rng_of(9))
    encoded = json.loads(json.dumps(domain.encode(plans, evaluation=True)))
    decoded = domain.decode(encoded, evaluation=True)
    np.testing.assert_array_equal(domain.features(decoded), domain.features(plans))
    columns = list(domain.table(plans))
    assert domain.table(decoded)[columns].equals(domain.table(plans)[columns])
    assert [domain.encoded_length(plan, evaluation=True) for plan in encoded] == [3] * 20


def test_a_problem_of_the_experiment_has_its_objects(domain):
    plans = domain.problem(3, 20, rng_of(9), evaluation=False)
    mine = set(domain.table(domain.random_plans(3, 500, rng_of(10)))[domain.object_word])
    assert set(domain.table(plans)[domain.object_word]) <= mine
    decoded = domain.decode(json.loads(json.dumps(domain.encode(plans))))
    np.testing.assert_array_equal(domain.features(decoded), domain.features(plans))


def test_tables_have_a_row_for_each_placement(domain):
    table = domain.table(domain.random_plans(3, 4, rng_of(8)))
    assert table.columns[:2].tolist() == [domain.plan_word, "position"]
    assert table[domain.plan_word].tolist() == [i for i in range(4) for _ in range(3)]
    assert table["position"].tolist() == [0, 1, 2] * 4
    assert domain.object_word in table.columns


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_a_table_is_a_file_of_plans(domain, ending, tmp_path):
    parts = [domain.random_plans(length, 5, rng_of(length)) for length in (2, 4)]
    tables = [domain.table(plans) for plans in parts]
    tables[1][domain.plan_word] += 5
    path = tmp_path / f"plans{ending}"
    write_table(pd.concat(tables), path)
    found = domain.read_plans(path)
    assert all(isinstance(batch, NamedPlans) for batch in found)
    assert [batch.names for batch in found] == [(0, 1, 2, 3, 4), (5, 6, 7, 8, 9)]
    for batch, table in zip(found, tables, strict=True):
        mine = domain.table(batch.plans).drop(columns=domain.plan_word)
        pd.testing.assert_frame_equal(mine, table.drop(columns=domain.plan_word))


def test_objects_are_kept(domain, make, tmp_path):
    assert tuple(domain.objects) == domain.object_files
    domain.keep(tmp_path)
    domain.check_kept(tmp_path)
    kept = domain.kept_in(tmp_path)
    assert kept.digests == domain.digests
    assert len(set(domain.digests.values())) == len(domain.object_files)
    plans = domain.random_plans(3, 10, rng_of(9))
    assert same(domain, plans, kept.random_plans(3, 10, rng_of(9)))
    name = domain.object_files[0]
    domain.write_objects(domain.objects[domain.object_files[1]], tmp_path / name)
    with pytest.raises(InputError, match=name):
        make().check_kept(tmp_path)
    (tmp_path / name).write_text("nothing\n")
    with pytest.raises(InputError, match=name):
        domain.read_objects(tmp_path / name)


def test_worlds_label_prefixes(domain, worlds):
    plans = domain.random_plans(4, 400, rng_of(10))
    exact, noisy = (world.execute(plans, rng_of(11)) for world in worlds)
    for world, labels in zip(worlds, (exact, noisy), strict=True):
        assert isinstance(domain, world.for_domain)
        assert (labels.shape, labels.dtype) == ((400, 4), np.int8)
        assert all(map(are_labels, labels))
        np.testing.assert_array_equal(world.execute(plans, rng_of(11)), labels)
        Labelled(plans, labels)
    np.testing.assert_array_equal((exact == 1).all(1), domain.feasible(plans))
    assert (exact != noisy).any()


def test_predictors_that_know_the_rule(domain, predictors):
    plans, labels = domain.balanced(3, 200, rng_of(12))
    analytic, simulation = (predictor.feasibility(plans, rng_of(13)) for predictor in predictors)
    np.testing.assert_array_equal(analytic, labels)
    np.testing.assert_array_equal(predictors[0].last_feasibility(plans), labels)
    assert set(np.unique(simulation)) == {0.0, 1.0}
    assert simulation.mean() < analytic.mean()
    assert predictors[1].random
    with pytest.raises(ValidationError, match="perturbations"):
        type(predictors[1])(perturbations=0, noise=0.005)
