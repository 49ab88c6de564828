import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from apf.errors import InputError
from apf.towers import QUATERNIONS, ROTATIONS, rotation_index
from apf.towers.rotations import TURN

HALF = np.sqrt(0.5)


def as_integers(matrix):
    return tuple(round(v) for v in matrix.ravel())


def turned_by_quaternion(q, v):
    """v turned by q = (x, y, z, w), from Hamilton's product q v q*, written out."""

    def times(a, b):
        ax, ay, az, aw = a
        bx, by, bz, bw = b
        return (
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        )

    x, y, z, w = q
    return times(times(q, (*v, 0.0)), (-x, -y, -z, w))[:3]


def test_there_are_24_distinct_proper_rotations():
    assert ROTATIONS.shape == (24, 3, 3)
    assert len({as_integers(m) for m in ROTATIONS}) == 24
    np.testing.assert_allclose(np.linalg.det(ROTATIONS), 1.0, atol=1e-12)


def test_rotations_are_signed_permutations():
    assert set(np.unique(np.abs(ROTATIONS))) == {0.0, 1.0}
    np.testing.assert_array_equal(np.abs(ROTATIONS).sum(1), 1)
    np.testing.assert_array_equal(np.abs(ROTATIONS).sum(2), 1)


def test_rotations_form_a_group():
    group = {as_integers(m) for m in ROTATIONS}
    products = {as_integers(a @ b) for a in ROTATIONS for b in ROTATIONS}
    inverses = {as_integers(m.T) for m in ROTATIONS}
    assert products == group
    assert inverses == group


def test_identity_comes_first():
    np.testing.assert_array_equal(QUATERNIONS[0], [0, 0, 0, 1])
    np.testing.assert_array_equal(ROTATIONS[0], np.eye(3))


def test_quaternions_are_unit_and_one_of_each_pair_of_opposites():
    np.testing.assert_allclose(np.linalg.norm(QUATERNIONS, axis=1), 1.0, atol=1e-15)
    similarity = np.abs(QUATERNIONS @ QUATERNIONS.T) - np.eye(24)
    assert similarity.max() < 0.8  # the nearest two differ by a quarter turn: cos 45 degrees = 0.707


@pytest.mark.parametrize("rotation", range(24))
def test_matrix_does_what_its_quaternion_does(rotation):
    v = (0.3, -1.1, 2.0)
    expected = turned_by_quaternion(QUATERNIONS[rotation], v)
    np.testing.assert_allclose(ROTATIONS[rotation] @ v, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("quaternion", "matrix"),
    [
        ((0, 0, HALF, HALF), [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),  # a quarter about z: x to y, y to -x
        ((HALF, 0, 0, HALF), [[1, 0, 0], [0, 0, -1], [0, 1, 0]]),  # a quarter about x: y to z, z to -y
        ((0, HALF, 0, HALF), [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]),  # a quarter about y: z to x, x to -z
        ((0, 0, 1, 0), [[-1, 0, 0], [0, -1, 0], [0, 0, 1]]),  # a half about z
        ((0.5, 0.5, 0.5, 0.5), [[0, 0, 1], [1, 0, 0], [0, 1, 0]]),  # a third about (1, 1, 1): x to y to z to x
    ],
)
def test_known_rotations(quaternion, matrix):
    np.testing.assert_array_equal(ROTATIONS[rotation_index(np.array(quaternion))], matrix)


@pytest.mark.parametrize("quarters", range(4))
def test_turn_is_a_rotation_about_the_vertical_afterwards(quarters):
    cos, sin = [(1, 0), (0, 1), (-1, 0), (0, -1)][quarters]
    about_z = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    assert TURN.shape == (4, 24)
    for rotation in range(24):
        np.testing.assert_array_equal(ROTATIONS[TURN[quarters, rotation]], about_z @ ROTATIONS[rotation])


@pytest.mark.parametrize("sign", [1, -1])
def test_rotation_index_accepts_either_sign(sign):
    np.testing.assert_array_equal(rotation_index(sign * QUATERNIONS), np.arange(24))


def test_rotation_index_keeps_leading_axes():
    assert rotation_index(QUATERNIONS.reshape(2, 3, 4, 4)).shape == (2, 3, 4)
    assert rotation_index(QUATERNIONS[7]) == 7


@given(rotation=st.integers(0, 23), noise=st.lists(st.floats(-5e-4, 5e-4), min_size=4, max_size=4))
def test_rotation_index_allows_for_rounding(rotation, noise):
    assert rotation_index(QUATERNIONS[rotation] + noise) == rotation


@pytest.mark.parametrize(
    "quaternion",
    [
        (0, 0, np.sin(np.pi / 8), np.cos(np.pi / 8)),  # 45 degrees about z
        (0.001, 0, 0, 1),
        (0, 0, 0, 0),
        (0, 0, 0, 2),
        (0, 0, 0, 0.999),
        (1, 1, 1, 1),
        (np.nan, 0, 0, 1),
        (0, 0, 0, np.inf),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_rotation_index_refuses_what_is_not_axis_aligned(quaternion):
    with pytest.raises(InputError, match="not one of the 24 axis-aligned rotations"):
        rotation_index(np.array(quaternion, float))


def test_rotation_index_shows_the_quaternion_that_is_wrong():
    batch = np.array([[0, 0, 0, 1], [0, 0.6, 0, 0.8], [1, 0, 0, 0]])
    with pytest.raises(InputError, match=r"\(0\.0, 0\.6, 0\.0, 0\.8\)"):
        rotation_index(batch)


@pytest.mark.parametrize(
    ("quaternion", "said"),
    [
        ((0, 0, np.sin(np.pi / 9), np.cos(np.pi / 9)), "it is 40 degrees off the nearest, (0, 0, 0, 1)"),
        ((HALF, 0, 0.02, -HALF), "it is 2.29 degrees off the nearest, (-0.707, 0, 0, 0.707)"),
        ((0, 0, 0, 2), "it is 0 degrees off the nearest, (0, 0, 0, 1), and its length is 2, not 1"),
        ((0, 0, 0, 0), "it must have the length 1"),
        ((np.nan, 0, 0, 1), "it must have the length 1"),
    ],
)
def test_rotation_index_says_how_far_off_it_is(quaternion, said):
    with pytest.raises(InputError) as error:
        rotation_index(np.array(quaternion, float))
    assert said in str(error.value)
