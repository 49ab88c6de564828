"""Task and motion planning for one abstract action: bring a block to a pose (Section Perception, planning, execution).

Samplers propose stations (grasp, inverse kinematics, straight approach and lift) until the task planner finds a plan
with them; then each of its moves is looked for. If one is not found, the station that it should have led to is given
up, and the samplers go on.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from apf.panda.belief import Belief
from apf.panda.geometry import about_z, pose
from apf.panda.grasps import Grasp, Gripper, grasps_of
from apf.panda.motion import MotionSettings, find_motion
from apf.panda.stations import Reach, Station, find_station, tilts
from apf.panda.tasks import ABOVE, Action, Fact, solve
from apf.settings import Count, settings
from apf.towers import ROTATIONS, BlockSet

NOW, GOAL = "now", "goal"
YAWS = (0.0, np.pi / 4)
"""How a block may lie on the pedestal, besides its 24 axis-aligned rotations."""
ROOMY = 0.065
"""Sides [m] up to this are as good as any between the fingers; longer ones leave little room to let go."""
PEDESTAL_MARGIN = 0.01
"""A block's centre of mass stays this far [m] from the pedestal's edge."""


@settings
class Search:
    """Limits of the search for a plan."""

    stations: Count = 150
    """Stations that samplers may try for one plan."""
    pairs: Count = 40
    """Grasps that are tried for a plan without regrasping."""
    chains: Count = 12
    """Task plans whose motions are looked for."""


class NoPlan(Exception):
    """No plan was found. Its message says what was lacking: grasp, or motion."""


@dataclass(frozen=True, eq=False)
class Step:
    """One step of the robot: a move along `path` [M, 7], or a pick, place or regrasp at a station."""

    action: str
    station: Station
    path: np.ndarray | None = None
    pose: np.ndarray | None = None
    """[4, 4] pose at which the block lies, or is put."""


@dataclass
class Effort:
    """Counts of planning: task plans, task plans without a motion, stations tried, motions searched for."""

    plans: int = 0
    replans: int = 0
    stations: int = 0
    motions: int = 0


@dataclass
class _Query:
    """One question to the planner, and what was found out about it so far."""

    block: int
    poses: dict[str, np.ndarray]
    stations: dict[Fact, Station | None] = field(default_factory=dict)
    banned: set[Fact] = field(default_factory=set)


class Planner:
    """Plans with a block set in a belief.

    Args:
        belief: Where everything is thought to be. The block set is the one that the belief holds.
        gripper: What the fingers can hold.
        reach: Of the arm.
        motion: How motions are planned.
        search: How long the planner searches.
        overlap: Blocks may seem to overlap by so much [m], since estimates of poses are not exact.
    """

    def __init__(
        self,
        belief: Belief,
        gripper: Gripper,
        reach: Reach,
        motion: MotionSettings,
        search: Search,
        overlap: float = 0.004,
    ) -> None:
        self.belief, self.gripper, self.reach, self.motion, self.search = belief, gripper, reach, motion, search
        self.overlap = overlap
        self.effort = Effort()

    @property
    def blocks(self) -> BlockSet:
        """The set that the belief holds."""
        assert self.belief.blocks is not None
        return self.belief.blocks

    def grasps(self, block: int) -> list[Grasp]:
        """All grasps of a block."""
        key = self.blocks.dims[block].tobytes()
        if key not in self._grasps:
            self._grasps[key] = grasps_of(self.blocks.dims[block], self.gripper)
        return self._grasps[key]

    @cached_property
    def _grasps(self) -> dict[bytes, list[Grasp]]:
        return {}

    def plan(self, block: int, goal: np.ndarray, q: np.ndarray, rng: np.random.Generator) -> list[Step]:
        """The steps that bring a block from where it is thought to be to a pose [4, 4], starting from joints q [7].

        Args:
            block: Its number.
            goal: [4, 4] pose.
            q: [7] joints from which the arm starts [rad].
            rng: The source of all draws.

        Raises:
            NoPlan: No grasp, or no motion, was found.
        """
        query = _Query(block, {NOW: self.belief.thought[block], GOAL: goal})
        self.effort = Effort()
        for chain in self._chains(query, rng):
            pedestal = [fact.pose for fact in chain if fact.pose not in (NOW, GOAL)]
            actions = solve(block, NOW, GOAL, pedestal, chain)
            assert actions is not None, "the samplers' stations make a plan"
            self.effort.plans += 1
            steps = self._steps(query, actions, q, rng)
            if steps is not None:
                return steps
            self.effort.replans += 1
            if self.effort.replans == self.search.chains:
                break
        raise NoPlan("no motion" if self.effort.plans else "no grasp")

    # -- stations -----------------------------------------------------------------------------------------------

    def _chains(self, query: _Query, rng: np.random.Generator) -> Iterator[list[Fact]]:
        """Sets of stations that suffice for a plan: with one grasp if that can be, else two, the pedestal between."""
        grasps = self.grasps(query.block)
        if not grasps:
            return
        jitter = rng.random(len(grasps))
        now, goal = (self._cost(query.poses[name], grasps) for name in (NOW, GOAL))
        for g in _cheapest(now + goal, jitter)[: self.search.pairs]:
            chain = [Fact(query.block, NOW, g), Fact(query.block, GOAL, g)]
            if self._exist(query, chain):
                yield chain
        resting = list(self._resting(query.block))
        costs = [self._cost(where, grasps) for where in resting]
        order = np.argsort([(now + c).min() + (c + goal).min() for c in costs], kind="stable")
        for number in order:
            name = f"pedestal{number}"
            query.poses[name] = resting[number]
            first = self._first(query, (NOW, name), _cheapest(now + costs[number], jitter))
            if first is None:
                continue
            second = self._first(query, (name, GOAL), _cheapest(costs[number] + goal, jitter))
            if second is not None:
                yield first + second

    def _first(self, query: _Query, names: tuple[str, str], order: np.ndarray) -> list[Fact] | None:
        for g in order[:8]:
            chain = [Fact(query.block, name, int(g)) for name in names]
            if self._exist(query, chain):
                return chain
        return None

    def _cost(self, where: np.ndarray, grasps: list[Grasp]) -> np.ndarray:
        """[G] cost of each grasp: 0 if the hand points straight down at the block's middle, and its fingers have room.

        Infinite where the hand tilts too far.
        """
        tilt = tilts(where, grasps)
        others = np.array([10 * abs(grasp.offset) + 20 * max(0.0, grasp.width - ROOMY) for grasp in grasps])
        return np.where(tilt <= np.deg2rad(self.reach.tilt) + 1e-9, tilt**2 + others, np.inf)

    def _resting(self, block: int) -> Iterator[np.ndarray]:
        """Poses [4, 4] of a block on the pedestal, in which it does not fall off."""
        layout = self.belief.layout
        x, y = layout.pedestal
        width, depth, height = layout.pedestal_size
        for rotation, sides, com in zip(ROTATIONS, self.blocks.rotated_dims[block], self.blocks.rotated_com[block]):
            for yaw in YAWS:
                inside = np.abs(about_z(yaw)[:2, :2] @ com[:2]) < np.array([width, depth]) / 2 - PEDESTAL_MARGIN
                if inside.all():
                    yield pose((x, y, height + sides[2] / 2), about_z(yaw) @ rotation)

    def _exist(self, query: _Query, chain: list[Fact]) -> bool:
        return all(self._station(query, fact) is not None for fact in chain)

    def _station(self, query: _Query, fact: Fact) -> Station | None:
        """Looked for once. None: there is none, it was given up, or the search has used its stations."""
        if fact in query.banned:
            return None
        if fact not in query.stations:
            if self.effort.stations >= self.search.stations:
                return None
            self.effort.stations += 1
            grasp = self.grasps(fact.block)[fact.grasp]
            query.stations[fact] = find_station(
                self.belief,
                fact.block,
                query.poses[fact.pose],
                fact.grasp,
                grasp,
                self.reach,
                self.motion,
                self.overlap,
            )
        return query.stations[fact]

    # -- motions ------------------------------------------------------------------------------------------------

    def _steps(
        self, query: _Query, actions: list[Action], q: np.ndarray, rng: np.random.Generator
    ) -> list[Step] | None:
        """The actions with their motions; None, the station banned that no motion led to, if one was not found.

        The belief follows what is planned, and is put back in the end.
        """
        before = self.belief.thought.copy()
        steps: list[Step] = []
        try:
            for action in actions:
                station = query.stations[action.station]
                assert station is not None
                if action.name.startswith("move"):
                    goal = station.above if action.where == ABOVE else station.before
                    held = station.held if action.name == "move-holding" else None
                    self.effort.motions += 1
                    path = find_motion(self.belief, q, goal, held, self.motion, int(rng.integers(1, 2**31)))
                    if path is None:
                        query.banned.add(action.station)
                        return None
                    steps.append(Step(action.name, station, path))
                    q = goal
                else:
                    where = query.poses[action.station.pose]
                    steps.append(Step(action.name, station, pose=where))
                    q = station.above if action.name == "pick" else station.before
                    if action.name != "pick":
                        poses = self.belief.thought.copy()
                        poses[query.block] = where
                        self.belief.update(poses)
        finally:
            self.belief.update(before)
        return steps


def _cheapest(cost: np.ndarray, jitter: np.ndarray) -> np.ndarray:
    """Indices of finite costs, lowest first; about equal ones in random order."""
    order = np.lexsort([jitter, np.round(cost, 2)])
    return order[np.isfinite(cost[order])]
