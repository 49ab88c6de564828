"""A recorder between the robot and its hardware: what passes through goes into a log, and changes nothing."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from apf.panda.accounting import DONE, INTERVENTION, Entry
from apf.panda.builder import Builder, Built
from apf.panda.hardware import Hardware, Image, Refused
from apf.panda.log import BELIEVED, ERROR, INFO, TRUE, WARNING, Content, Log
from apf.panda.reality import Reality
from apf.panda.robot import Robot
from apf.towers import BlockSet

INTERVAL = 0.1
"""Between two samples of joints and true poses [s]."""
MOVED = 1e-4
"""A block whose pose changed by less in every number [m] has not moved."""


class Recorder:
    """Hardware that passes everything on to other hardware, and notes it.

    Args:
        hardware: The robot's hardware.
        robot: Its account and belief are read, between two calls to the hardware.
        log: Where the notes go.
        images: Keep images, too?
    """

    def __init__(self, hardware: Hardware, robot: Robot, log: Log, images: bool) -> None:
        self.hardware, self.robot, self.log, self.keep_images = hardware, robot, log, images
        self._begun = self._ended = 0
        """Entries of the account whose begin, and whose end, is noted."""
        self._poses: dict[str, np.ndarray] = {}
        self._next = 0.0

    # -- the hardware -------------------------------------------------------------------------------------------

    def seconds(self) -> float:
        """See `Hardware.seconds`."""
        return self.hardware.seconds()

    def wait(self, seconds: float) -> None:
        """See `Hardware.wait`."""
        self.note()
        self.hardware.wait(seconds)

    def joints(self) -> np.ndarray:
        """See `Hardware.joints`."""
        return self.hardware.joints()

    def follow(self, path: np.ndarray, speed: float) -> None:
        """See `Hardware.follow`."""
        self.note()
        try:
            self.hardware.follow(path, speed)
        except Refused as error:
            self._event(WARNING, f"the arm refused a motion: {error}")
            raise

    def width(self) -> float:
        """See `Hardware.width`."""
        return self.hardware.width()

    def grip(self) -> None:
        """See `Hardware.grip`."""
        self.note()
        self.hardware.grip()
        self._event(INFO, f"gripped: {1000 * self.hardware.width():.1f} mm between the fingers")

    def release(self) -> None:
        """See `Hardware.release`."""
        self.note()
        self.hardware.release()
        self._event(INFO, "released")

    def images(self, names: Collection[str]) -> dict[str, Image]:
        """See `Hardware.images`."""
        self.note()
        found = self.hardware.images(names)
        for name in names:
            if name not in found:
                self._event(WARNING, f"camera {name} does not answer")
            elif self.keep_images:
                self.log.image(self.seconds(), name, found[name])
        return found

    # -- what else is noted -------------------------------------------------------------------------------------

    def note(self) -> None:
        """Note what the robot's account and belief have that the log has not."""
        entries = self.robot.account.entries
        while self._ended < len(entries):
            entry = entries[self._ended]
            if self._begun == self._ended:
                before = entries[self._begun - 1] if self._begun else None
                self._event(*_begin_of(entry, before))
                self._begun += 1
            if entry.purpose != INTERVENTION:
                if not entry.wall:  # the robot is at it
                    break
                self._event(*_end_of(entry))
            self._ended += 1
        self._note_poses(BELIEVED, self.robot.belief.thought)

    def sample(self, reality: Reality) -> None:
        """Called after every step of a simulation: now and then, note the joints, and where blocks really are."""
        seconds = self.seconds()
        if seconds < self._next:
            return
        self._next = seconds + INTERVAL
        self.log.joints(seconds, self.joints(), self.width())
        self._note_poses(TRUE, reality.poses())

    def judged(self, built: Built) -> None:
        """Called when a placement was judged."""
        self.note()
        fallen, k = np.flatnonzero(built.labels == 0), len(built.labels)
        if len(fallen):
            sure = f" ({built.sure})" if built.sure else ""
            self._event(ERROR, f"placement {fallen[0] + 1} of {k}: {built.outcome}{sure}")
        else:
            self._event(INFO, f"placement {(built.labels == 1).sum()} of {k}: stood")

    def _note_poses(self, kind: str, poses: np.ndarray) -> None:
        """Note the poses [B, 4, 4] that differ from those that were noted last."""
        last = self._poses.setdefault(kind, np.full_like(poses, np.nan))
        moved = np.flatnonzero(~(np.abs(poses - last) <= MOVED).all((1, 2)))
        last[moved] = poses[moved]
        self.log.poses(self.seconds(), kind, {int(block): poses[block] for block in moved})

    def _event(self, level: Any, text: str) -> None:
        self.log.event(self.seconds(), level, text)


@contextmanager
def recording(path: Path, builder: Builder, reality: Reality, blocks: BlockSet, content: Content) -> Iterator[None]:
    """Context: what the builder's robot does, and what comes of it, is logged.

    Args:
        path: Of the log.
        builder: Who builds; its robot begins within the context.
        reality: In which the robot is at work.
        blocks: The set.
        content: What the log holds.
    """
    robot = builder.robot
    with Log(path, blocks, robot.cameras, builder.layout) as log:
        hardware = robot.hardware
        recorder = Recorder(hardware, robot, log, content == Content.IMAGES)
        robot.hardware = recorder
        reality.on_step.append(recorder.sample)
        builder.on_judged.append(recorder.judged)
        try:
            yield
            recorder.note()
        finally:
            robot.hardware = hardware
            reality.on_step.remove(recorder.sample)
            builder.on_judged.remove(recorder.judged)


def _begin_of(entry: Entry, before: Entry | None) -> tuple[Any, str]:
    if entry.purpose == INTERVENTION:
        return WARNING, f"intervention: block {entry.block}: {entry.outcome}"
    again = before is not None and (before.purpose, before.block) == (entry.purpose, entry.block)
    anew = ", planned anew" if again and before is not None and before.outcome != DONE else ""
    return INFO, f"{entry.purpose}: block {entry.block}{anew}"


def _end_of(entry: Entry) -> tuple[Any, str]:
    counts = f"{entry.plans} task plans, {entry.replans} given up, {entry.regrasps} regrasps"
    level = INFO if entry.outcome == DONE else WARNING
    return level, f"{entry.purpose}: block {entry.block}: {entry.outcome} ({counts})"
