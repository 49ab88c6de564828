import math
from statistics import NormalDist

import numpy as np
import pytest
from pydantic import ValidationError

from apf.domain import Oracle, Predictor
from apf.towers import AnalyticPredictor, AnalyticWorld, NoisyWorld, Offset, SimulationPredictor, random_towers, stands


def rng_of(seed):
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def towers(blocks):
    """Of which about a third stand."""
    return random_towers(blocks, 4, 400, rng_of(0), Offset(sd=0.2))


class TestAnalytic:
    def test_by_hand(self, build, cubes):
        # half a side is 0.0625; the third tower falls at the third block: (0.05 + 0.1) / 2 = 0.075
        plans = build(
            cubes,
            [(0, 0, 0, 0), (1, 0, 0.06, 0), (2, 0, 0.06, 0)],
            [(0, 0, 0, 0), (1, 0, 0.065, 0), (2, 0, 0.0, 0)],
            [(0, 0, 0, 0), (1, 0, 0.05, 0), (2, 0, 0.1, 0)],
        )
        assert AnalyticPredictor().feasibility(plans, rng_of(0)).tolist() == [1.0, 0.0, 0.0]

    def test_draws_nothing(self, towers):
        rng = rng_of(5)
        AnalyticPredictor().feasibility(towers, rng)
        assert rng.bit_generator.state == rng_of(5).bit_generator.state
        assert not AnalyticPredictor().random

    def test_is_the_product_over_prefixes(self, towers):
        predictor = AnalyticPredictor()
        assert predictor.by_prefix
        product = np.prod([predictor.last_feasibility(towers.prefix(k)) for k in (2, 3, 4)], axis=0)
        np.testing.assert_array_equal(product, predictor.feasibility(towers, rng_of(0)))
        assert 0 < product.sum() < 400


class TestSimulation:
    def test_a_seed_fixes_the_answer(self, towers):
        predictor = SimulationPredictor(perturbations=10, noise=0.005)
        first, again, other = (predictor.feasibility(towers, rng_of(seed)) for seed in (1, 1, 2))
        np.testing.assert_array_equal(first, again)
        assert (first != other).any()
        assert set(first) == {0.0, 1.0}

    def test_says_that_it_draws(self):
        assert SimulationPredictor().random
        assert not SimulationPredictor().by_prefix

    def test_tiny_noise_is_the_analytic_answer(self, towers):
        answer = SimulationPredictor(perturbations=3, noise=1e-9).feasibility(towers, rng_of(0))
        np.testing.assert_array_equal(answer, stands(towers))
        assert 0 < answer.sum() < 400

    def test_what_falls_by_far_is_never_feasible(self, build, cubes):
        # 2.75 cm outside the edge: 3.9 sd of 5 sqrt(2) mm; to be called feasible it must stand ten times of ten
        tower = build(cubes, [(0, 0, 0, 0), (1, 0, 0.09, 0)])
        answer = SimulationPredictor().feasibility(tower[np.zeros(2000, int)], rng_of(0))
        assert not answer.any()

    def test_what_stands_by_far_is_always_feasible(self, build, cubes):
        tower = build(cubes, [(0, 0, 0, 0), (1, 0, 0.01, 0)])
        answer = SimulationPredictor().feasibility(tower[np.zeros(500, int)], rng_of(0))
        assert answer.all()

    @pytest.mark.parametrize(
        ("perturbations", "share"),
        [
            # 1 cm inside the edge is 1.4142 sd of 5 sqrt(2) mm: one perturbed tower stands with 0.92135
            (1, 0.92135),
            (3, 0.92135**3),
            (10, 0.92135**10),
        ],
    )
    def test_it_must_stand_under_every_perturbation(self, build, cubes, perturbations, share):
        tower = build(cubes, [(0, 0, 0, 0), (1, 0, 0.0525, 0)])
        predictor = SimulationPredictor(perturbations=perturbations, noise=0.005)
        answer = predictor.feasibility(tower[np.zeros(8000, int)], rng_of(0))
        assert answer.mean() == pytest.approx(share, abs=0.025)  # sd at most 0.0056

    def test_a_prefix_that_falls_counts(self, build, cubes):
        # as a whole it balances, (0.09 + 0) / 2 = 0.045, but its first two blocks do not
        tower = build(cubes, [(0, 0, 0, 0), (1, 0, 0.09, 0), (2, 0, 0.04, 0)])
        assert not SimulationPredictor(noise=0.001).feasibility(tower, rng_of(0)).any()

    def test_no_towers_no_answers(self, towers):
        assert SimulationPredictor().feasibility(towers[:0], rng_of(0)).shape == (0,)

    @pytest.mark.parametrize("wrong", [{"perturbations": 0}, {"noise": 0.0}, {"noise": -1.0}, {"sd": 0.005}])
    def test_wrong_settings_are_refused(self, wrong):
        with pytest.raises(ValidationError):
            SimulationPredictor(**wrong)


def test_a_predictor_of_whole_plans_says_so_when_asked_for_a_prefix(towers):
    class Whole(Predictor):
        def feasibility(self, plans, rng):
            return np.ones(len(plans))

    with pytest.raises(TypeError, match="Whole judges whole plans only"):
        Whole().last_feasibility(towers)


class TestOracle:
    def test_says_how_often_a_plan_succeeds_in_the_world(self, build, cubes):
        """Half a side is 0.0625 m: with a noise of 3 mm sqrt 2, towers that far from the edge stand as often."""
        offsets = np.array([0.0, 0.0583, 0.0625, 0.0667])
        plans = build(cubes, *([(0, 0, 0, 0), (1, 0, x, 0)] for x in offsets))
        said = Oracle(world=NoisyWorld(noise=0.003), tries=1000).feasibility(plans, rng_of(0))
        expected = [NormalDist().cdf((0.0625 - x) / (0.003 * math.sqrt(2))) for x in offsets]
        np.testing.assert_allclose(said, expected, atol=0.05)

    def test_of_a_world_without_noise_is_the_analytic_rule(self, towers):
        said = Oracle(world=AnalyticWorld(), tries=1).feasibility(towers, rng_of(0))
        np.testing.assert_array_equal(said, stands(towers))

    def test_each_prefix_is_as_likely_as_those_before_or_less(self, towers):
        chances = Oracle(world=NoisyWorld(noise=0.003), tries=300).prefix_feasibility(towers, rng_of(0))
        assert (chances[:, 0] == 1).all()
        assert (np.diff(chances, axis=1) < 0.15).all()
