"""Boxes, random packings, problems, and what packings are worth."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from apf.errors import InputError
from apf.packing import (
    BoxSet,
    BoxSource,
    Container,
    Flat,
    NoisyWorld,
    PackingDomain,
    Places,
    SimulationPredictor,
    Value,
    Volume,
    packed,
)
from apf.packing.balanced import balanced_packings


def rng_of(seed=0):
    return np.random.default_rng(seed)


@pytest.mark.parametrize("length", [1, 3, 8])
def test_no_box_comes_twice_and_each_comes_as_often(domain, length):
    plans = domain.random_plans(length, 8000, rng_of())
    assert all(len(set(row)) == length for row in plans.box.tolist())
    for place in plans.box.T:
        np.testing.assert_allclose(np.bincount(place, minlength=8), 1000, atol=150)
    np.testing.assert_allclose(np.bincount(plans.orientation.ravel()), 8000 * length / 6, rtol=0.1)


def test_no_box_is_left(domain):
    plans = domain.random_plans(8, 3, rng_of())
    with pytest.raises(ValueError, match="no box is left"):
        domain.extend(plans, rng_of())
    with pytest.raises(ValueError, match="9 boxes need"):
        domain.random_plans(9, 3, rng_of())


def test_first_boxes_succeed_with_noise_of_a_third_of_the_room(domain):
    plans = domain.random_plans(1, 20_000, rng_of())
    labels = NoisyWorld(noise=domain.places.room / 3).execute(plans, rng_of(1))
    assert (labels == 1).mean() > 0.999


@pytest.mark.parametrize(("wall", "beside", "stacked"), [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0)])
def test_places_are_where_they_should_be(domain, wall, beside, stacked):
    gap = (0.0, 0.02)
    plans = replace(domain, places=Places(wall=wall, beside=beside, stacked=stacked, gap=gap)).random_plans(
        2, 4000, rng_of(3)
    )
    half = plans.dims[..., :2] / 2
    room = plans.cell.container.half - np.abs(plans.xy[:, 1]) - half[:, 1]
    apart = np.abs(plans.xy[:, 1] - plans.xy[:, 0]) - half.sum(1)
    assert (room > -1e-12).all()
    if wall:
        assert ((room >= 0) & (room <= 0.02 + 1e-12)).all()
    elif beside:
        assert ((apart > -1e-12) & (apart < 0.02 + 1e-12)).mean() > 0.6
    elif stacked:
        assert (np.abs(plans.xy[:, 1] - plans.xy[:, 0]) <= half[:, 0] + 1e-12).mean() > 0.8
    else:
        share = np.abs(plans.xy[:, 1]) / (plans.cell.container.half - half[:, 1])
        np.testing.assert_allclose(np.quantile(share, [0.25, 0.5, 0.75]), [0.25, 0.5, 0.75], atol=0.03)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"wall": 0.5, "beside": 0.4, "stacked": 0.2}, "at most 1 together"),
        ({"gap": (0.02, 0.01)}, "lower bound comes first"),
        ({"wall": -0.1}, "greater than or equal to 0"),
    ],
)
def test_places_that_cannot_be(wrong, words):
    with pytest.raises(ValidationError, match=words):
        Places(**wrong)


def test_boxes_that_do_not_fit_by_themselves_are_refused(domain):
    low = replace(domain, container=Container(length=0.36, width=0.28, height=0.1))
    with pytest.raises(InputError, match=r"domain\.training: box box_\d\d in orientation .* does not fit"):
        low.check_length(2, "sampler")
    narrow = replace(domain, container=Container(length=0.36, width=0.12, height=0.2))
    with pytest.raises(InputError, match=r"domain\.evaluation: box"):
        narrow.check_length(2, "evaluation.length", evaluation=True)


@pytest.mark.parametrize(
    ("dims", "value", "words"),
    [
        ([0.1, 0.1, 0.0], 1, "sides must be"),
        ([0.1, np.nan, 0.1], 1, "sides must be"),
        ([100, 80, 60], 1, r"write a unit in the header, as in dim_x \[mm\]"),
        ([0.1, 0.1, 0.1], -1, "value = -1"),
        ([0.1, 0.1, 0.1], np.inf, "value = inf"),
    ],
)
def test_impossible_boxes(dims, value, words):
    with pytest.raises(InputError, match=words):
        BoxSet(("a",), np.array([dims], float), np.array([value], float))


def test_names_that_cannot_be():
    for names, words in ((("a", "a"), "stands twice"), ((" a", "b"), "blanks"), (("a\n", "b"), "blanks|printable")):
        with pytest.raises(InputError, match=words):
            BoxSet(names, np.full((2, 3), 0.1), np.ones(2))


def test_problems_choose_among_more_boxes_than_they_pack():
    domain = PackingDomain()
    plans = domain.problem(4, 3000, rng_of())
    assert len(plans.boxes) == 8
    assert set(plans.boxes.name) <= set(domain.evaluation_boxes.name)
    assert set(np.unique(plans.box)) == set(range(8))
    few = replace(domain, choice=1)
    assert len(few.problem(4, 10, rng_of()).boxes) == 4
    assert len(domain.problem(15, 10, rng_of()).boxes) == 20, "as far as there are boxes"


def test_tasks_by_hand(pack):
    plans = pack(("a", "z0", 0.0, 0.0), ("p", "z0", 0.0, 0.0), ("q", "x0", 0.3, 0.3))
    assert Volume().value(plans)[0] == pytest.approx((0.25**3 + 2 * 0.5 * 0.25 * 0.0625) * 1000)
    assert Value().value(plans)[0] == 1 + 5 + 6
    tops = np.array([0.25, 0.3125, 0.5])
    assert Flat().value(plans)[0] == pytest.approx(0.5 - np.sqrt((tops**2).mean()))
    lying = pack(("p", "z0", 0.0, 0.3), ("q", "z0", 0.0, -0.3))
    assert Flat().value(lying)[0] == pytest.approx(0.5 - 0.0625)
    above = pack(("s", "z0", 0.0, 0.0), ("a", "z0", 0.0, 0.0), ("b", "z0", 0.0, 0.0), ("c", "z0", 0.0, 0.0))
    assert Flat().value(above)[0] == 0, "never negative"


@pytest.mark.parametrize("task", [Volume(), Value(), Flat()])
def test_tasks_differ_by_the_boxes_that_are_packed(task):
    plans = PackingDomain().problem(3, 5000, rng_of())
    value = task.value(plans)
    by_boxes = {frozenset(row): v for row, v in zip(plans.box.tolist(), value.tolist(), strict=True)}
    assert len(set(by_boxes.values())) > 10


@pytest.mark.parametrize("task", [Volume(), Flat()])
def test_what_is_worth_more_is_harder(task):
    """The best tenth of random plans succeeds less often than all of them do."""
    plans = PackingDomain().problem(5, 40_000, rng_of(1))
    value, ok = task.value(plans), packed(plans)
    if isinstance(task, Flat):  # plans that fail by standing high have no value to conflict with
        best_possible = value >= np.quantile(value[ok], 0.99)
        assert ok[best_possible].mean() < 0.5
    else:
        assert ok[value >= np.quantile(value, 0.9)].mean() < ok.mean()


def test_balanced_sets_do_not_repeat_and_say_when_there_is_nothing(domain):
    plans, labels = domain.balanced(5, 200, rng_of())
    np.testing.assert_array_equal(packed(plans), labels)
    assert len({xy.tobytes() for xy in plans.xy}) == 200
    with pytest.raises(ValueError, match="even"):
        domain.balanced(3, 5, rng_of())
    boxes = BoxSource(boxes=6, side=(0.1, 0.1)).load()
    tight = replace(domain, container=Container(length=0.15, width=0.15, height=0.12))
    with pytest.raises(InputError, match="no random packing of 4 boxes succeeds"):
        balanced_packings(tight.cell, boxes, 4, 10, rng_of(), domain.places)


def test_simulation_is_the_stricter_the_more_it_tries(domain):
    plans = domain.random_plans(3, 3000, rng_of())
    shares = [
        SimulationPredictor(perturbations=n, noise=0.003).feasibility(plans, rng_of(1)).mean() for n in (1, 5, 25)
    ]
    assert shares[0] > shares[1] > shares[2] > 0
    almost = SimulationPredictor(perturbations=3, noise=1e-12).feasibility(plans, rng_of())
    assert (almost == packed(plans)).mean() > 0.999
