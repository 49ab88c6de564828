"""The robot: it looks, plans in its belief, and acts in reality; what goes wrong on the way it notices."""

import time
from dataclasses import dataclass

import numpy as np

from apf.panda.accounting import Account, Entry
from apf.panda.belief import Belief
from apf.panda.geometry import angle, distance, disturbed, inverse, moved
from apf.panda.kinematics import REST, forward, straight
from apf.panda.motion import find_motion
from apf.panda.planner import NoPlan, Planner, Step
from apf.panda.reality import Reality
from apf.panda.settings import Handling, Sight
from apf.panda.stations import APPROACH_STEPS, LIFT_STEPS
from apf.towers import BlockSet

NO_PLAN = ("no grasp", "no motion")
"""Outcomes that mean that the planner found no solution."""


class Lost(Exception):
    """The block is not in the hand as it should be. Its message says since when."""


@dataclass
class Robot:
    """One arm at one table. `begin` comes first."""

    reality: Reality
    belief: Belief
    planner: Planner
    sight: Sight
    handling: Handling

    def begin(self, blocks: BlockSet, poses: np.ndarray, rng: np.random.Generator) -> None:
        """A new scene: blocks at their poses [B, 4, 4], the arm at rest, nothing remembered.

        Args:
            blocks: The set.
            poses: [B, 4, 4] of the blocks.
            rng: The source of all draws.
        """
        self.rng, self.account = rng, Account()
        self.reality.build(blocks, poses)
        self.belief.build(blocks, poses)
        self.look()

    # -- seeing -------------------------------------------------------------------------------------------------

    def see(self, block: int) -> np.ndarray:
        """[4, 4] where a block seems to be: a camera's estimate, with its error."""
        turn = np.deg2rad(self.sight.rotation)
        return disturbed(self.reality.pose_of(block), self.sight.position, turn, self.rng)

    def look(self) -> np.ndarray:
        """Estimates [B, 4, 4] of all blocks, which the belief takes over."""
        self.belief.update(np.array([self.see(block) for block in range(len(self.belief.bodies))]))
        return self.belief.thought

    # -- acting -------------------------------------------------------------------------------------------------

    def bring(self, block: int, goal: np.ndarray, purpose: str) -> str:
        """One attempt to bring a block to a pose [4, 4]: look, plan, act. Returns the outcome, as the account has it.

        The gripper is empty and the arm away from the blocks afterwards.

        Args:
            block: Its number.
            goal: [4, 4] pose.
            purpose: Why, as the account has it.
        """
        began, processor, simulated = time.perf_counter(), time.process_time(), self.reality.seconds
        entry = Entry(purpose, self.planner.blocks.name[block])
        self.account.entries.append(entry)
        try:
            self.look()
            self._step_aside()
            steps = self.planner.plan(block, goal, self.reality.joints(), self.rng)
            entry.planning = time.perf_counter() - began
            entry.regrasps = sum(step.action == "regrasp" for step in steps)
            for step in steps:
                self._perform(step)
            placed = self.reality.pose_of(block)
            entry.error, entry.turn = distance(placed, goal), angle(placed, goal)
        except NoPlan as error:
            entry.outcome = str(error)
            entry.planning = time.perf_counter() - began
        except Lost as error:
            entry.outcome = str(error)
            self._let_go()
        entry.plans, entry.replans = self.planner.effort.plans, self.planner.effort.replans
        entry.simulated = self.reality.seconds - simulated
        entry.wall, entry.processor = time.perf_counter() - began, time.process_time() - processor
        return entry.outcome

    def rest(self) -> None:
        """Go to where the arm waits."""
        self.look()
        self._step_aside()
        self._go_to(REST)

    def _perform(self, step: Step) -> None:
        """Raises Lost."""
        station, careful = step.station, self.reality.arm.careful
        if step.path is not None:
            self.reality.follow(step.path[1:])
            if step.action == "move-holding":
                self._check_hold(step, "dropped")
        elif step.action == "pick":
            self.reality.follow(station.approach, careful)
            self.reality.grip(station.held.block)
            self._check_hold(step, "missed")
            self.reality.follow(station.lift, careful)
            self._check_hold(step, "dropped")
        else:
            self._put_down(step)

    def _check_hold(self, step: Step, what: str) -> None:
        """Are the fingers as far apart as the block is wide?"""
        grasp = self.planner.grasps(step.station.held.block)[step.station.grasp]
        if abs(self.reality.width() - grasp.width) > self.handling.width:
            raise Lost(what)

    def _put_down(self, step: Step) -> None:
        """Lower the block, as it is seen to lie in the hand, to its pose; let go, and draw back."""
        station, careful = step.station, self.reality.arm.careful
        assert step.pose is not None
        q = self.reality.joints()
        held = station.held.pose
        if self.handling.correct:
            held = inverse(forward(q)) @ self.see(station.held.block)
            if distance(held, station.held.pose) > self.handling.slip:
                raise Lost("slipped")
        target = moved(step.pose, (0, 0, self.handling.gap)) @ inverse(held)
        height = forward(q)[2, 3] - target[2, 3]
        down = straight([moved(target, (0, 0, height * i / LIFT_STEPS)) for i in range(LIFT_STEPS - 1, -1, -1)], q)
        self.reality.follow(station.lift[::-1] if down is None else down, careful)
        self.reality.wait(self.handling.pause)
        self.reality.release()
        q = self.reality.joints()
        hand = forward(q)
        reach = self.planner.reach.approach
        back = straight(
            [moved(hand, -hand[:3, 2] * reach * i / APPROACH_STEPS) for i in range(1, 1 + APPROACH_STEPS)], q
        )
        self.reality.follow(station.approach[::-1] if back is None else back, careful)

    # -- when something went wrong --------------------------------------------------------------------------------

    def _let_go(self) -> None:
        """Open the hand where it is, and draw it away."""
        self.reality.release()
        self._draw_away()
        self.reality.wait(self.handling.pause)
        self.look()

    def _draw_away(self) -> None:
        """Straight up, or else back along the fingers, as far as they reach."""
        q = self.reality.joints()
        hand = forward(q)
        for direction in (np.array([0.0, 0.0, 1.0]), -hand[:3, 2]):
            away = straight([moved(hand, direction * 0.02 * i) for i in range(1, 5)], q)
            if away is not None:
                self.reality.follow(away, self.reality.arm.careful)
                return

    def _step_aside(self) -> None:
        """If the arm is too near to anything to plan from where it is, as after a fall, draw it away."""
        motion = self.planner.motion
        if self.belief.touches(self.reality.joints(), None, motion.clearance):
            self._draw_away()
            touched = self.belief.touched(self.reality.joints(), motion.clearance)
            if touched:
                self._go_to(REST, touched)
            self.look()

    def _go_to(self, q: np.ndarray, ignore: list[int] | None = None) -> None:
        """Move the empty hand; blocks that cannot be avoided are pushed aside, slowly."""
        everything = list(range(len(self.belief.bodies)))
        for ignored in (ignore or [], everything):
            seed = int(self.rng.integers(1, 2**31))
            path = find_motion(self.belief, self.reality.joints(), q, None, self.planner.motion, seed, ignored)
            if path is not None:
                self.reality.follow(path[1:], self.reality.arm.careful if ignored else None)
                return
        self.reality.follow(q[None], self.reality.arm.careful)
