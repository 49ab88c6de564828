"""One experiment of the robot: build a tower, judge each prefix, clear up (Section Perception, planning, execution)."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field

import numpy as np

from apf.domain import UNOBSERVED
from apf.panda.accounting import BUILD, DONE, INTERVENTION, TIDY, Entry
from apf.panda.geometry import angle, distance, pose
from apf.panda.hardware import Person
from apf.panda.layout import Layout
from apf.panda.robot import GONE, IN_VAIN, NO_PLAN, NOT_THERE, Robot
from apf.panda.settings import Judging, Recovery
from apf.towers import ROTATIONS, Towers

STOOD, FELL, UNPLANNED, GIVEN_UP = "stood", "fell", "no plan", "given up"
"""How a plan ended: all prefixes stood; a prefix fell; the planner found no plan; execution failed too often."""
SEEN, UNSEEN, BEFORE_NEXT, WHILE_CARRYING, WHILE_WORKING = (
    *("seen", "unseen", "before the next", "while carrying", "while working"),
)
"""How sure a label 0 is.

seen: The block was seen elsewhere a moment after its placement. unseen: No camera saw it in its place. before the next,
while carrying: The tower had stood a moment after the placement, and was seen fallen before the arm came near again.
while working: The tower was seen fallen after the arm had been near, which may have pushed it; the placement that the
arm was at is charged.
"""
SPARE = [(x, y) for y in (0.0, 0.14, -0.12, 0.26) for x in (0.45, 0.58, 0.34)]
"""Spare places [m]: a block may wait here while another block lies in its home."""
STILL_LOOKS, STILL_PAUSE = 5, 0.4
"""Before it clears up, the robot looks so often at most, and waits so long between two looks [s]."""
ROOM = 0.004
"""Distance [m]. A home is free if its block, put there, would be at least this far from all other blocks."""


@dataclass(frozen=True, eq=False)
class Built:
    """What came of a tower: labels [K] int8 of its prefixes, how the plan ended, and how sure a label 0 is."""

    labels: np.ndarray
    outcome: str
    sure: str | None = None


@dataclass
class Builder:
    """Builds with a robot; `ask_for_help(block, cause)` is called before `person` puts a block home."""

    robot: Robot
    judging: Judging
    recovery: Recovery
    ask_for_help: Callable[[str, str], None]
    person: Person
    on_judged: list[Callable[[Built], None]] = field(default_factory=list)
    """Called after each placement was judged, with what has come of the tower by then, e.g. to take a picture."""

    @property
    def names(self) -> tuple[str, ...]:
        """[B] names of the blocks."""
        return self.robot.planner.blocks.name

    @property
    def layout(self) -> Layout:
        """Places on the table."""
        return self.robot.belief.layout

    @property
    def homes(self) -> np.ndarray:
        """[B, 4, 4] pose of each block in its home."""
        return self.layout.home_poses(self.robot.planner.blocks.dims)

    # -- building -----------------------------------------------------------------------------------------------

    def build(self, tower: Towers) -> Built:
        """Build one tower (N = 1) and judge each prefix. The tower, or its ruins, stay on the table.

        What stands is looked at before the arm comes near and before it lowers a block. What has fallen by then fell
        after the placement that was judged last, and is charged to that placement: the label that it stood is taken
        back.
        """
        labels = np.full(tower.length, UNOBSERVED, np.int8)
        blocks, goals = tower.block[0], goal_poses(tower, self.layout.base)
        for i in range(tower.length):
            outcome, sure = self._place(blocks, goals, i)
            if outcome == DONE:
                sure = self._judge(blocks, goals, i)
                outcome = DONE if sure is None else FELL
            before = sure in (BEFORE_NEXT, WHILE_CARRYING)
            labels[i - 1 if before else i] = outcome == DONE
            built = Built(labels.copy(), STOOD if outcome == DONE else outcome, sure)
            for call in self.on_judged:
                call(built)
            if outcome != DONE:
                return built
        return Built(labels, STOOD)

    def _place(self, blocks: np.ndarray, goals: np.ndarray, i: int) -> tuple[str, str | None]:
        """Bring the block of placement i to its goal; the outcome, and how sure it is when the tower fell.

        Each attempt starts where the block lies at that time. Attempts end when a block of the tower has fallen.
        """
        unplanned, block, lost = 0, int(blocks[i]), False
        for attempt in range(self.recovery.attempts):
            if attempt:
                self.robot.look()
            if not self._all_stand(blocks, goals, i):
                return FELL, WHILE_WORKING if attempt else BEFORE_NEXT
            outcome = self.robot.bring(block, goals[i], BUILD, lambda: self._may_go_on(blocks, goals, i))
            if outcome == DONE:
                return DONE, None
            if outcome == IN_VAIN:
                return FELL, WHILE_WORKING if attempt else WHILE_CARRYING
            if outcome == NOT_THERE or (outcome in NO_PLAN and lost):
                self._by_hand(block, self._cause(block))
            unplanned += outcome in NO_PLAN
            lost = outcome not in NO_PLAN
        return UNPLANNED if unplanned == self.recovery.attempts else GIVEN_UP, None

    def _may_go_on(self, blocks: np.ndarray, goals: np.ndarray, i: int) -> bool:
        """Does what was built still stand? There is nothing to look at below the first block."""
        if i:
            self.robot.look()
        return self._all_stand(blocks, goals, i)

    def _judge(self, blocks: np.ndarray, goals: np.ndarray, i: int) -> str | None:
        """None: the first i + 1 placements stand; else how sure it is that they do not."""
        robot, block = self.robot, int(blocks[i])
        robot.hardware.wait(self.judging.settle)
        seen = robot.examine(block)
        if not seen:
            robot.rest()
            seen = bool(robot.look()[block])
        placement = robot.account.entries[-1]
        if seen and self._is_at(block, goals[i]) and self._all_stand(blocks, goals, i):
            return None
        placement.error = placement.turn = None
        return SEEN if seen else UNSEEN

    def _all_stand(self, blocks: np.ndarray, goals: np.ndarray, n: int) -> bool:
        """Are the blocks of the first n placements believed to be where they belong?"""
        return all(self._is_at(int(block), goal) for block, goal in zip(blocks[:n], goals[:n]))

    def _is_at(self, block: int, goal: np.ndarray) -> bool:
        where = self.robot.belief.thought[block]
        near = distance(where, goal) <= self.judging.position
        return near and angle(where, goal) <= np.deg2rad(self.judging.rotation)

    # -- clearing up --------------------------------------------------------------------------------------------

    def tidy(self) -> None:
        """Bring every block home, however the block lies.

        A person brings home the blocks that the robot cannot bring; the account counts these interventions.
        """
        tries, helped = np.zeros(len(self.names), int), set[int]()
        while True:
            self._wait_until_still()
            for block in np.flatnonzero(~self._at_home()):
                if not self.layout.holds(self.robot.belief.thought[block, :3, 3]):
                    self._by_hand(int(block), self._cause(int(block)))
            away = np.flatnonzero(~self._at_home())
            if not len(away):
                missing = self._missing(helped)
                if missing is None:
                    return
                helped.add(missing)
                self._by_hand(missing, NOT_THERE)
                continue
            worn = [int(block) for block in away if tries[block] >= self.recovery.tries]
            if worn:
                self._by_hand(worn[0], self._cause(worn[0]))
            else:
                self._one_block(away, tries)

    def _missing(self, helped: Collection[int]) -> int | None:
        """Go to rest, and look for a block that is believed to be at home and is not; None: there is none.

        A block that no camera beside the table sees is looked for with the camera on the hand. Of those that a person
        has put home already, none is looked for: their markers cannot be read there.
        """
        self.robot.rest()
        hidden = [block for block in np.flatnonzero(~self.robot.look()) if block not in helped]
        missing = next((int(block) for block in hidden if not self.robot.visit(int(block))), None)
        if len(hidden):
            self.robot.rest()
        return missing

    def _one_block(self, away: np.ndarray, tries: np.ndarray) -> None:
        """Move one block, the highest first: to its home if that is free and a plan is found, else to a spare place."""
        order = [int(b) for b in away[np.argsort(-self.robot.belief.thought[away, 2, 3], kind="stable")]]
        for block in order:
            if self.robot.belief.fits(block, self.homes[block], ROOM):
                tries[block] += 1
                if self._bring(block, self.homes[block]) not in NO_PLAN:
                    return
        for block in order:
            spare = self._spare(block)
            taken = not self.robot.belief.fits(block, self.homes[block], ROOM)
            if spare is not None and taken:
                tries[block] += 1
                if self._bring(block, spare) not in NO_PLAN:
                    return
        for block in order:
            tries[block] += 1

    def _bring(self, block: int, where: np.ndarray) -> str:
        """Bring a block to a pose [4, 4] and see how it lies there; the outcome."""
        outcome = self.robot.bring(block, where, TIDY)
        if outcome == DONE:
            self.robot.examine(block)
        return outcome

    def _spare(self, block: int) -> np.ndarray | None:
        """[4, 4] pose in the first spare place that has room for a block; None: no place has room."""
        for x, y in SPARE:
            where = pose((x, y, self.robot.planner.blocks.dims[block, 2] / 2))
            if self.robot.belief.fits(block, where, 0.05):
                return where
        return None

    def _at_home(self) -> np.ndarray:
        """[B] bool: is each block believed to be in its home?"""
        near = self.recovery.home_position + 4 * self.robot.sight.uncertainty
        turn = np.deg2rad(self.recovery.home_rotation)
        return np.array(
            [
                distance(seen, home) <= near and angle(seen, home) <= turn
                for seen, home in zip(self.robot.belief.thought, self.homes)
            ]
        )

    def _wait_until_still(self) -> None:
        """Look until no block is seen to have moved, for two seconds at most."""
        for _ in range(STILL_LOOKS):
            before = self.robot.belief.thought
            self.robot.look()
            if np.array_equal(before, self.robot.belief.thought):
                return
            self.robot.hardware.wait(STILL_PAUSE)

    def _cause(self, block: int) -> str:
        """Why the robot cannot bring a block home."""
        x, y, _ = place = self.robot.belief.thought[block, :3, 3]
        attempts = [entry for entry in self.robot.account.entries if entry.block == self.names[block]]
        if not self.layout.holds(place):
            return NOT_THERE if place[2] <= GONE[2, 3] else "off the table"
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
            self.person.put(moved, home)
            poses = self.robot.belief.thought.copy()
            poses[moved] = home
            self.robot.belief.update(poses)


def goal_poses(tower: Towers, base: tuple[float, float]) -> np.ndarray:
    """[K, 4, 4] goal poses of the blocks of one tower (N = 1). The origin of the tower is at the base."""
    places = zip(tower.xy[0] + np.array(base), tower.z[0], tower.rotation[0])
    return np.array([pose((*xy, z), ROTATIONS[rotation]) for xy, z, rotation in places])
