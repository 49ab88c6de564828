"""The robot knows reality through its hardware alone, and copes when hardware or towers fail."""

import ast
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import apf.panda
from apf.panda import PandaWorld
from apf.panda.geometry import moved, pose
from apf.panda.hardware import Refused
from apf.towers import BlockSet, Towers

ROOM = Path(apf.panda.__file__).parent
MIND = ("robot", "builder", "planner", "stations", "motion", "tasks", "vision/eyes", "vision/detection", "vision/watch")
"""Modules that decide what the robot does, and what the labels are."""
TRUTH = {"client", "pose_of", "state", "drawn", "photographer", "getBaseVelocity"}
"""Attributes by which reality could be read."""


@pytest.mark.parametrize("module", MIND)
def test_no_module_of_the_mind_knows_reality(module: str) -> None:
    tree = ast.parse((ROOM / f"{module}.py").read_text())
    imported = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    imported += [name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names]
    assert not [name for name in imported if name.startswith(("apf.panda.reality", "apf.panda.flaws", "pybullet"))]
    assert not [node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute) and node.attr in TRUTH]


def two_or_three(blocks: BlockSet, n: int) -> Towers:
    """The first blocks of the set on each other, their middles in line."""
    return Towers(blocks, np.arange(n)[None], np.zeros((1, n), int), np.zeros((1, n, 2)))


@pytest.fixture
def recorded(world: PandaWorld, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """All paths that the arm follows, and all images."""
    assert world.builder
    reality, found = world.simulated, []
    follow, images = reality.follow, reality.images

    def keeping_paths(path: np.ndarray, speed: float) -> None:
        found.append(path.copy())
        follow(path, speed)

    def keeping_images(names: Collection[str]) -> dict[str, np.ndarray]:
        taken = images(names)
        found.extend(taken.values())
        return taken

    monkeypatch.setattr(reality, "follow", keeping_paths)
    monkeypatch.setattr(reality, "images", keeping_images)
    return found


@pytest.mark.slow
def test_no_decision_depends_on_the_truth(
    world: PandaWorld, graspable: BlockSet, recorded: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The account is told nonsense; all motions, images and labels are the same to the last bit."""
    tower = two_or_three(graspable, 2)
    honest = world.attempt(tower, np.random.default_rng(0))
    before = recorded.copy()
    recorded.clear()
    monkeypatch.setattr(world.builder.robot, "witness", lambda block: pose((9.0, 9.0, 9.0)))
    lied_to = world.attempt(tower, np.random.default_rng(0))
    assert honest.labels.tolist() == lied_to.labels.tolist() == [1, 1]
    assert len(before) == len(recorded) > 20
    for one, other in zip(before, recorded):
        np.testing.assert_array_equal(one, other)
    assert honest.report is not None
    assert lied_to.report is not None
    assert honest.report["believed"] == lied_to.report["believed"]
    assert max(entry["error"] for entry in honest.report["entries"]) < 0.02
    assert min(entry["error"] for entry in lied_to.report["entries"]) > 9


@pytest.fixture
def knock(world: PandaWorld, monkeypatch: pytest.MonkeyPatch) -> Callable[[int, int], None]:
    """`knock(block, motion)`: somebody takes a block away when the arm begins its motion of that number."""

    def knock(block: int, motion: int) -> None:
        assert world.builder
        reality, count = world.simulated, iter(range(10_000))
        follow = reality.follow

        def disturbed(path: np.ndarray, speed: float) -> None:
            if next(count) == motion:
                reality.put(block, moved(world.builder.homes[block], (0.0, 0.12, 0.0)))
            follow(path, speed)

        monkeypatch.setattr(reality, "follow", disturbed)

    return knock


@pytest.mark.slow
def test_what_falls_after_its_judgement_is_charged_to_its_own_placement(
    world: PandaWorld, graspable: BlockSet, knock: Callable[[int, int], None]
) -> None:
    """Seven motions bring a block and draw back. The second block goes while the third one is fetched."""
    knock(1, 15)
    outcome = world.attempt(two_or_three(graspable, 3), np.random.default_rng(0))
    assert outcome.labels.tolist() == [1, 0, -1]
    assert outcome.report is not None
    assert (outcome.report["outcome"], outcome.report["sure"]) == ("fell", "while carrying")
    assert [entry.get("outcome") for entry in outcome.report["entries"] if entry["purpose"] == "build"][-1] == "in vain"


@pytest.mark.slow
def test_what_falls_at_once_is_seen(world: PandaWorld, graspable: BlockSet, knock: Callable[[int, int], None]) -> None:
    """The block that was just let go goes while the arm draws back."""
    knock(1, 11)
    outcome = world.attempt(two_or_three(graspable, 2), np.random.default_rng(0))
    assert outcome.labels.tolist() == [1, 0]
    assert outcome.report is not None
    assert outcome.report["outcome"] == "fell"
    assert outcome.report["sure"] in ("seen", "unseen")


@pytest.mark.slow
def test_cameras_that_answer_nothing_for_a_while(
    world: PandaWorld, graspable: BlockSet, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One of the cameras beside the table is dead; the one on the hand misses every third image."""
    assert world.builder
    reality, count = world.simulated, iter(range(10_000))
    images = reality.images

    def failing(names: Collection[str]) -> dict[str, np.ndarray]:
        lost = {"left", *(["wrist"] if next(count) % 3 == 0 else [])}
        return images([name for name in names if name not in lost])

    monkeypatch.setattr(reality, "images", failing)
    outcome = world.attempt(two_or_three(graspable, 2), np.random.default_rng(0))
    assert outcome.report is not None
    assert outcome.labels[0] == 1
    assert capsys.readouterr().err.count("camera left does not answer") == 1, "once"


@pytest.mark.slow
def test_a_refused_motion_is_tried_again(
    world: PandaWorld, graspable: BlockSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert world.builder
    reality, refusals = world.simulated, iter([False, False, True])
    follow = reality.follow

    def stubborn(path: np.ndarray, speed: float) -> None:
        if next(refusals, False):
            raise Refused("joint 3 is too fast")
        follow(path, speed)

    monkeypatch.setattr(reality, "follow", stubborn)
    outcome = world.attempt(two_or_three(graspable, 2), np.random.default_rng(0))
    assert outcome.labels.tolist() == [1, 1]
    assert outcome.report is not None
    assert outcome.report["entries"][0]["outcome"] == "refused: joint 3 is too fast"
