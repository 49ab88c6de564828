"""Building, judging and clearing up, in physics."""

from collections.abc import Callable

import numpy as np
import pytest

from apf.errors import Stopped
from apf.panda import PandaWorld
from apf.panda.accounting import INTERVENTION
from apf.panda.builder import Builder
from apf.panda.geometry import angle, distance, pose
from apf.panda.settings import Help
from apf.towers import BlockSet, Towers
from panda.jumbles import KINDS, jumble

Scene = Callable[[np.ndarray], Builder]


def must_be_home(builder: Builder) -> None:
    """Fails unless every block really is where it is stored, upright, and the arm is empty and away from all."""
    assert builder.robot.witness is not None
    for name, where, home in zip(
        builder.names, [builder.robot.witness(b) for b in range(len(builder.names))], builder.homes
    ):
        assert distance(where, home) < 0.017, name
        assert angle(where, home) < np.deg2rad(9), name
    assert builder.robot.hardware.width() > 0.079
    assert not builder.robot.belief.touched(builder.robot.hardware.joints(), 0.01)


def helped(builder: Builder) -> list[str]:
    """Causes of the interventions."""
    return [entry.outcome for entry in builder.robot.account.entries if entry.purpose == INTERVENTION]


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_jumble_is_cleared_up(kind: str, scene: Scene, graspable: BlockSet) -> None:
    builder = scene(jumble(kind, graspable, 0))
    builder.tidy()
    must_be_home(builder)
    assert not helped(builder)


@pytest.mark.robot
@pytest.mark.parametrize("number", range(1, 7))
@pytest.mark.parametrize("kind", KINDS)
def test_many_jumbles_are_cleared_up(kind: str, number: int, scene: Scene, graspable: BlockSet) -> None:
    builder = scene(jumble(kind, graspable, number))
    builder.tidy()
    must_be_home(builder)
    assert not helped(builder)


def test_where_all_are_home_nothing_is_done(scene: Scene, graspable: BlockSet, world: PandaWorld) -> None:
    builder = scene(world.layout.home_poses(graspable.dims))
    builder.tidy()
    assert builder.robot.account.entries == []
    must_be_home(builder)


@pytest.mark.parametrize(("x", "y", "z", "cause"), [(1.5, 0.0, -0.7, "not seen"), (0.3, 0.92, 0.03, "out of reach")])
def test_what_cannot_be_fetched_is_put_home_and_counted(
    x: float, y: float, z: float, cause: str, scene: Scene, graspable: BlockSet, world: PandaWorld
) -> None:
    poses = world.layout.home_poses(graspable.dims)
    poses[1] = pose((x, y, z))
    builder = scene(poses)
    builder.tidy()
    assert helped(builder) == [cause]
    must_be_home(builder)


def test_a_block_by_hand_makes_room_at_its_home(scene: Scene, graspable: BlockSet, world: PandaWorld) -> None:
    poses = world.layout.home_poses(graspable.dims)
    poses[2] = poses[1]
    poses[1] = pose((1.5, 0.0, -0.7))
    builder = scene(poses)
    builder.tidy()
    must_be_home(builder)
    assert helped(builder) == ["not seen"]


def test_stop_stops(graspable: BlockSet) -> None:
    world = PandaWorld(interventions=Help.STOP)
    with pytest.raises(Stopped, match="needs a person: block block_01: off the table"):
        world.builder.ask_for_help("block_01", "off the table")
    world.close()


def test_nobody_to_ask_stops(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    import io

    world = PandaWorld(interventions=Help.ASK)
    monkeypatch.setattr("sys.stdin", io.StringIO("\n"))
    world.builder.ask_for_help("block_01", "jammed")
    assert "block block_01: jammed" in capsys.readouterr().err
    with pytest.raises(Stopped, match="nobody is at the terminal"):
        world.builder.ask_for_help("block_01", "jammed")
    world.close()


def test_a_dropped_block_is_fetched_again(
    exact_world: PandaWorld, graspable: BlockSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The hand opens by mistake while it carries the first block."""
    builder = exact_world.builder
    reality = exact_world.simulated
    follow, slips = reality.follow, iter([False, False, False, True])

    def clumsy(path: np.ndarray, speed: float) -> None:
        follow(path, speed)
        if next(slips, False):
            reality.release()

    monkeypatch.setattr(reality, "follow", clumsy)
    tower = Towers(graspable, np.array([[0, 1]]), np.zeros((1, 2), int), np.zeros((1, 2, 2)))
    outcome = exact_world.attempt(tower, np.random.default_rng(0))
    assert outcome.report is not None
    outcomes = [entry.get("outcome") for entry in outcome.report["entries"]]
    assert outcomes[:2] == ["dropped", "done"]
    assert outcome.labels.tolist() == [1, 1]
    must_be_home(builder)
