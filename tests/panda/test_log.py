"""The log tells what happened, and nothing happens otherwise because of it."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from apf.domain import Outcome, carry_out
from apf.errors import InputError
from apf.panda import PandaWorld
from apf.panda.commands.show import stem_of
from apf.panda.geometry import from_vector
from apf.panda.hardware import Refused
from apf.panda.kinematics import REST
from apf.panda.layout import Layout
from apf.panda.log import BELIEVED, ERROR, JOINTS, TRUE, WARNING, Content, Log
from apf.panda.vision.cameras import Cameras
from apf.towers import BlockSet, Towers
from panda.conftest import CALIBRATED

Messages = dict[str, list[tuple[float, Any]]]
"""(time [s], message) by topic."""


def read(path: Path) -> Messages:
    found: Messages = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            found.setdefault(channel.topic, []).append((message.log_time / 1e9, decoded))
    return found


def events(messages: Messages) -> list[str]:
    return [event.message for _, event in messages["/events"]]


def frames(messages: Messages, name: str) -> list[tuple[float, np.ndarray]]:
    """(time, pose [4, 4]) of a frame."""
    found = []
    for at, message in messages["/transforms"]:
        for each in message.transforms:
            if each.child_frame_id == name:
                t, r = each.translation, each.rotation
                found.append((at, from_vector((t.x, t.y, t.z, r.x, r.y, r.z, r.w))))
    return found


@pytest.fixture(scope="module")
def falling(graspable: BlockSet) -> Towers:
    """The second block has its middle far outside the first one."""
    return Towers(graspable, np.array([[2, 0]]), np.zeros((1, 2), int), np.array([[[0, 0], [0.05, 0]]]))


@pytest.fixture(scope="module")
def logging_world() -> Iterator[PandaWorld]:
    """As the robot without a log, which keeps everything."""
    world = PandaWorld(flaws=CALIBRATED, log=Content.IMAGES)
    yield world
    world.close()


@pytest.fixture
def logging_motion() -> Iterator[PandaWorld]:
    """As the same, which keeps no images."""
    world = PandaWorld(flaws=CALIBRATED, log=Content.MOTION)
    yield world
    world.close()


@pytest.fixture(scope="module")
def unlogged(world: PandaWorld, falling: Towers) -> tuple[Outcome, list[np.ndarray]]:
    """What comes of the tower, and all images, without a log."""
    return attempted(world, falling, None)


@pytest.fixture(scope="module")
def logged(
    logging_world: PandaWorld, falling: Towers, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Outcome, list[np.ndarray], Path]:
    """The same with one that holds everything."""
    path = tmp_path_factory.mktemp("logs") / "new" / "8"
    return *attempted(logging_world, falling, path), path.with_suffix(".mcap")


def attempted(world: PandaWorld, tower: Towers, log: Path | None) -> tuple[Outcome, list[np.ndarray]]:
    assert world.builder
    reality, taken = world.simulated, []
    images = reality.images

    def keeping(names: Collection[str]) -> dict[str, np.ndarray]:
        found = images(names)
        taken.extend(found.values())
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reality, "images", keeping)
        return carry_out(world, tower, np.random.default_rng(0), None, "the tower", None, log), taken


@pytest.mark.slow
def test_a_log_changes_nothing(
    unlogged: tuple[Outcome, list[np.ndarray]],
    logged: tuple[Outcome, list[np.ndarray], Path],
    logging_world: PandaWorld,
) -> None:
    """Labels, images, and where the blocks end up, bit for bit; and the robot has its own hardware back."""
    without, images = unlogged
    outcome, same, _ = logged
    assert outcome.labels.tolist() == without.labels.tolist() == [1, 0]
    assert without.report is not None
    assert outcome.report is not None
    for key in ("outcome", "blocks", "believed", "sure"):
        assert outcome.report[key] == without.report[key]
    assert len(images) == len(same) > 10
    for one, other in zip(images, same):
        np.testing.assert_array_equal(one, other)
    assert logging_world.builder.robot.hardware is logging_world.simulated
    assert logging_world.simulated.on_step == logging_world.builder.on_judged == []


@pytest.mark.slow
def test_times_never_go_back(logged: tuple[Outcome, list[np.ndarray], Path]) -> None:
    for topic, messages in read(logged[2]).items():
        times = [at for at, _ in messages]
        assert times == sorted(times), topic


@pytest.mark.slow
def test_joints_are_sampled_all_the_time(logged: tuple[Outcome, list[np.ndarray], Path], world: PandaWorld) -> None:
    joints = read(logged[2])["/joints"]
    times = np.array([at for at, _ in joints])
    np.testing.assert_allclose(np.diff(times), 0.1, atol=2 / world.simulated.rate)
    assert times[-1] > 20
    assert [state.name for state in joints[0][1].joints] == list(JOINTS)
    np.testing.assert_allclose([state.position for state in joints[0][1].joints[:7]], REST, atol=0.01)
    width = [2 * message.joints[7].position for _, message in joints]
    assert 0.079 < max(width) < 0.081
    assert 0.03 < min(width) < 0.075, "as wide as a block"


@pytest.mark.slow
def test_all_images_are_there(logged: tuple[Outcome, list[np.ndarray], Path]) -> None:
    messages = read(logged[2])
    kept = [each for name in ("left", "right", "wrist") for each in messages[f"/cameras/{name}/image"]]
    assert len(kept) == len(logged[1])
    first = cv2.imdecode(np.frombuffer(messages["/cameras/left/image"][0][1].data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert np.abs(first.astype(int) - logged[1][0]).mean() < 4, "but for JPEG's losses"
    calibration = messages["/cameras/wrist/calibration"][0][1]
    assert (calibration.width, calibration.height, calibration.K[0], calibration.frame_id) == (640, 480, 450, "wrist")


@pytest.mark.slow
def test_what_happened_is_told_in_order(logged: tuple[Outcome, list[np.ndarray], Path], graspable: BlockSet) -> None:
    messages = read(logged[2])
    told = events(messages)
    lower, upper = graspable.name[2], graspable.name[0]
    order = [
        f"build: block {lower}",
        next(line for line in told if line.startswith("gripped: ")),
        "released",
        next(line for line in told if line.startswith(f"build: block {lower}: done (")),
        "placement 1 of 2: stood",
        f"build: block {upper}",
        "placement 2 of 2: fell (seen)",
    ]
    places = [told.index(line) for line in order]
    assert places == sorted(places)
    assert [event.message for _, event in messages["/events"] if event.level == ERROR] == [order[-1]]
    assert [line for line in told[places[-1] :] if line.startswith("tidy: ")]


@pytest.mark.slow
def test_poses_end_where_the_report_says(logged: tuple[Outcome, list[np.ndarray], Path], graspable: BlockSet) -> None:
    messages, report = read(logged[2]), logged[0].report
    assert report is not None
    for name in graspable.name:
        for kind, key in ((TRUE, "blocks"), (BELIEVED, "believed")):
            last = frames(messages, f"{kind}/{name}")[-1][1]
            np.testing.assert_allclose(last, from_vector(report[key][name]), atol=2e-4)
    fell = next(at for at, event in messages["/events"] if event.level == ERROR)
    height = {at: where[2, 3] for at, where in frames(messages, f"{TRUE}/{graspable.name[0]}")}
    assert max(height.values()) > 0.1
    assert max(z for at, z in height.items() if fell - 0.9 < at < fell) < 0.09, "it lay on the table when it was judged"


@pytest.mark.slow
def test_motion_alone_is_small(logging_motion: PandaWorld, falling: Towers, tmp_path: Path) -> None:
    """And what was there is replaced."""
    path = tmp_path / "8.mcap"
    path.write_bytes(bytes(10_000_000))
    attempted(logging_motion, falling, path.with_suffix(""))
    assert "/joints" in read(path)
    assert not [topic for topic in read(path) if topic.endswith("/image")]
    assert path.stat().st_size < 100_000


def test_a_log_ends_with_what_stopped_the_run(
    logging_motion: PandaWorld, falling: Towers, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = logging_motion
    assert world.builder

    def refuse(path: np.ndarray, speed: float) -> None:
        raise Refused("joint 3 is too fast")

    def broken() -> None:
        raise RuntimeError("no air")

    monkeypatch.setattr(world.simulated, "follow", refuse)
    monkeypatch.setattr(world.simulated, "release", broken)
    with pytest.raises(Exception, match="no air"):
        attempted(world, falling, tmp_path / "8")
    messages = read(tmp_path / "8.mcap")
    assert "the arm refused a motion: joint 3 is too fast" in events(messages)
    assert {event.level for _, event in messages["/events"]} >= {WARNING}


def test_where_no_log_can_be_written(graspable: BlockSet, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        Log(tmp_path / "file" / "8.mcap", graspable, Cameras().named(), Layout())


def test_another_ending_is_refused() -> None:
    with pytest.raises(InputError, match=r"log=tower.bag: the ending must be \.mcap"):
        stem_of(Path("tower.bag"))
    assert stem_of(None) is None
