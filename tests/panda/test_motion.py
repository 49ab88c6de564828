"""Planned motions never pass through anything."""

from itertools import pairwise

import numpy as np
import pytest

from apf.panda.belief import Belief, Held
from apf.panda.geometry import about_z, inverse, pose
from apf.panda.grasps import Gripper, grasps_of
from apf.panda.kinematics import REST, forward, inverse_kinematics
from apf.panda.motion import MotionSettings, between, find_motion
from apf.panda.planner import NoPlan, Planner, Search
from apf.panda.reality.profile import trapezoid
from apf.panda.stations import Reach, posture
from apf.towers import ROTATIONS, BlockSet

DOWN = np.diag([1.0, -1.0, -1.0])
HOW = MotionSettings()


def over(x: float, y: float, z: float, yaw: float = 0.0) -> np.ndarray:
    target = pose((x, y, z), DOWN @ about_z(yaw))
    return inverse_kinematics(target, posture(target))[0]


@pytest.fixture
def walled(belief: Belief, graspable: BlockSet) -> Belief:
    """Blocks stand in the arm's way, on top of each other, between the left and the right of the table."""
    heights = graspable.dims[:, 2]
    z = np.cumsum(heights) - heights / 2
    poses = np.array([pose((0.45, 0.0, z[i])) for i in range(len(heights))])
    belief.update(poses)
    return belief


def touched_on(belief: Belief, path: np.ndarray, held: Held | None) -> int:
    """How many points of a path, looked at closely, touch anything at all."""
    points = np.vstack([path, *(between(a, b, 0.004) for a, b in pairwise(path))])
    return sum(belief.touches(q, held) for q in points)


def test_no_motion_passes_through_the_wall(walled: Belief) -> None:
    rng = np.random.default_rng(0)
    found = 0
    for seed in range(1, 13):
        start, goal = (over(0.45, side * 0.25, rng.uniform(0.06, 0.2), rng.uniform(-1, 1)) for side in (1, -1))
        if walled.touches(start, None, HOW.near) or walled.touches(goal, None, HOW.near):
            continue
        straight_line = np.array([start, goal])
        assert touched_on(walled, straight_line, None), "the wall is in the way"
        path = find_motion(walled, start, goal, None, HOW, seed)
        if path is not None:
            found += 1
            np.testing.assert_array_equal(path[[0, -1]], straight_line)
            assert touched_on(walled, path, None) == 0
    assert found >= 8


def test_nor_does_what_the_hand_holds(walled: Belief, graspable: BlockSet) -> None:
    grasp = next(g for g in grasps_of(graspable.dims[3], Gripper()) if g.pose[2, 2] == -1)
    held = Held(3, inverse(grasp.pose))
    walled.put(3, pose((0.45, 0, 2)))
    for seed in range(1, 5):
        start, goal = over(0.42, 0.25, 0.15), over(0.42, -0.26, 0.2)
        path = find_motion(walled, start, goal, held, HOW, seed)
        assert path is not None
        assert touched_on(walled, path, held) == 0


def test_the_same_seed_finds_the_same_motion(walled: Belief) -> None:
    start, goal = over(0.45, 0.25, 0.1), over(0.45, -0.25, 0.2)
    paths = [find_motion(walled, start, goal, None, HOW, seed) for seed in (5, 9, 5)]
    assert all(path is not None for path in paths)
    np.testing.assert_array_equal(paths[0], paths[2])


def test_into_a_block_there_is_no_motion(walled: Belief) -> None:
    assert find_motion(walled, REST, over(0.45, 0.0, 0.1), None, HOW, 1) is None


def test_below_the_table_there_is_no_motion(belief: Belief) -> None:
    target = pose((0.45, 0.1, -0.05), DOWN)
    q = inverse_kinematics(target, posture(target))[0]
    assert find_motion(belief, REST, q, None, HOW, 1) is None


def test_steps_are_as_short_as_asked() -> None:
    start, goal = np.zeros(7), np.array([0.3, 0, 0, 0, 0, 0, -0.1])
    points = np.vstack([start, between(start, goal, 0.025), goal])
    points = points[np.argsort(points[:, 0])]
    assert np.abs(np.diff(points, axis=0)).max() <= 0.025 + 1e-12


def test_a_speed_profile_begins_and_ends_at_rest() -> None:
    for length in (0.01, 0.2, 3.0):
        times, places = trapezoid(length, 1.5, 6.0, 240)
        speeds = np.diff(places) / np.diff(times)
        assert places[0] == 0
        assert places[-1] == pytest.approx(length)
        assert (speeds >= -1e-12).all()
        assert speeds.max() <= 1.5 + 1e-9
        assert np.abs(np.diff(speeds)).max() * 240 <= 6.0 * 1.01


def test_a_plan_for_every_rotation(belief: Belief, graspable: BlockSet) -> None:
    planner = Planner(belief, Gripper(), Reach(), HOW, Search())
    regrasps = 0
    for rotation in range(24):
        block = rotation % len(graspable)
        height = graspable.rotated_dims[block, rotation, 2]
        goal = pose((0.45, 0, height / 2), ROTATIONS[rotation])
        steps = planner.plan(block, goal, REST, np.random.default_rng(rotation))
        names = [step.action for step in steps]
        assert names[0] == "move-free"
        assert names[-1] == "place"
        regrasps += "regrasp" in names
        for before, step in pairwise(steps):
            assert (step.path is None) == (before.path is not None), "moves and actions in turn"
        last = steps[-1].station
        np.testing.assert_allclose(forward(last.q) @ last.held.pose, goal, atol=1e-6)
    assert regrasps, "some rotations need the pedestal"


def test_planning_leaves_the_belief_as_it_was(belief: Belief, graspable: BlockSet) -> None:
    before = belief.thought.copy()
    planner = Planner(belief, Gripper(), Reach(), HOW, Search())
    goal = pose((0.45, 0, graspable.dims[0, 2] / 2))
    planner.plan(0, goal, REST, np.random.default_rng(0))
    np.testing.assert_array_equal(belief.thought, before)
    np.testing.assert_allclose(belief.poses(), before, atol=1e-9)


def test_out_of_reach_there_is_no_plan(belief: Belief) -> None:
    planner = Planner(belief, Gripper(), Reach(), HOW, Search())
    with pytest.raises(NoPlan, match="no grasp"):
        planner.plan(0, pose((0.94, 0.9, 0.03)), REST, np.random.default_rng(0))
