"""A robot world with exact eyes, and one with the configured ones; made once for all tests of a worker."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from apf.panda import PandaWorld
from apf.panda.belief import Belief
from apf.panda.builder import Builder
from apf.panda.layout import Layout
from apf.panda.settings import Sight
from apf.towers import BlockSet

EXACT = Sight(position=0.0, rotation=0.0)


@pytest.fixture(scope="session")
def world() -> Iterator[PandaWorld]:
    """As configured by default."""
    world = PandaWorld()
    yield world
    world.close()


@pytest.fixture(scope="session")
def exact_world() -> Iterator[PandaWorld]:
    """Exact pose estimates."""
    world = PandaWorld(sight=EXACT)
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
        world.builder.robot.begin(graspable, poses, np.random.default_rng(0))
        world.builder.robot.reality.wait(1.0)
        return world.builder

    return scene
