"""One experiment of the robot: build a tower, judge each prefix, clear up (Section Perception, planning, execution)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from apf.domain import UNOBSERVED
from apf.panda.accounting import BUILD, DONE, INTERVENTION, TIDY, Entry
from apf.panda.geometry import angle, distance, pose
from apf.panda.robot import NO_PLAN, Robot
from apf.panda.settings import Judging, Recovery
from apf.towers import ROTATIONS, Towers

STOOD, FELL, UNPLANNED, GIVEN_UP = "stood", "fell", "no plan", "given up"
"""How a plan ended: all prefixes stood; a prefix fell; the planner found no plan; execution failed too often."""
SPARE = [(x, y) for y in (0.0, 0.14, -0.12, 0.26) for x in (0.45, 0.58, 0.34)]
"""Spare places [m]: a block may wait here while another block lies in its home."""
ROOM = 0.004
"""Distance [m]. A home is free if its block, put there, would be at least this far from all other blocks."""


@dataclass
class Builder:
    """Builds with a robot; `ask_for_help(block, cause)` is called before a block is put home by hand."""

    robot: Robot
    judging: Judging
    recovery: Recovery
    ask_for_help: Callable[[str, str], None]
    on_judged: Callable[[], None] | None = None
    """The builder calls this function after it has judged a placement, e.g. to take a picture."""

    @property
    def names(self) -> tuple[str, ...]:
        """[B] names of the blocks."""
        return self.robot.planner.blocks.name

    @property
    def homes(self) -> np.ndarray:
        """[B, 4, 4] pose of each block in its home."""
        return self.robot.reality.layout.home_poses(self.robot.planner.blocks.dims)

    # -- building -----------------------------------------------------------------------------------------------

    def build(self, tower: Towers) -> tuple[np.ndarray, str]:
        """Build one tower (N = 1) and judge each prefix. The tower, or its ruins, stay on the table.

        Returns:
            Labels [K] int8 of the prefixes, and how the plan ended (STOOD, FELL, UNPLANNED or GIVEN_UP).
        """
        labels = np.full(tower.length, UNOBSERVED, np.int8)
        goals = goal_poses(tower, self.robot.reality.layout.base)
        for i, goal in enumerate(goals):
            outcome = self._place(tower.block[0], goals, i)
            if outcome == DONE and not self._stands(int(tower.block[0, i]), goal):
                outcome = FELL
                placement = self.robot.account.entries[-1]
                placement.error = placement.turn = None
            labels[i] = outcome == DONE
            if self.on_judged is not None:
                self.on_judged()
            if outcome != DONE:
                return labels, outcome
        return labels, STOOD

    def _place(self, blocks: np.ndarray, goals: np.ndarray, i: int) -> str:
        """Bring the block of placement i to its goal.

        Each attempt starts where the block lies at that time. Attempts end when the block below has fallen.
        """
        unplanned, block, lost = 0, int(blocks[i]), False
        for _ in range(self.recovery.attempts):
            if i and not self._is_at(int(blocks[i - 1]), goals[i - 1]):
                return FELL
            outcome = self.robot.bring(block, goals[i], BUILD)
            if outcome == DONE:
                return DONE
            if outcome in NO_PLAN and lost:
                self._by_hand(block, self._cause(block))
            unplanned += outcome in NO_PLAN
            lost = outcome not in NO_PLAN
        return UNPLANNED if unplanned == self.recovery.attempts else GIVEN_UP

    def _stands(self, block: int, goal: np.ndarray) -> bool:
        self.robot.reality.wait(self.judging.settle)
        return self._is_at(block, goal)

    def _is_at(self, block: int, goal: np.ndarray) -> bool:
        seen = self.robot.see(block)
        near = distance(seen, goal) <= self.judging.position
        return near and angle(seen, goal) <= np.deg2rad(self.judging.rotation)

    # -- clearing up --------------------------------------------------------------------------------------------

    def tidy(self) -> None:
        """Bring every block home, however the block lies.

        A person brings home the blocks that the robot cannot bring; the account counts these interventions.
        """
        tries = np.zeros(len(self.names), int)
        while True:
            self._wait_until_still()
            self.robot.look()
            for block in np.flatnonzero(~self._at_home()):
                if not self.robot.reality.layout.holds(self.robot.belief.thought[block, :3, 3]):
                    self._by_hand(int(block), self._cause(int(block)))
            away = np.flatnonzero(~self._at_home())
            if not len(away):
                break
            worn = [int(block) for block in away if tries[block] >= self.recovery.tries]
            if worn:
                self._by_hand(worn[0], self._cause(worn[0]))
            else:
                self._one_block(away, tries)
        self.robot.rest()

    def _one_block(self, away: np.ndarray, tries: np.ndarray) -> None:
        """Move one block, the highest first: to its home if that is free and a plan is found, else to a spare place."""
        order = [int(b) for b in away[np.argsort(-self.robot.belief.thought[away, 2, 3], kind="stable")]]
        for block in order:
            if self.robot.belief.fits(block, self.homes[block], ROOM):
                tries[block] += 1
                if self.robot.bring(block, self.homes[block], TIDY) not in NO_PLAN:
                    return
        for block in order:
            spare = self._spare(block)
            taken = not self.robot.belief.fits(block, self.homes[block], ROOM)
            if spare is not None and taken:
                tries[block] += 1
                if self.robot.bring(block, spare, TIDY) not in NO_PLAN:
                    return
        for block in order:
            tries[block] += 1

    def _spare(self, block: int) -> np.ndarray | None:
        """[4, 4] pose in the first spare place that has room for a block; None: no place has room."""
        for x, y in SPARE:
            where = pose((x, y, self.robot.planner.blocks.dims[block, 2] / 2))
            if self.robot.belief.fits(block, where, 0.05):
                return where
        return None

    def _at_home(self) -> np.ndarray:
        """[B] bool: is each block believed to be in its home?"""
        sight = self.robot.sight
        near = self.recovery.home_position + 4 * sight.position
        turn = np.deg2rad(self.recovery.home_rotation + 4 * sight.rotation)
        return np.array(
            [
                distance(seen, home) <= near and angle(seen, home) <= turn
                for seen, home in zip(self.robot.belief.thought, self.homes)
            ]
        )

    def _wait_until_still(self) -> None:
        """Wait until all blocks are still, for two seconds at most."""
        reality = self.robot.reality
        for _ in range(20):
            speeds = [np.abs(reality.client.getBaseVelocity(body)).max() for body in reality.bodies]
            if max(speeds) < 0.02:
                return
            reality.wait(0.1)

    def _cause(self, block: int) -> str:
        """Why the robot cannot bring a block home."""
        x, y, _ = place = self.robot.belief.thought[block, :3, 3]
        attempts = [entry for entry in self.robot.account.entries if entry.block == self.names[block]]
        if not self.robot.reality.layout.holds(place):
            return "off the table"
        if np.hypot(x, y) > 0.75:
            return "out of reach"
        return attempts[-1].outcome if attempts and attempts[-1].outcome != DONE else "jammed"

    def _by_hand(self, block: int, cause: str) -> None:
        """A person puts a block home. Blocks that lie there are put home, too."""
        self.ask_for_help(self.names[block], cause)
        self.robot.account.entries.append(Entry(INTERVENTION, self.names[block], cause))
        waiting, done = [block], set()
        while waiting:
            moved = waiting.pop()
            done.add(moved)
            home = self.homes[moved]
            waiting += [b for b in self.robot.belief.in_the_way(moved, home, ROOM) if b not in done]
            self.robot.reality.put(moved, home)
            poses = self.robot.belief.thought.copy()
            poses[moved] = home
            self.robot.belief.update(poses)


def goal_poses(tower: Towers, base: tuple[float, float]) -> np.ndarray:
    """[K, 4, 4] goal poses of the blocks of one tower (N = 1). The origin of the tower is at the base."""
    places = zip(tower.xy[0] + np.array(base), tower.z[0], tower.rotation[0])
    return np.array([pose((*xy, z), ROTATIONS[rotation]) for xy, z, rotation in places])
