"""Motions that touch nothing: RRT-Connect in joint space (Section Perception, planning, and execution)."""

from collections.abc import Callable, Collection
from itertools import pairwise
from typing import Annotated

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou
from pydantic import Field

from apf.panda.belief import Belief, Held
from apf.panda.kinematics import JOINTS, LOWER, REST, UPPER
from apf.settings import Count, Number, settings

ou.setLogLevel(ou.LogLevel.LOG_NONE)  # RRT-Connect tells of each start and goal, and of seeds that are set anew


END = 0.05
"""Distance [rad]. Nearer than this to its start or goal, a motion keeps the clearance `near`, not `clearance`."""


@settings
class MotionSettings:
    """How motions are planned."""

    clearance: Annotated[Number, Field(ge=0, le=1)] = 0.008
    """Distance to all obstacles in a motion from place to place [m]."""
    near: Annotated[Number, Field(ge=0, le=1)] = 0.001
    """Distance to all obstacles but the block itself in approach, lift, lower and retreat [m]."""
    step: Annotated[Number, Field(ge=0.001, le=1)] = 0.025
    """Distance between the points at which collisions are checked [rad], in the joint that moves most. At the arm's
    full length this is about two clearances, so the arm passes through nothing between two points."""
    reach: Annotated[Number, Field(ge=0.01, le=10)] = 0.6
    """Longest branch of the tree [rad]."""
    iterations: Count = 1500
    """Iterations after which the planner gives up."""
    shortcuts: Count = 40
    """Attempts to shorten a motion that was found."""


def find_motion(
    belief: Belief,
    start: np.ndarray,
    goal: np.ndarray,
    held: Held | None,
    how: MotionSettings,
    seed: int,
    ignore: Collection[int] = (),
) -> np.ndarray | None:
    """Find a motion that touches nothing.

    The function tries three kinds of motion in this order: a straight line; two straight lines, with the arm raised
    between them; a path of RRT-Connect, shortened. The same arguments give the same motion.

    Args:
        belief: Where everything is thought to be.
        start: [7] joints [rad].
        goal: [7] joints [rad].
        held: What the hand holds, if anything.
        how: The settings.
        seed: Seed of RRT-Connect.
        ignore: Blocks that the motion may touch.

    Returns:
        [M, 7] joints [rad] along the motion, start and goal included; None: no motion was found.
    """

    def free(q: np.ndarray) -> bool:
        at_an_end = min(np.abs(q - start).max(), np.abs(q - goal).max()) < END
        return not belief.touches(q, held, how.near if at_an_end else how.clearance, ignore=ignore)

    if not free(start) or not free(goal):
        return None
    for via in ([], [_above(start, goal)]):
        path = np.array([start, *via, goal])
        if all(free(q) for q in via) and all(free(q) for a, b in pairwise(path) for q in between(a, b, how.step)):
            return path
    return _rrt_connect(start, goal, free, how, seed)


def between(start: np.ndarray, goal: np.ndarray, step: float) -> np.ndarray:
    """[M, 7] points on the line between two configurations, without the ends. The point in the middle comes first.

    Args:
        start: [7] joints [rad].
        goal: [7] joints [rad].
        step: Largest distance between neighbours [rad].
    """
    n = int(np.ceil(np.abs(goal - start).max() / step))
    order = sorted(range(1, n), key=lambda i: (-(i & -i), i))
    return start + np.array(order)[:, None] / max(n, 1) * (goal - start) if order else np.empty((0, JOINTS))


def _above(start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """[7] joints half way, moved towards the posture of rest. In that posture the hand is high above the table."""
    middle = (start + goal) / 2
    middle[1:6] = 0.7 * REST[1:6] + 0.3 * middle[1:6]
    return middle


def _rrt_connect(
    start: np.ndarray, goal: np.ndarray, free: Callable[[np.ndarray], bool], how: MotionSettings, seed: int
) -> np.ndarray | None:
    ou.RNG.setSeed(seed)  # of what is made from here on
    space = ob.RealVectorStateSpace(JOINTS)
    bounds = ob.RealVectorBounds(JOINTS)
    for joint in range(JOINTS):
        bounds.setLow(joint, float(LOWER[joint]))
        bounds.setHigh(joint, float(UPPER[joint]))
    space.setBounds(bounds)
    information = ob.SpaceInformation(space)
    information.setStateValidityChecker(lambda state: free(_joints(state)))
    information.setStateValidityCheckingResolution(how.step / space.getMaximumExtent())
    information.setup()
    problem = ob.ProblemDefinition(information)
    ends = [space.allocState(), space.allocState()]
    for state, q in zip(ends, (start, goal)):
        for joint in range(JOINTS):
            state[joint] = float(q[joint])
    problem.setStartAndGoalStates(*ends)
    planner = og.RRTConnect(information)
    planner.setRange(how.reach)
    planner.setProblemDefinition(problem)
    planner.setup()
    rounds = iter(range(how.iterations))
    if not planner.solve(ob.PlannerTerminationCondition(lambda: next(rounds, None) is None)):
        return None
    if problem.hasApproximateSolution():
        return None
    path = problem.getSolutionPath()
    simplifier = og.PathSimplifier(information)
    simplifier.reduceVertices(path, how.shortcuts, how.shortcuts)
    simplifier.partialShortcutPath(path, how.shortcuts, how.shortcuts)
    simplifier.reduceVertices(path, how.shortcuts, how.shortcuts)
    return np.array([_joints(path.getState(i)) for i in range(path.getStateCount())])


def _joints(state: ob.State) -> np.ndarray:
    return np.array([state[joint] for joint in range(JOINTS)])
