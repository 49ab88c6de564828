"""The robot: it looks, plans in its belief, and acts through its hardware; what goes wrong on the way it notices.

All that it knows of reality comes through `Hardware`: images, joints, the width between the fingers, and the time.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from apf.panda.accounting import Account, Entry
from apf.panda.belief import Belief
from apf.panda.geometry import angle, distance, inverse, moved, pose
from apf.panda.hardware import Hardware, Refused, Witness
from apf.panda.kinematics import REST, forward, straight
from apf.panda.motion import find_motion
from apf.panda.planner import NoPlan, Planner, Step
from apf.panda.settings import Arm, Handling, Sight
from apf.panda.stations import APPROACH_STEPS, LIFT_STEPS, Station
from apf.panda.vision.cameras import STATIC, WRIST, Camera
from apf.panda.vision.eyes import Eyes
from apf.panda.vision.watch import Watch
from apf.towers import BlockSet

NO_PLAN = ("no grasp", "no motion")
"""Outcomes that mean that the planner found no solution."""
IN_VAIN = "in vain"
"""Outcome of a block that was not put down, since what it belongs on had fallen."""
NOT_THERE = "not seen"
"""Outcome of a block that no camera sees where it is believed to be."""
GONE = pose((0.0, 0.0, -1.0))
"""[4, 4] where a block is believed to be of which nothing else is known: under the table."""
SHIFTED = 0.001
"""A block that is seen so much off [m] is approached by a straight line of its own."""


class Lost(Exception):
    """The block is not in the hand, or not where it should be. Its message says since when."""


@dataclass
class Robot:
    """One arm at one table. `begin` comes first.

    witness: Tells the true pose of a block, for the account alone; None: nobody knows it.
    """

    hardware: Hardware
    belief: Belief
    planner: Planner
    cameras: Mapping[str, Camera]
    sight: Sight
    handling: Handling
    arm: Arm
    witness: Witness | None = None
    say: Callable[[str], None] = print
    """Is called with one line when something is wrong with what the robot sees."""

    def __post_init__(self) -> None:
        """Nobody has looked yet."""
        self.watch = Watch(self.sight, self.say)

    def begin(self, blocks: BlockSet, rng: np.random.Generator, believed: np.ndarray | None = None) -> None:
        """A new scene: the arm at rest, nothing remembered but where blocks were last believed to be.

        Args:
            blocks: The set.
            rng: The source of all draws.
            believed: [B, 4, 4] where blocks are thought to be; None: at home.
        """
        self.rng, self.account = rng, Account()
        self.eyes = Eyes(self.cameras, blocks)
        homes = self.belief.layout.home_poses(blocks.dims)
        self.belief.build(blocks, homes if believed is None else believed)
        self.look()

    # -- seeing -------------------------------------------------------------------------------------------------

    def look(self, names: Sequence[str] = STATIC) -> np.ndarray:
        """Look with some cameras, and believe what they see.

        A block whose markers are seen where they should be has not moved: what was known of it, maybe from the camera
        on the hand, is better than what is seen from afar. A block that nobody sees is where it was, unless another
        block is seen there: then it is gone.

        Returns:
            [B] bool: is each block seen?
        """
        seen = self.watch.look(self.hardware, self.eyes, names, self._places(), self.belief.thought)
        poses = self.belief.thought.copy()
        new = seen.seen & ~(seen.surprise <= self.sight.still)
        poses[new] = seen.poses[new]
        if new.any():
            self.belief.update(poses)
            self._displace(seen.seen)
        return seen.seen

    def _displace(self, seen: np.ndarray) -> None:
        """Believe that a block which is not seen is gone if one that is seen [B] bool lies in its place."""
        poses = self.belief.thought.copy()
        for block in np.flatnonzero(~seen):
            others = self.belief.in_the_way(int(block), poses[block], -self.sight.overlap)
            if any(seen[other] for other in others):
                poses[block] = GONE
        self.belief.update(poses)

    def look_closely(self, block: int) -> np.ndarray | None:
        """[4, 4] where the camera on the hand sees a block; None: it does not see it."""
        seen = self.watch.look(self.hardware, self.eyes, [WRIST], self._places(), self.belief.thought, only=block)
        return seen.poses[block] if seen.seen[block] else None

    def examine(self, block: int) -> bool:
        """Look at a block with the camera on the hand, or else with the others, and believe it. Is it seen?"""
        where = self.look_closely(block)
        if where is None:
            return bool(self.look()[block])
        self._believe(block, where)
        return True

    def visit(self, block: int) -> bool:
        """Bring the empty hand before a block, as if to grasp it, and look. Is the block there?"""
        try:
            where = self.belief.thought[block]
            first = self.planner.plan(block, where, self.hardware.joints(), self.rng)[0]
        except NoPlan:
            return False
        assert first.path is not None
        self.hardware.follow(first.path[1:], self.arm.speed)
        return self.examine(block)

    def _places(self) -> dict[str, np.ndarray]:
        """[4, 4] of each camera's optical frame, as far as the robot knows."""
        hand = forward(self.hardware.joints())
        return {
            name: hand @ camera.mounting if name == WRIST else camera.mounting for name, camera in self.cameras.items()
        }

    def _believe(self, block: int, where: np.ndarray) -> None:
        poses = self.belief.thought.copy()
        poses[block] = where
        self.belief.update(poses)

    # -- acting -------------------------------------------------------------------------------------------------

    def bring(self, block: int, goal: np.ndarray, purpose: str, may_go_on: Callable[[], bool] = lambda: True) -> str:
        """One attempt to bring a block to a pose [4, 4]: plan, act. Returns the outcome, as the account has it.

        The gripper is empty afterwards, and the arm before the block or away from it. A block that was put down is
        believed to be where it should be until it is examined.

        Args:
            block: Its number.
            goal: [4, 4] pose.
            purpose: Why, as the account has it.
            may_go_on: Is asked before the block is lowered.
        """
        began, processor, simulated = time.perf_counter(), time.process_time(), self.hardware.seconds()
        entry = Entry(purpose, self.planner.blocks.name[block])
        self.account.entries.append(entry)
        try:
            self._step_aside()
            steps = self.planner.plan(block, goal, self.hardware.joints(), self.rng)
            entry.planning = time.perf_counter() - began
            entry.regrasps = sum(step.action == "regrasp" for step in steps)
            for step in steps:
                self._perform(step, may_go_on)
            if self.witness is not None:
                placed = self.witness(block)
                entry.error, entry.turn = distance(placed, goal), angle(placed, goal)
        except NoPlan as error:
            entry.outcome = str(error)
            entry.planning = time.perf_counter() - began
        except Lost as error:
            entry.outcome = str(error)
            self._let_go()
        except Refused as error:
            entry.outcome = f"refused: {error}"
            self._let_go()
        entry.plans, entry.replans = self.planner.effort.plans, self.planner.effort.replans
        entry.simulated = self.hardware.seconds() - simulated
        entry.wall, entry.processor = time.perf_counter() - began, time.process_time() - processor
        return entry.outcome

    def rest(self) -> None:
        """Go to where the arm waits."""
        self._step_aside()
        self._go_to(REST)

    def _perform(self, step: Step, may_go_on: Callable[[], bool]) -> None:
        """Raises Lost."""
        if step.path is not None:
            self.hardware.follow(step.path[1:], self.arm.speed)
            if step.action == "move-holding":
                self._check_hold(step.station, "dropped")
        elif step.action == "pick":
            self._pick(step.station)
        else:
            if not may_go_on():
                raise Lost(IN_VAIN)
            self._put_down(step)

    def _pick(self, station: Station) -> None:
        """Look at the block, come to it as it is seen, grip, lift."""
        block, careful = station.held.block, self.arm.careful
        expected = forward(station.q) @ station.held.pose
        where = self.look_closely(block)
        if where is None and not self.look()[block]:
            raise Lost(NOT_THERE)
        if where is not None:
            off = distance(where, expected)
            if off > self.sight.refine or angle(where, expected) > np.deg2rad(self.sight.refine_turn):
                self._believe(block, where)
                raise Lost("elsewhere")
            self._believe(block, where)
        self.hardware.follow(self._approach(station, where if where is not None else expected), careful)
        self.hardware.grip()
        self._check_hold(station, "missed")
        self.hardware.follow(self._lift(station), careful)
        self._check_hold(station, "dropped")

    def _approach(self, station: Station, where: np.ndarray) -> np.ndarray:
        """[M, 7] straight to a block at a pose [4, 4]; as it was planned, if that is where it was thought to be."""
        target = where @ inverse(station.held.pose)
        if distance(target, forward(station.q)) < SHIFTED:
            return station.approach
        reach = self.planner.reach.approach
        points = [moved(target, -target[:3, 2] * reach * i / APPROACH_STEPS) for i in range(APPROACH_STEPS, -1, -1)]
        path = straight(points, self.hardware.joints())
        block, near = station.held.block, self.planner.motion.near
        if path is None or self.belief.touches(path[-1], None, near, ignore={block}):
            return station.approach
        return path

    def _lift(self, station: Station) -> np.ndarray:
        """[M, 7] straight up from where the hand is, and on to where the planned lift ends."""
        q = self.hardware.joints()
        hand, height = forward(q), self.planner.reach.lift
        up = straight([moved(hand, (0, 0, height * i / LIFT_STEPS)) for i in range(1, LIFT_STEPS + 1)], q)
        return station.lift if up is None else np.vstack([up, station.above])

    def _check_hold(self, station: Station, what: str) -> None:
        """Are the fingers as far apart as the block is wide?"""
        grasp = self.planner.grasps(station.held.block)[station.grasp]
        if abs(self.hardware.width() - grasp.width) > self.handling.width:
            raise Lost(what)

    def _put_down(self, step: Step) -> None:
        """Lower the block, as it is seen to lie in the hand, to its pose; let go, and draw back."""
        station, careful = step.station, self.arm.careful
        assert step.pose is not None
        q = self.hardware.joints()
        held = station.held.pose
        seen = self.look_closely(station.held.block) if self.handling.correct else None
        if seen is not None:
            held = inverse(forward(q)) @ seen
            if distance(held, station.held.pose) > self.handling.slip:
                raise Lost("slipped")
        target = moved(step.pose, (0, 0, self.handling.gap)) @ inverse(held)
        height = forward(q)[2, 3] - target[2, 3]
        down = straight([moved(target, (0, 0, height * i / LIFT_STEPS)) for i in range(LIFT_STEPS - 1, -1, -1)], q)
        self.hardware.follow(station.lift[::-1] if down is None else down, careful)
        self.hardware.wait(self.handling.pause)
        self.hardware.release()
        self._believe(station.held.block, step.pose)
        q = self.hardware.joints()
        hand = forward(q)
        reach = self.planner.reach.approach
        back = straight(
            [moved(hand, -hand[:3, 2] * reach * i / APPROACH_STEPS) for i in range(1, 1 + APPROACH_STEPS)], q
        )
        self.hardware.follow(station.approach[::-1] if back is None else back, careful)

    # -- when something went wrong --------------------------------------------------------------------------------

    def _let_go(self) -> None:
        """Open the hand where it is, and draw it away."""
        self.hardware.release()
        self._draw_away()
        self.hardware.wait(self.handling.pause)
        self.look()

    def _draw_away(self) -> None:
        """Straight up, or else back along the fingers, as far as they reach."""
        q = self.hardware.joints()
        hand = forward(q)
        for direction in (np.array([0.0, 0.0, 1.0]), -hand[:3, 2]):
            away = straight([moved(hand, direction * 0.02 * i) for i in range(1, 5)], q)
            if away is not None:
                self.hardware.follow(away, self.arm.careful)
                return

    def _step_aside(self) -> None:
        """If the arm is too near to anything to plan from where it is, as after a fall, draw it away."""
        motion = self.planner.motion
        if self.belief.touches(self.hardware.joints(), None, motion.clearance):
            self._draw_away()
            touched = self.belief.touched(self.hardware.joints(), motion.clearance)
            if touched:
                self._go_to(REST, touched)
            self.look()

    def _go_to(self, q: np.ndarray, ignore: list[int] | None = None) -> None:
        """Move the empty hand; blocks that cannot be avoided are pushed aside, slowly."""
        everything = list(range(len(self.belief.bodies)))
        for ignored in (ignore or [], everything):
            seed = int(self.rng.integers(1, 2**31))
            path = find_motion(self.belief, self.hardware.joints(), q, None, self.planner.motion, seed, ignored)
            if path is not None:
                self.hardware.follow(path[1:], self.arm.careful if ignored else self.arm.speed)
                return
        self.hardware.follow(q[None], self.arm.careful)
