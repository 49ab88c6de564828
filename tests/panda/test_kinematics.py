"""The arm's kinematics against PyBullet's, and what it can reach."""

import numpy as np
import pytest

from apf.panda.belief import Belief
from apf.panda.geometry import about_z, angle, distance, disturbed, from_vector, inverse, moved, pose, to_vector
from apf.panda.kinematics import LOWER, REST, UPPER, forward, inverse_kinematics, straight, within_limits
from apf.panda.scene import TARGET
from apf.panda.stations import posture

DOWN = np.diag([1.0, -1.0, -1.0])


def random_joints(n: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(LOWER, UPPER, (n, 7))


def test_forward_is_what_the_simulated_arm_does(belief: Belief) -> None:
    for q in random_joints(20):
        belief.pose_arm(q)
        state = belief.client.getLinkState(belief.robot, TARGET, computeForwardKinematics=True)
        np.testing.assert_allclose(forward(q), from_vector((*state[4], *state[5])), atol=1e-6)


def test_inverse_undoes_forward() -> None:
    for q in random_joints(50):
        target = forward(q)
        for found in inverse_kinematics(target, q):
            assert within_limits(found)
            np.testing.assert_allclose(forward(found), target, atol=1e-9)


def test_nearest_first() -> None:
    target = pose((0.45, 0.1, 0.2), DOWN)
    far = np.abs(inverse_kinematics(target, REST) - REST)[:, :-1].max(1)
    assert (np.diff(far) >= 0).all()


def test_everywhere_on_the_table_the_hand_reaches_down() -> None:
    rng = np.random.default_rng(0)
    reached = 0
    for _ in range(300):
        a, r, z, yaw = rng.uniform((-2.6, 0.35, 0.02, -np.pi), (2.6, 0.65, 0.35, np.pi))
        target = pose((r * np.cos(a), r * np.sin(a), z), DOWN @ about_z(yaw))
        reached += len(inverse_kinematics(target, posture(target))) > 0
    assert reached >= 0.98 * 300


def test_out_of_reach_there_is_no_solution() -> None:
    assert len(inverse_kinematics(pose((1.2, 0, 0.3), DOWN), REST)) == 0


def test_a_straight_line_is_straight_and_without_jumps() -> None:
    start = pose((0.45, 0.1, 0.1), DOWN)
    q = inverse_kinematics(start, REST)[0]
    targets = [moved(start, (0, 0, 0.02 * i)) for i in range(1, 6)]
    path = straight(targets, q)
    assert path is not None
    for target, joints in zip(targets, path):
        np.testing.assert_allclose(forward(joints), target, atol=1e-9)
    assert np.abs(np.diff(np.vstack([q, path]), axis=0)).max() < 0.35


def test_a_line_out_of_reach_is_none() -> None:
    start = pose((0.6, 0.0, 0.1), DOWN)
    q = inverse_kinematics(start, REST)[0]
    assert straight([moved(start, (0.1 * i, 0, 0)) for i in range(1, 6)], q) is None


@pytest.mark.parametrize("w", [1.0, 0.3, 1e-4, 0.0])
def test_vectors_are_poses(w: float) -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        xyz = rng.normal(size=3) * (rng.random(3) > 0.3)
        quaternion = np.array([*xyz, w])
        if not quaternion.any():
            continue
        quaternion /= np.linalg.norm(quaternion)
        vector = to_vector(from_vector((1, 2, 3, *quaternion)))
        assert min(np.abs(vector[3:] - quaternion).max(), np.abs(vector[3:] + quaternion).max()) < 1e-6
        assert vector[:3].tolist() == [1, 2, 3]


def test_poses_compose() -> None:
    a, b = pose((1, 2, 3), about_z(0.3)), pose((0.1, 0, 0), about_z(0.2))
    np.testing.assert_allclose(inverse(a) @ (a @ b), b, atol=1e-12)
    assert angle(a, a @ b) == pytest.approx(0.2)
    assert distance(a, a @ b) == pytest.approx(0.1)


def test_errors_of_estimates_have_their_size() -> None:
    rng = np.random.default_rng(0)
    drawn = [disturbed(np.eye(4), 0.002, 0.01, rng) for _ in range(2000)]
    assert np.std([d[:3, 3] for d in drawn], axis=0) == pytest.approx(np.full(3, 0.002), rel=0.1)
    turns = np.array([angle(d, np.eye(4)) for d in drawn])
    assert np.sqrt((turns**2).mean() / 3) == pytest.approx(0.01, rel=0.1)
    np.testing.assert_array_equal(disturbed(np.eye(4), 0.0, 0.0, rng), np.eye(4))
