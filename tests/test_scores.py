"""Scores of many plans: computed in chunks, as each plan's alone."""

from collections.abc import Callable

import numpy as np
import pytest

from apf.acquisition import Bald, ExpectedBald, Random, Score, bald, expected_bald, scores
from apf.domain import Kind
from apf.towers import TowerDomain, Towers


class Counting:
    """Asks another model, and keeps how many plans it was asked about at once."""

    def __init__(self, model: scores.Model) -> None:
        self.model = model
        self.asked: list[int] = []

    def predict(self, plans: Towers) -> np.ndarray:
        self.asked.append(len(plans))
        return self.model.predict(plans)


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture
def model(fake_ensemble: Callable[..., scores.Model]) -> Counting:
    return Counting(fake_ensemble(Kind.SUBSEQUENCE))


@pytest.mark.parametrize(
    ("score", "of_members"), [(Bald(), lambda p: bald(p[:, :, 2])), (ExpectedBald(), expected_bald)]
)
@pytest.mark.parametrize(("n", "asked"), [(21, [7, 7, 7]), (24, [7, 7, 7, 3]), (7, [7]), (3, [3]), (1, [1])])
def test_every_plan_has_its_own_score_however_many_there_are(
    score: Score,
    of_members: Callable[[np.ndarray], np.ndarray],
    n: int,
    asked: list[int],
    model: Counting,
    domain: TowerDomain,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plans = domain.random_plans(4, n, rng())
    expected = of_members(model.model.predict(plans))
    assert len(set(expected.tolist())) == n
    monkeypatch.setattr(scores, "CHUNK", 7)
    np.testing.assert_allclose(score(model, plans, rng()), expected, rtol=1e-12)
    assert model.asked == asked


@pytest.mark.parametrize("score", [Bald(), ExpectedBald(), Random()])
def test_no_plans_have_no_scores(score: Score, model: Counting, domain: TowerDomain) -> None:
    assert score(model, domain.random_plans(3, 0, rng()), rng()).shape == (0,)


def test_only_a_random_score_needs_no_model() -> None:
    assert [score.asks_model for score in (Bald(), ExpectedBald(), Random())] == [True, True, False]
