"""The robot world: plans are carried out by a simulated Panda, and labelled by what comes of it."""

import sys
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from pydantic import Field

from apf.domain import Outcome, World
from apf.errors import Stopped
from apf.panda import accounting
from apf.panda.belief import Belief
from apf.panda.builder import Builder
from apf.panda.flaws import Flaws
from apf.panda.geometry import from_vector, to_vector
from apf.panda.grasps import Gripper
from apf.panda.layout import Layout
from apf.panda.limits import check_blocks, check_height, check_legible, check_places
from apf.panda.log import ENDING, Content
from apf.panda.motion import MotionSettings
from apf.panda.planner import Planner, Search
from apf.panda.reality import Bullet, Physics, Reality, Rig
from apf.panda.reality.photographer import Photographer
from apf.panda.recorder import recording
from apf.panda.robot import Robot
from apf.panda.settings import Arm, Handling, Help, Judging, Recovery, Sight
from apf.panda.stations import Reach
from apf.panda.vision.cameras import Cameras
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
    log: Content = Content.NOTHING
    """What is logged of each tower, in an MCAP file of its own."""
    initial: World | None = None
    """Where an experiment's first towers are labelled; None: here, too."""
    reality: Physics = Field(default_factory=Bullet)
    """The physics that stands for reality."""
    flaws: Flaws = Field(default_factory=Flaws)
    """What reality does that the robot does not know."""
    cameras: Cameras = Field(default_factory=Cameras)
    layout: Layout = Field(default_factory=Layout)
    arm: Arm = Field(default_factory=Arm)
    gripper: Gripper = Field(default_factory=Gripper)
    reach: Reach = Field(default_factory=Reach)
    motion: MotionSettings = Field(default_factory=MotionSettings)
    search: Search = Field(default_factory=Search)
    sight: Sight = Field(default_factory=Sight)
    handling: Handling = Field(default_factory=Handling)
    judging: Judging = Field(default_factory=Judging)
    recovery: Recovery = Field(default_factory=Recovery)
    _open: list[Any] = field(default_factory=list, init=False, repr=False)
    """The builder and its reality, once they were needed."""
    _logs: list[Path] = field(default_factory=list, init=False, repr=False)
    """The log of the next tower, if there is to be one."""

    @property
    def initial_world(self) -> World:
        """Where an experiment labels its first towers: the paper's were labelled in a noisy simulation."""
        return self.initial or self

    def check(self, domain: TowerDomain, length: int, evaluation: bool = False) -> None:
        """As `World.check`; names the block and the limit."""
        blocks = domain.evaluation_blocks if evaluation else domain.training_blocks
        check_blocks(blocks, self.gripper, self.layout)
        check_legible(blocks, self.layout, self.cameras)
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
        builder, names = self.builder, plan.blocks.name
        self.simulated.begin(plan.blocks, self._poses(plan.blocks, before, "blocks"), _child(rng))
        with self._logged(plan.blocks):
            builder.robot.begin(plan.blocks, rng, self._poses(plan.blocks, before, "believed"))
            built = builder.build(plan)
            builder.tidy()
        report = {
            "outcome": built.outcome,
            "entries": builder.robot.account.plain(),
            "blocks": _named(names, self.simulated.poses()),
            "believed": _named(names, builder.robot.belief.thought),
        }
        return Outcome(built.labels, report if built.sure is None else {**report, "sure": built.sure})

    def log_to(self, path: Path | None) -> None:
        """As `World.log_to`; the file's ending is `.mcap`."""
        self._logs[:] = [] if path is None else [path.with_name(path.name + ENDING)]

    def _logged(self, blocks: BlockSet) -> AbstractContextManager[None]:
        """Context: what is done with the blocks is logged, if that is wanted."""
        if not self._logs or self.log == Content.NOTHING:
            return nullcontext()
        return recording(self._logs[0], self.builder, self.simulated, blocks, self.log)

    def check_plans(self, plans: Towers) -> None:
        """Raises InputError, naming block and limit, if the robot cannot try these towers."""
        check_blocks(plans.blocks, self.gripper, self.layout)
        check_legible(plans.blocks, self.layout, self.cameras)
        check_height(float(plans.dims[..., 2].sum(1).max(initial=0.0)), self.layout, self.reach)
        check_places(plans, self.layout)

    def _poses(self, blocks: BlockSet, before: Mapping[str, Any] | None, key: str) -> np.ndarray:
        """[B, 4, 4] where the blocks lie, or are believed to; at home, unless an earlier report of the set differs."""
        if before is None or set(before[key]) != set(blocks.name):
            return self.layout.home_poses(blocks.dims)
        return np.array([from_vector(before[key][name]) for name in blocks.name])

    @property
    def builder(self) -> Builder:
        """The robot and its simulated reality, made when first needed."""
        if not self._open:
            cameras = self.cameras.named()
            photographer = Photographer(self.layout, cameras, self.flaws.drawn(cameras))
            rig = Rig(
                self.layout, self.arm, self.gripper, photographer, self.cameras.wrist, hold=self.hold, gui=self.gui
            )
            reality = self.reality.reality(rig)
            belief = Belief(self.layout, self.cameras.wrist)
            planner = Planner(belief, self.gripper, self.reach, self.motion, self.search, self.sight.overlap)
            robot = Robot(
                *(reality, belief, planner, cameras, self.sight, self.handling, self.arm),
                witness=reality.pose_of,
                say=_say,
            )
            builder = Builder(robot, self.judging, self.recovery, self._ask_for_help, person=reality)
            self._open.append((builder, reality))
        return self._open[0][0]

    @property
    def simulated(self) -> Reality:
        """The reality that the robot works in."""
        assert self.builder
        return self._open[0][1]

    def close(self) -> None:
        """Give the PyBullet worlds back."""
        for builder, reality in self._open:
            reality.close()
            builder.robot.belief.close()
        self._open.clear()

    def _ask_for_help(self, block: str, cause: str) -> None:
        if self.interventions == Help.STOP:
            raise Stopped(f"the robot needs a person: block {block}: {cause}")
        if self.interventions == Help.ASK:
            print(f"block {block}: {cause}. Put it home and press Enter.", file=sys.stderr, flush=True)
            if not sys.stdin.readline():
                raise Stopped(f"the robot needs a person, and nobody is at the terminal: block {block}: {cause}")


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _child(rng: np.random.Generator) -> np.random.Generator:
    """A generator of its own for reality, so that no draw of the robot depends on how often reality draws."""
    return np.random.default_rng(int(rng.integers(2**63)))


def _named(names: Sequence[str], poses: np.ndarray) -> dict[str, list[float]]:
    """Poses [B, 4, 4] as vectors by the names of blocks."""
    return {name: to_vector(where).tolist() for name, where in zip(names, poses)}
