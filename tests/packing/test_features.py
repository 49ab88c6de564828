"""What a network sees: by hand, and of plans in mirrors."""

from dataclasses import replace

import numpy as np
import pytest

from apf.packing import Cell, Container, Gripper, PackingDomain, failures
from apf.packing.features import N_FEATURES, NEAR, features
from apf.packing.packings import LEVEL


def test_by_hand(pack):
    x = features(pack(("a", "z0", 0.0, 0.0), ("s", "x90", 0.28, 0.25), ("p", "z90", 0.0, -0.1)))[0]
    assert x.shape == (3, N_FEATURES)
    np.testing.assert_allclose(x[0, :4], [1.5, 1.5, 1.5, -1])
    away = 0.5 - 0.125
    near = np.tanh(np.array([away - 1 / 16, away - 1 / 16, away, away, 0.25]) / NEAR)
    np.testing.assert_allclose(x[0, 4:10], [*near, 1.0], rtol=1e-6)
    np.testing.assert_allclose(x[0, 10:], [0, 0, 1.25, 0])
    # the stick lies along x
    np.testing.assert_allclose(x[1, :3], [2.75, 0.25, 0.25], rtol=1e-6)
    assert x[1, 3] == 1
    # the plate, along y, gripped along y, lies on the cube alone; nothing rises above its fingers
    np.testing.assert_allclose(x[2, 10:], [0, -1, (0.25 + 1 / 32) * 10, 2], rtol=1e-6)
    np.testing.assert_allclose(x[2, 9], 0.25 * 0.25 / (0.5 * 0.25), rtol=1e-6)


def test_room_ends_at_boxes_that_rise_above_the_fingers(pack):
    x = features(pack(("a", "z0", 0.0, 0.0), ("b", "z0", 0.32, 0.0), ("c", "z90", -0.26, 0.1), ("p", "z0", 0.0, 0.36)))
    room = {  # placement and side: the room
        (1, 0): 0.32 - 0.25 - 1 / 16,  # from b's finger to a
        (2, 1): 0.26 - 0.25,  # from c's side to a: c is gripped along y
        (2, 0): 0.5 - 0.385,  # from c to the wall
        (3, 3): 0.5 - 0.485,  # from the plate's side to the wall
        (3, 2): 0.235 - 0.225,  # and to c; a and b are as far or farther
    }
    for (placement, side), expected in room.items():
        np.testing.assert_allclose(x[0, placement, 4 + side], np.tanh(expected / NEAR), rtol=1e-4)


def test_boxes_as_low_as_the_fingers_end_take_no_room(pack):
    beside_plate = features(pack(("p", "z0", -0.3, 0.0), ("a", "z0", 0.15, 0.0)))[0, 1, 4]
    beside_cube = features(pack(("b", "z0", -0.175, 0.0), ("a", "z0", 0.15, 0.0)))[0, 1, 4]
    assert beside_plate > 0.99
    np.testing.assert_allclose(beside_cube, np.tanh((0.15 - 0.125 - 1 / 16 + 0.05) / NEAR), rtol=1e-4)


def test_room_of_a_finger_is_as_wide_as_the_finger(pack):
    beside = features(pack(("a", "z0", 0.0, 0.0), ("b", "z0", 0.3, 0.2)))[0, 1, 4]
    in_the_way = features(pack(("a", "z0", 0.0, 0.0), ("b", "z0", 0.3, 0.18)))[0, 1, 4]
    assert beside > 0.99
    np.testing.assert_allclose(in_the_way, np.tanh((0.3 - 0.25 - 1 / 16) / NEAR), rtol=1e-4)


def mirrored_plans(plans, square):
    """The plans that `views` promises the features of, in its order."""
    swaps = [False, True] if square else [False]
    for swap in swaps:
        base = replace(plans, orientation=plans.orientation ^ 1, xy=plans.xy[..., ::-1]) if swap else plans
        for flip_x in (1, -1):
            for flip_y in (1, -1):
                yield replace(base, xy=base.xy * [flip_x, flip_y])


@pytest.mark.parametrize("square", [False, True])
def test_views_are_features_of_plans_with_the_same_labels(square):
    container = Container(length=0.3, width=0.3 if square else 0.26, height=0.2)
    domain = PackingDomain(container=container)
    plans = domain.random_plans(5, 500, np.random.default_rng(0))
    views = list(domain.views(plans))
    others = list(mirrored_plans(plans, square))
    assert len(views) == len(others) == (8 if square else 4)
    np.testing.assert_array_equal(views[0], domain.features(plans))
    for view, other in zip(views, others, strict=True):
        np.testing.assert_allclose(view, domain.features(other), atol=1e-5)
        np.testing.assert_array_equal(failures(other), failures(plans))


def test_without_symmetry_there_is_one_view(domain):
    plans = domain.random_plans(3, 10, np.random.default_rng(0))
    (view,) = replace(domain, symmetry=False).views(plans)
    np.testing.assert_array_equal(view, domain.features(plans))


def test_many_are_seen_as_few(domain):
    plans = domain.random_plans(3, 10_000, np.random.default_rng(1))
    np.testing.assert_array_equal(domain.features(plans)[9000:], domain.features(plans[9000:]))


def test_level_surfaces_bear_together(boxes):
    """Two cubes side by side, one a hair lower: a plate on both is borne by both."""
    dims = boxes.dims.copy()
    dims[1, 2] -= LEVEL / 2
    cell = Cell(Container(length=1, width=1, height=0.5), Gripper(thickness=1 / 16, width=1 / 8, lift=1 / 16))
    level = replace(boxes, dims=dims)
    from apf.packing import Packings

    packings = Packings(
        cell, level, np.array([[0, 1, 4]]), np.array([[1, 1, 0]]), np.array([[[-0.2, 0], [0.2, 0], [0.0, 0]]])
    )
    assert (failures(packings) == 0).all()
    np.testing.assert_allclose(features(packings)[0, 2, 9], 2 * 0.175 / 0.5, rtol=1e-6)
