"""Which placements fail, and why: by hand, and against plain Python."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apf.packing import BoxSet, Cell, Container, Failure, Gripper, Packings, failures, packed, packed_prefixes
from apf.packing.rule import inside_hull
from packing.reference import in_hull, reference

NONE, WALL, FINGER_WALL, FINGER_BOX, TOO_HIGH, UNSUPPORTED, PUSHED = Failure
EDGE = 0.5 - 0.125
"""Where a cube of 1/4 m touches a wall."""
FINGER = 1 / 16


@pytest.mark.parametrize(
    ("placements", "last"),
    [
        # walls: fingers grip along x unless turned
        ([("a", "z0", 0.0, 0.0)], NONE),
        ([("a", "z0", 0.0, EDGE)], NONE),
        ([("a", "z0", 0.0, EDGE + 0.001)], WALL),
        ([("a", "z0", 0.0, -EDGE - 0.001)], WALL),
        ([("a", "z90", EDGE + 0.001, 0.0)], WALL),
        ([("a", "z0", EDGE - FINGER, 0.0)], NONE),
        ([("a", "z0", EDGE - FINGER + 0.001, 0.0)], FINGER_WALL),
        ([("a", "z0", -EDGE + FINGER - 0.001, 0.0)], FINGER_WALL),
        ([("a", "z90", EDGE, 0.0)], NONE),
        ([("a", "z90", 0.0, EDGE - FINGER + 0.001)], FINGER_WALL),
        # a finger is 1/8 m wide, an upright plate half as thick
        ([("p", "x0", 0.0, 0.4375)], NONE),
        ([("p", "x0", 0.0, 0.4385)], FINGER_WALL),
        # fingers beside boxes
        ([("a", "z0", 0.0, 0.0), ("b", "z0", 0.25 + FINGER, 0.0)], NONE),
        ([("a", "z0", 0.0, 0.0), ("b", "z0", 0.25 + FINGER - 0.001, 0.0)], FINGER_BOX),
        ([("a", "z0", 0.0, 0.0), ("b", "z90", 0.25, 0.0)], NONE),
        ([("a", "z0", 0.0, 0.0), ("b", "z90", 0.249, 0.0)], UNSUPPORTED),
        ([("a", "z0", 0.0, 0.0), ("b", "z0", 0.25, 0.1875)], NONE),  # the finger goes down beside a's corner
        ([("a", "z0", 0.0, 0.0), ("b", "z0", 0.25, 0.1865)], FINGER_BOX),
        ([("p", "z0", -0.1, 0.0), ("a", "z0", 0.3, 0.0)], NONE),  # the plate is as low as the fingers end
        # resting on others
        ([("a", "z0", 0.0, 0.0), ("b", "z0", 0.1249, 0.0)], NONE),
        ([("a", "z0", 0.0, 0.0), ("b", "z0", 0.125, 0.0)], UNSUPPORTED),
        ([("a", "z0", 0.0, 0.0), ("b", "z0", 0.0, -0.2)], UNSUPPORTED),
        ([("a", "z90", -0.2, 0.0), ("b", "z90", 0.2, 0.0), ("p", "z0", 0.0, 0.0)], NONE),  # a bridge
        ([("a", "z90", -0.2, -0.1), ("b", "z90", 0.2, 0.1), ("p", "z0", 0.0, 0.0)], NONE),  # across both
        # the hull of two contacts reaches y = 1/8 between them
        ([("a", "z90", -0.2, 0.25), ("b", "z90", 0.2, 0.25), ("p", "z0", 0.0, 0.125)], UNSUPPORTED),
        ([("a", "z90", -0.2, 0.25), ("b", "z90", 0.2, 0.25), ("p", "z0", 0.0, 0.126)], NONE),
        # the rim is at 1/2 m
        ([("a", "z0", 0.0, 0.0), ("b", "z0", 0.0, 0.0)], NONE),
        ([("a", "z0", 0.0, 0.0), ("s", "z0", 0.0, 0.0)], TOO_HIGH),
        ([("a", "z0", 0.0, 0.0), ("s", "x0", 0.0, 0.0)], NONE),
        ([("a", "z0", 0.0, 0.0), ("b", "z0", 0.0, 0.0), ("p", "z0", 0.0, 0.0)], TOO_HIGH),
        # a cube on the end of a plate that lies on a cube; on its middle all is well
        ([("a", "z0", 0.0, 0.0), ("p", "z0", 0.0, 0.0), ("s", "x90", 0.0, 0.0)], NONE),
        ([("a", "z0", 0.0, 0.0), ("p", "z0", 0.1, 0.0), ("s", "x90", 0.28, 0.0)], PUSHED),
        # what rests on one box alone presses where its centre of mass is
        ([("a", "z0", 0.0, 0.0), ("p", "z0", 0.05, 0.0), ("s", "x90", 0.05, 0.0)], NONE),
    ],
)
def test_by_hand(pack, placements, last):
    found = failures(pack(*placements))[0].tolist()
    assert [Failure(code) for code in found] == [NONE] * (len(placements) - 1) + [last]


def test_heights_follow_from_what_lies_below(pack):
    packings = pack(("a", "z0", 0.0, 0.0), ("p", "z0", 0.1, 0.0), ("b", "z0", 0.3, 0.3), ("q", "x0", 0.1, 0.0))
    assert packings.z[0].tolist() == [0.0, 0.25, 0.0, 0.3125]
    assert packings.dims[0, 3].tolist() == [0.25, 0.0625, 0.5]


def test_a_finger_above_the_rim_hits_no_wall(pack):
    packings = pack(("a", "z0", 0.3125, 0.0), ("b", "z90", 0.375, 0.0), ("p", "z90", 0.375, 0.0))
    shallow = Cell(Container(length=1, width=1, height=0.5), replace(packings.cell.gripper, lift=0.25))
    packings = replace(packings, cell=shallow)
    on_top = replace(packings, orientation=np.array([[0, 0, 0]], np.int8), xy=np.array([[[0.3, 0], [0.36, 0], [0, 0]]]))
    assert [Failure(code) for code in failures(on_top)[0, :2]] == [NONE, NONE]
    lower = replace(on_top, cell=Cell(shallow.container, replace(shallow.gripper, lift=0.249)))
    assert Failure(failures(lower)[0, 1]) is FINGER_WALL


def test_a_prefix_that_holds_a_failed_one_has_failed(pack):
    packings = pack(("a", "z0", 0.0, 0.0), ("b", "z0", 0.2, 0.0), ("c", "z0", -0.35, 0.3))
    assert packed_prefixes(packings)[0].tolist() == [True, False, False]
    assert not packed(packings)[0]


STEP = 1 / 32


@st.composite
def on_a_grid(draw):
    """Packings on a grid of 1/32 m, so that much touches, and sums are exact."""
    k = draw(st.integers(1, 5))
    side = st.integers(2, 12).map(lambda n: n * STEP)
    dims = np.array(draw(st.lists(st.tuples(side, side, side), min_size=k, max_size=k)))
    cell = Cell(Container(length=1, width=0.75, height=0.75), Gripper(thickness=STEP, width=2 * STEP, lift=STEP))
    place = st.tuples(st.integers(-16, 16), st.integers(-12, 12))
    xy = np.array(draw(st.lists(place, min_size=k, max_size=k))) * STEP
    orientation = draw(st.lists(st.integers(0, 5), min_size=k, max_size=k))
    boxes = BoxSet(tuple("abcdefg"[:k]), dims, np.ones(k))
    return Packings(cell, boxes, np.arange(k)[None], np.array([orientation]), xy[None])


def must_agree(packings):
    found = failures(packings)
    for number in range(len(packings)):
        expected = reference(packings, number)
        assert found[number, : len(expected)].tolist() == [int(failure) for failure in expected]


@given(on_a_grid())
@settings(max_examples=400)
def test_as_plain_python_says_on_a_grid(packings):
    must_agree(packings)


@pytest.mark.parametrize("length", [2, 3, 5, 7])
def test_as_plain_python_says_of_random_plans(domain, length):
    rng = np.random.default_rng(length)
    must_agree(domain.random_plans(length, 300, rng))
    grown = domain.random_plans(1, 4000, rng)
    for _ in range(length - 1):
        grown = domain.extend(grown[packed(grown)], rng)
    must_agree(grown[:200])


def test_every_failure_comes_up_in_random_plans(domain):
    rng = np.random.default_rng(0)
    grown = domain.random_plans(1, 20_000, rng)
    seen = set()
    for _ in range(4):
        grown = domain.extend(grown[packed(grown)], rng)
        seen |= set(np.unique(failures(grown)[:, -1]).tolist())
    assert seen == {int(failure) for failure in Failure}


@given(
    st.lists(st.tuples(*[st.integers(-6, 6)] * 2, *[st.integers(1, 5)] * 2), min_size=1, max_size=4),
    st.tuples(*[st.integers(-6, 6)] * 2),
)
@settings(max_examples=300)
def test_inside_a_hull(rectangles, point):
    low = np.array([[x, y] for x, y, _, _ in rectangles], float)[..., None]
    high = low + np.array([[w, h] for _, _, w, h in rectangles], float)[..., None]
    corners = [(x + a, y + b) for x, y, w, h in rectangles for a in (0, w) for b in (0, h)]
    found = inside_hull(np.array(point, float)[:, None], low, high, np.ones((len(rectangles), 1), bool))
    assert found[0] == in_hull(point, corners)


def turned(packings, flips=(1, 1)):
    return replace(packings, xy=packings.xy * flips)


@pytest.mark.parametrize("flips", [(-1, 1), (1, -1), (-1, -1)])
@given(packings=on_a_grid())
def test_mirror_images_and_half_turns_keep_labels(flips, packings):
    np.testing.assert_array_equal(failures(turned(packings, flips)), failures(packings))


@given(packings=on_a_grid())
def test_quarter_turns_keep_labels_in_a_square_container(packings):
    square = replace(packings, cell=replace(packings.cell, container=Container(length=1, width=1, height=0.75)))
    quarter = replace(square, orientation=square.orientation ^ 1, xy=square.xy[..., ::-1] * [1, -1])
    np.testing.assert_array_equal(failures(quarter), failures(square))


@given(packings=on_a_grid(), length=st.integers(1, 5))
def test_a_prefix_is_judged_by_itself(packings, length):
    np.testing.assert_array_equal(failures(packings.prefix(length)), failures(packings)[:, :length])


def test_noise_is_judged_where_boxes_came_down(domain):
    rng = np.random.default_rng(1)
    packings = domain.random_plans(4, 500, rng)
    xy = packings.xy + rng.normal(0, 0.003, packings.xy.shape)
    np.testing.assert_array_equal(packed_prefixes(packings, xy), packed_prefixes(replace(packings, xy=xy)))
    assert (packed_prefixes(packings, xy) != packed_prefixes(packings)).any()


def test_many_are_judged_as_few(domain):
    packings = domain.random_plans(3, 20_000, np.random.default_rng(2))
    parts = [failures(packings[start : start + 3000]) for start in range(0, 20_000, 3000)]
    np.testing.assert_array_equal(failures(packings), np.concatenate(parts))


def test_no_packings_have_no_failures(domain):
    assert failures(domain.random_plans(3, 0, np.random.default_rng(0))).shape == (0, 3)
