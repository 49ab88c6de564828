"""What a network sees of a hand-made tower, from each place that positions may count from, and in other units."""

import numpy as np
import pytest

from apf.towers import BlockSet, TowerDomain, Towers, features
from apf.towers.features import COM, MASS, POSITION, SIDES, PositionOf

BLOCKS = BlockSet(
    ("low", "flat", "high"),
    np.array([[0.1, 0.1, 0.06], [0.08, 0.12, 0.02], [0.05, 0.05, 0.1]]),
    np.array([[0.01, 0, 0], [0, -0.02, 0], [0, 0, 0.03]]),
    np.array([0.55, 0.3, 1.0]),
)
TOWER = Towers(
    BLOCKS, np.array([[0, 1, 2]]), np.zeros((1, 3), int), np.array([[[0.2, 0.1], [0.23, 0.06], [0.21, 0.07]]])
)
"""Centres of geometry at heights of 3, 7 and 13 cm."""
POSITIONS = {
    "bottom": [[0, 0, 0], [0.3, -0.4, 0.4], [0.1, -0.3, 1.0]],
    "below": [[2.0, 1.0, 0.3], [0.3, -0.4, 0.4], [-0.2, 0.1, 0.6]],
    "world": [[2.0, 1.0, 0.3], [2.3, 0.6, 0.7], [2.1, 0.7, 1.3]],
}
"""[10 cm]"""


@pytest.mark.parametrize("name", POSITIONS)
def test_positions_count_from_what_is_chosen(name: str) -> None:
    (x,) = features(TOWER, PositionOf(name))
    np.testing.assert_allclose(x[:, POSITION], POSITIONS[name], atol=1e-6)
    (default,) = features(TOWER)
    np.testing.assert_array_equal(x[:, : POSITION.start], default[:, : POSITION.start])
    assert TowerDomain(position_of=name).n_position == (3 if name == "bottom" else 0)


def test_lengths_in_centimetres_are_ten_times_as_large_and_masses_are_not() -> None:
    (x,) = TowerDomain(length_unit=0.01).features(TOWER)
    np.testing.assert_allclose(x[:, MASS], [0, -0.5, 0.9], atol=1e-6)
    np.testing.assert_allclose(x[:, COM], [[1, 0, 0], [0, -2, 0], [0, 0, 3]], atol=1e-5)
    np.testing.assert_allclose(x[:, SIDES], [[0, 0, -4], [-2, 2, -8], [-5, -5, 0]], atol=1e-5)
    np.testing.assert_allclose(x[:, POSITION], 10 * np.array(POSITIONS["bottom"]), atol=1e-5)


@pytest.mark.parametrize("name", POSITIONS)
def test_views_count_from_there_too_and_have_that_unit(name: str) -> None:
    domain = TowerDomain(position_of=name, length_unit=0.01, mirror=False, mass_scales=0, stretch=False)
    views = list(domain.views(TOWER))
    assert len(views) == 4
    for quarters, view in enumerate(views):
        np.testing.assert_allclose(view, domain.features(TOWER.turned(quarters)), atol=1e-5)
    np.testing.assert_allclose(
        views[1][0, 1, POSITION][:2], 10 * np.array(POSITIONS[name])[1, [1, 0]] * [-1, 1], atol=1e-5
    )
