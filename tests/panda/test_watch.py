"""Cameras that fail, and markers that are there twice: one line each, and the robot goes on or stops safely."""

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest

import apf.panda.vision.markers as markers
from apf.errors import Stopped
from apf.panda import PandaWorld
from apf.panda.builder import Builder
from apf.panda.layout import Layout
from apf.panda.settings import Sight
from apf.panda.vision import Cameras, Eyes
from apf.panda.vision.cameras import LEFT, RIGHT, STATIC, WRIST
from apf.panda.vision.studio import Studio
from apf.panda.vision.watch import Watch
from apf.towers import BlockSet, Towers

CAMERAS = Cameras().named()
PLACES = {name: camera.mounting for name, camera in CAMERAS.items()}


@dataclass
class Failing:
    """Hardware of which no more is used than cameras and clock. dead: these do not answer, up to a time [s]."""

    pictures: dict[str, np.ndarray]
    dead: dict[str, float] = field(default_factory=dict)
    time: float = 0.0

    def wait(self, seconds: float) -> None:
        self.time += seconds

    def images(self, names: Collection[str]) -> dict[str, np.ndarray]:
        return {name: self.pictures[name] for name in names if self.time >= self.dead.get(name, 0.0)}


@pytest.fixture(scope="module")
def studio() -> Iterator[Studio]:
    studio = Studio(Layout())
    yield studio
    studio.close()


def pictures(studio: Studio, blocks: BlockSet) -> dict[str, np.ndarray]:
    """What the cameras beside the table see of blocks at home."""
    studio.prepare(blocks)
    studio.set(Layout().home_poses(blocks.dims), np.zeros(7), (0.04, 0.04))
    return {name: studio.photograph(CAMERAS[name], PLACES[name], np.random.default_rng(0)) for name in STATIC}


def blank(name: str) -> np.ndarray:
    return np.full((CAMERAS[name].height, CAMERAS[name].width), 200, np.uint8)


def test_a_camera_that_answers_late_is_waited_for(studio: Studio, graspable: BlockSet) -> None:
    said: list[str] = []
    hardware = Failing(pictures(studio, graspable), {LEFT: 1.4})
    seen = Watch(Sight(), said.append).look(hardware, Eyes(CAMERAS, graspable), STATIC, PLACES)  # type: ignore[arg-type]
    assert seen.seen.all()
    assert hardware.time == 1.5
    assert said == []


def test_a_camera_that_does_not_answer_is_done_without(studio: Studio, graspable: BlockSet) -> None:
    """It is named once, nobody waits for it again, and it is used again when it answers."""
    said: list[str] = []
    watch, eyes = Watch(Sight(), said.append), Eyes(CAMERAS, graspable)
    hardware = Failing(pictures(studio, graspable), {LEFT: 100.0})
    for _ in range(3):
        assert watch.look(hardware, eyes, STATIC, PLACES).markers.sum() > 0  # type: ignore[arg-type]
    assert hardware.time == 2.5
    assert said == ["camera left does not answer, asked 6 times in 2.5 s; the robot goes on without it"]
    hardware.time = 100.0
    watch.look(hardware, eyes, STATIC, PLACES)  # type: ignore[arg-type]
    assert said[1:] == ["camera left answers again"]
    hardware.dead = {WRIST: 200.0}
    assert not watch.look(hardware, eyes, [WRIST], PLACES).seen.any()  # type: ignore[arg-type]
    assert said[2].startswith("camera wrist does not answer")


def test_without_any_camera_beside_the_table_the_run_stops(graspable: BlockSet) -> None:
    watch, hardware = Watch(Sight(), print), Failing({}, {LEFT: 100.0, RIGHT: 100.0})
    with pytest.raises(Stopped, match=r"no camera beside the table answers \(left, right\); it takes one"):
        watch.look(hardware, Eyes(CAMERAS, graspable), STATIC, PLACES)  # type: ignore[arg-type]


