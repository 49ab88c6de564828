"""A robot without flaws, and one as configured; made once for all tests of a worker."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from apf.panda import PandaWorld
from apf.panda.belief import Belief
from apf.panda.builder import Builder
from apf.panda.flaws import Flaws
from apf.panda.layout import Layout
from apf.towers import BlockSet

CALIBRATED = Flaws(hand_eye=0.0008, hand_eye_turn=0.15, static=0.001, static_turn=0.06)


@pytest.fixture(scope="session")
def world() -> Iterator[PandaWorld]:
    """Calibrated, as configured by default."""
    world = PandaWorld(flaws=CALIBRATED)
    yield world
    world.close()


@pytest.fixture(scope="session")
def exact_world() -> Iterator[PandaWorld]:
    """Without flaws."""
    world = PandaWorld()
    yield world
    world.close()


@pytest.fixture
def belief(graspable: BlockSet) -> Iterator[Belief]:
    """All blocks at home."""
    belief = Belief(Layout())
    belief.build(graspable, belief.layout.home_poses(graspable.dims))
    yield belief
    belief.close()


@pytest.fixture
def scene(world: PandaWorld, graspable: BlockSet) -> Callable[[np.ndarray], Builder]:
    """`scene(poses)`: the robot before blocks at these poses, after they have come to lie."""

    def scene(poses: np.ndarray) -> Builder:
        world.simulated.begin(graspable, poses, np.random.default_rng(1))
        world.builder.robot.begin(graspable, np.random.default_rng(0))
        world.simulated.wait(1.0)
        return world.builder

    return scene
