"""Images of reality: where its cameras really are, what they see."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from apf.panda.flaws import Drawn
from apf.panda.layout import Layout
from apf.panda.vision.cameras import WRIST, Camera
from apf.panda.vision.studio import Studio
from apf.towers import BlockSet


@dataclass(frozen=True, eq=False)
class State:
    """How things really are at a moment.

    poses: [B, 4, 4] of the blocks. joints: [7] of the arm [rad]. fingers: Position of each finger [m]. hand: [4, 4] of
    the point between the fingertips.
    """

    poses: np.ndarray
    joints: np.ndarray
    fingers: tuple[float, float]
    hand: np.ndarray


class Photographer:
    """Takes the images of a robot's cameras.

    Args:
        layout: Places on the table.
        cameras: By their names.
        drawn: The flaws of the robot: its cameras are a little off.
    """

    def __init__(self, layout: Layout, cameras: Mapping[str, Camera], drawn: Drawn) -> None:
        self.studio = Studio(layout)
        self.cameras, self.drawn = cameras, drawn

    def images(
        self, names: Collection[str], blocks: BlockSet, state: State, rng: np.random.Generator
    ) -> dict[str, np.ndarray]:
        """[height, width] uint8 by the names of cameras.

        Args:
            names: Of the cameras.
            blocks: The set.
            state: How things are.
            rng: The source of the noise.
        """
        self.studio.prepare(blocks)
        self.studio.set(state.poses, state.joints, state.fingers)
        found = {}
        for name in names:
            mounted = self.drawn.mounted[name]
            where = state.hand @ mounted if name == WRIST else mounted
            found[name] = self.studio.photograph(self.cameras[name], where, rng)
        return found

    def close(self) -> None:
        """Give the client back."""
        self.studio.close()