def test_after_many_images_without_markers_the_run_stops(studio: Studio, graspable: BlockSet) -> None:
    """Some are nothing: what is seen in between counts anew, and the hand's camera often sees nothing."""
    watch, eyes = Watch(Sight(blind=3), print), Eyes(CAMERAS, graspable)
    dark, light = Failing({name: blank(name) for name in CAMERAS}), Failing(pictures(studio, graspable))
    for hardware in (dark, dark, light, dark, dark):
        watch.look(hardware, eyes, STATIC, PLACES)  # type: ignore[arg-type]
        watch.look(dark, eyes, [WRIST], PLACES)  # type: ignore[arg-type]
    with pytest.raises(Stopped, match="cameras left, right: no block's marker was seen in 3 looks in a row"):
        watch.look(dark, eyes, STATIC, PLACES)  # type: ignore[arg-type]


def test_two_blocks_with_the_same_marker_are_named(
    studio: Studio, graspable: BlockSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The upper face of block 2 carries the marker of that of block 0: 4, not 16. Both are seen by their other faces.

    A marker that is there twice in some looks only is a misreading.
    """
    right = pictures(studio, graspable)
    draw = markers.marker_image
    monkeypatch.setattr(markers, "marker_image", lambda number, cell=1: draw(4 if number == 16 else number, cell))
    other = BlockSet(tuple("abcd"), graspable.dims, graspable.com, graspable.mass)
    wrong = pictures(studio, other)
    said: list[str] = []
    watch, eyes = Watch(Sight(), said.append), Eyes(CAMERAS, other)
    for images in (wrong, wrong, right):
        seen = watch.look(Failing(images), eyes, STATIC, PLACES)  # type: ignore[arg-type]
        assert seen.seen.all()
    assert said == []
    for _ in range(3):
        watch.look(Failing(wrong), eyes, STATIC, PLACES)  # type: ignore[arg-type]
    assert said
    for line in said:
        assert "sees marker 4, of block a, twice: on block a and on block c; it is left out" in line
        assert "python -m apf.panda.sheets" in line
    assert len(said) == len({line.split()[1] for line in said}), "once for each camera"


def test_a_block_that_cannot_be_seen_is_put_home_once(
    scene: Callable[[np.ndarray], Builder], graspable: BlockSet, world: PandaWorld, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its markers are gone: a person is asked for it once, and it is assumed to be home."""
    builder = scene(world.layout.home_poses(graspable.dims))
    monkeypatch.setattr("apf.panda.vision.eyes.sorted_out", without(3))
    builder.tidy()
    assert [(entry.block, entry.outcome) for entry in builder.robot.account.entries] == [
        (graspable.name[3], "not seen")
    ]


def without(block: int) -> Callable[[list], tuple[list, list]]:
    return lambda found: ([each for each in found if each.block != block], [])


@pytest.mark.slow
def test_first_images_without_markers(world: PandaWorld, graspable: BlockSet, monkeypatch: pytest.MonkeyPatch) -> None:
    """The blocks are assumed to be at home, and the tower is built; in the dark the run stops before it tells a lie."""
    tower = Towers(graspable, np.arange(2)[None], np.zeros((1, 2), int), np.zeros((1, 2, 2)))
    assert world.builder
    images, count = world.simulated.images, iter(range(1000))

    def dark_at_first(names: Collection[str]) -> dict[str, np.ndarray]:
        return {name: blank(name) for name in names} if next(count) < 1 else images(names)

    monkeypatch.setattr(world.simulated, "images", dark_at_first)
    assert world.attempt(tower, np.random.default_rng(0)).labels.tolist() == [1, 1]
    monkeypatch.setattr(world.simulated, "images", lambda names: {name: blank(name) for name in names})
    with pytest.raises(Stopped, match="no block's marker was seen"):
        world.attempt(tower, np.random.default_rng(0))
