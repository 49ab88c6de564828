"""The robot world: plans are carried out by a simulated Panda, and labelled by what comes of it."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Any, Literal

import numpy as np
import pandas as pd
from pydantic import Field

from apf.domain import Outcome, World
from apf.errors import Stopped
from apf.panda import accounting
from apf.panda.belief import Belief
from apf.panda.builder import Builder
from apf.panda.geometry import from_vector, to_vector
from apf.panda.grasps import Gripper
from apf.panda.layout import Layout
from apf.panda.limits import check_blocks, check_height, check_places
from apf.panda.motion import MotionSettings
from apf.panda.planner import Planner, Search
from apf.panda.reality import Arm, Physics, Reality
from apf.panda.robot import Robot
from apf.panda.settings import Handling, Help, Judging, Recovery, Sight
from apf.panda.stations import Reach
from apf.settings import settings
from apf.towers import BlockSet, TowerDomain, Towers


@settings
class PandaWorld(World):
    """A Panda builds each tower, judges each prefix, and clears up; see `conf/world/panda.yaml`."""

    for_domain = TowerDomain
    hold: Literal["friction", "constraint"] = "friction"
    """How the gripper holds a block: by friction, or also tied to the hand while the gripper is closed."""
    interventions: Help = Help.AUTO
    gui: bool = False
    """Show reality in PyBullet's window."""
    initial: World | None = None
    """Where an experiment's first towers are labelled; None: here, too."""
    layout: Layout = Field(default_factory=Layout)
    physics: Physics = Field(default_factory=Physics)
    arm: Arm = Field(default_factory=Arm)
    gripper: Gripper = Field(default_factory=Gripper)
    reach: Reach = Field(default_factory=Reach)
    motion: MotionSettings = Field(default_factory=MotionSettings)
    search: Search = Field(default_factory=Search)
    sight: Sight = Field(default_factory=Sight)
    handling: Handling = Field(default_factory=Handling)
    judging: Judging = Field(default_factory=Judging)
    recovery: Recovery = Field(default_factory=Recovery)
    _open: list[Builder] = field(default_factory=list, init=False, repr=False)
    """The robot, once it was needed."""

    @property
    def initial_world(self) -> World:
        """Where an experiment labels its first towers: the paper's were labelled in a noisy simulation."""
        return self.initial or self

    def check(self, domain: TowerDomain, length: int, evaluation: bool = False) -> None:
        """As `World.check`; names the block and the limit."""
        blocks = domain.evaluation_blocks if evaluation else domain.training_blocks
        check_blocks(blocks, self.gripper, self.layout)
        tallest = np.sort(blocks.dims.max(1))[::-1][:length].sum()
        check_height(float(tallest), self.layout, self.reach)

    def summary(self, reports: Sequence[Mapping[str, Any]]) -> dict[str, float]:
        """Pick-and-places, interventions and so on, and medians of time and placement error."""
        return accounting.summary(reports) if reports else {}

    def table(self, reports: Mapping[int, Mapping[str, Any]]) -> pd.DataFrame:
        """A row for each pick-and-place and each intervention: `accounting.COLUMNS`."""
        return accounting.table(reports.items())

    def execute(self, plans: Towers, rng: np.random.Generator) -> np.ndarray:
        """Labels [N, K]; each tower begins with all blocks at home. Raises InputError before anything moves."""
        self.check_plans(plans)
        labels = [self.attempt(plans[n : n + 1], rng).labels for n in range(len(plans))]
        return np.array(labels, np.int8).reshape(plans.block.shape)

    def attempt(self, plan: Towers, rng: np.random.Generator, before: Mapping[str, Any] | None = None) -> Outcome:
        """As `World.attempt`: build one tower, clear up, and report."""
        self.check_plans(plan)
        builder = self.builder
        poses = self._poses(plan.blocks, before)
        builder.robot.begin(plan.blocks, poses, rng)
        labels, outcome = builder.build(plan)
        builder.tidy()
        left = {name: to_vector(p).tolist() for name, p in zip(plan.blocks.name, builder.robot.reality.poses())}
        return Outcome(labels, {"outcome": outcome, "entries": builder.robot.account.plain(), "blocks": left})

    def check_plans(self, plans: Towers) -> None:
        """Raises InputError, naming block and limit, if the robot cannot try these towers."""
        check_blocks(plans.blocks, self.gripper, self.layout)
        check_height(float(plans.dims[..., 2].sum(1).max(initial=0.0)), self.layout, self.reach)
        check_places(plans, self.layout)

    def _poses(self, blocks: BlockSet, before: Mapping[str, Any] | None) -> np.ndarray:
        """[B, 4, 4] where the blocks lie; at home, unless an earlier report of the same set says otherwise."""
        if before is None or set(before["blocks"]) != set(blocks.name):
            return self.layout.home_poses(blocks.dims)
        return np.array([from_vector(before["blocks"][name]) for name in blocks.name])

    @property
    def builder(self) -> Builder:
        """The robot and its two PyBullet worlds, made when first needed."""
        if not self._open:
            reality = Reality(self.layout, self.physics, self.arm, self.gripper, self.hold, self.gui)
            belief = Belief(self.layout)
            planner = Planner(belief, self.gripper, self.reach, self.motion, self.search)
            robot = Robot(reality, belief, planner, self.sight, self.handling)
            self._open.append(Builder(robot, self.judging, self.recovery, self._ask_for_help))
        return self._open[0]

    def close(self) -> None:
        """Give the PyBullet worlds back."""
        for builder in self._open:
            builder.robot.reality.close()
            builder.robot.belief.close()
        self._open.clear()

    def _ask_for_help(self, block: str, cause: str) -> None:
        if self.interventions == Help.STOP:
            raise Stopped(f"the robot needs a person: block {block}: {cause}")
        if self.interventions == Help.ASK:
            print(f"block {block}: {cause}. Put it home and press Enter.", file=sys.stderr, flush=True)
            if not sys.stdin.readline():
                raise Stopped(f"the robot needs a person, and nobody is at the terminal: block {block}: {cause}")
