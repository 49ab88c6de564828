"""What reality does that the robot does not know: drawn once for a robot, of the size that is configured."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from hypothesis import given
from hypothesis import strategies as st

from apf.config.values import config_dir
from apf.panda.flaws import Drawn, Flaws
from apf.panda.geometry import angle, distance
from apf.panda.vision.cameras import STATIC, WRIST, Cameras
from apf.rng import stream
from apf.schema import validate
from apf.towers import BlockSet, BlockSource

CAMERAS = Cameras().named()
ALL = Flaws(
    joints=0.2,
    hand_eye=0.002,
    hand_eye_turn=0.3,
    static=0.004,
    static_turn=0.1,
    mass=0.1,
    com=0.001,
    friction=0.8,
    friction_spread=0.1,
)
ROBOTS = 300


def robots(flaws: Flaws) -> list[Drawn]:
    return [replace(flaws, seed=seed).drawn(CAMERAS) for seed in range(ROBOTS)]


def test_without_flaws_all_is_as_believed(graspable: BlockSet) -> None:
    drawn = Flaws().drawn(CAMERAS)
    assert not drawn.zeros.any()
    for name, camera in CAMERAS.items():
        np.testing.assert_array_equal(drawn.mounted[name], camera.mounting)
    real = drawn.blocks(graspable)
    for one, other in ((real.mass, graspable.mass), (real.com, graspable.com), (real.dims, graspable.dims)):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(drawn.friction(graspable), np.ones(len(graspable)))
    assert not drawn.on_release(np.ones(3), np.ones(3), stream(0, "test")).any()


def test_a_robot_is_drawn_once(graspable: BlockSet) -> None:
    one, same, other = (replace(ALL, seed=seed).drawn(CAMERAS) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.zeros, same.zeros)
    assert (one.zeros != other.zeros).all()
    for name in CAMERAS:
        np.testing.assert_array_equal(one.mounted[name], same.mounted[name])
        assert (one.mounted[name][:3, 3] != other.mounted[name][:3, 3]).all()
    np.testing.assert_array_equal(one.blocks(graspable).com, one.blocks(graspable).com)
    assert (one.blocks(graspable).mass != other.blocks(graspable).mass).all()
    assert (one.friction(graspable) != other.friction(graspable)).all()


def test_each_set_of_blocks_has_its_own_draws(graspable: BlockSet) -> None:
    others = BlockSource(blocks=4, seed=9, side=(0.04, 0.075), mass=(0.06, 0.21), com_share=0.6).load()
    drawn = ALL.drawn(CAMERAS)
    factors = [drawn.blocks(blocks).mass / blocks.mass for blocks in (graspable, others)]
    assert (factors[0] != factors[1]).all()


@pytest.mark.parametrize("more", [{"hand_eye": 0.01}, {"static": 0.0, "static_turn": 0.0}, {"mass": 0.5}])
def test_a_flaw_does_not_change_the_draws_of_another(more: dict[str, float], graspable: BlockSet) -> None:
    """So that a comparison of two presets compares one robot with itself."""
    one, other = ALL.drawn(CAMERAS), replace(ALL, **more).drawn(CAMERAS)
    np.testing.assert_array_equal(one.zeros, other.zeros)
    np.testing.assert_array_equal(one.blocks(graspable).com, other.blocks(graspable).com)
    if "hand_eye" not in more:
        np.testing.assert_array_equal(one.mounted[WRIST], other.mounted[WRIST])


def test_the_flaws_of_many_robots_have_the_size_that_is_configured(graspable: BlockSet) -> None:
    drawn = robots(ALL)
    zeros = np.array([robot.zeros for robot in drawn])
    assert np.rad2deg(zeros.std()) == pytest.approx(0.2, rel=0.08)
    for name, shift, turn in ((WRIST, 0.002, 0.3), *((name, 0.004, 0.1) for name in STATIC)):
        believed = CAMERAS[name].mounting
        offsets = np.array([(robot.mounted[name] - believed)[:3, 3] for robot in drawn])
        np.testing.assert_allclose(offsets.std(0), shift, rtol=0.2)
        turns = [angle(robot.mounted[name], believed) for robot in drawn]
        assert np.rad2deg(np.sqrt(np.mean(np.square(turns)) / 3)) == pytest.approx(turn, rel=0.15)
    masses = np.array([robot.blocks(graspable).mass for robot in drawn]) / graspable.mass
    assert masses.std() == pytest.approx(0.1, rel=0.1)
    coms = np.array([robot.blocks(graspable).com for robot in drawn]) - graspable.com
    assert coms.std() == pytest.approx(0.001, rel=0.1)
    frictions = np.array([robot.friction(graspable) for robot in drawn])
    assert frictions.mean() == pytest.approx(0.8, rel=0.02)
    assert frictions.std() == pytest.approx(0.8 * 0.1, rel=0.1)


def test_a_camera_keeps_what_is_a_pose() -> None:
    for where in ALL.drawn(CAMERAS).mounted.values():
        np.testing.assert_allclose(where[:3, :3] @ where[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(where[:3, :3]) == pytest.approx(1.0)
        np.testing.assert_array_equal(where[3], [0, 0, 0, 1])


@given(st.floats(0, 1), st.floats(0, 1), st.integers(0, 1000))
def test_blocks_stay_possible(mass: float, com: float, seed: int) -> None:
    """However large the flaws are: a block has mass, and its centre of mass lies in it."""
    blocks = BlockSource(blocks=4, seed=0, side=(0.04, 0.075), mass=(0.06, 0.21), com_share=0.6).load()
    real = Flaws(mass=mass, com=com, friction_spread=mass, seed=seed).drawn({})
    assert (real.blocks(blocks).mass > 0).all()
    assert (np.abs(real.blocks(blocks).com) < blocks.dims / 2).all()
    assert (real.friction(blocks) > 0).all()


@pytest.mark.parametrize(
    ("flaws", "moved"),
    [
        (Flaws(slide=0.15), (0.0015, -0.003)),
        (Flaws(drag=0.002), (0.0, 0.002)),
        (Flaws(slide=0.15, drag=0.002), (0.0015, -0.001)),
    ],
)
def test_how_a_block_moves_when_it_is_let_go(flaws: Flaws, moved: tuple[float, float]) -> None:
    """Worked by hand: towards its centre of mass, and along the line on which the fingers close."""
    com, closing = np.array([0.01, -0.02, 0.03]), np.array([0.0, 1.0, 0.0])
    found = flaws.drawn(CAMERAS).on_release(com, closing, stream(0, "test"))
    np.testing.assert_allclose(found, moved, atol=1e-12)


def test_a_jump_is_drawn_at_each_release() -> None:
    drawn, rng = Flaws(release=0.0015).drawn(CAMERAS), stream(0, "test")
    jumps = np.array([drawn.on_release(np.zeros(3), np.zeros(3), rng) for _ in range(1000)])
    np.testing.assert_allclose(jumps.std(0), 0.0015, rtol=0.1)
    assert np.abs(jumps.mean(0)).max() < 0.0002
    assert abs(np.corrcoef(jumps.T)[0, 1]) < 0.1


def preset(*overrides: str) -> Flaws:
    with initialize_config_dir(config_dir(), version_base="1.3"):
        flaws: Flaws = validate(compose("config", ["world=panda", "sampler=incremental", *overrides])).world.flaws
    return flaws


def test_presets() -> None:
    exact, calibrated, worn = (preset(f"world/flaws={name}") for name in ("exact", "calibrated", "worn"))
    assert exact == Flaws()
    assert preset() == calibrated
    for better, worse in ((exact, calibrated), (calibrated, worn)):
        lower, higher = asdict(better), asdict(worse)
        assert lower.pop("friction") >= higher.pop("friction")
        assert lower != higher
        assert all(lower[key] <= higher[key] for key in lower)
    assert preset("world/flaws=worn", "world.flaws.seed=5") == replace(worn, seed=5)


def test_a_calibrated_robot_is_off_by_a_millimetre_or_two() -> None:
    for robot in robots(preset()):
        assert not robot.zeros.any()
        for name, camera in CAMERAS.items():
            assert distance(robot.mounted[name], camera.mounting) < 0.008
            assert angle(robot.mounted[name], camera.mounting) < np.deg2rad(0.8)
