"""The robot world in an experiment, and the commands that use it."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
import pandas as pd
import pytest
import yaml
from hydra import compose, initialize_config_dir

from apf.config.values import config_dir
from apf.panda import PandaWorld
from apf.schema import validate
from apf.towers import BlockSet, NoisyWorld, Towers, write_blocks, write_towers
from integration.command_line import CONF, TINY, call, child_environment, spawn

ROBOT = (*TINY, "world=panda", "sampler=incremental", "plans=11", "evaluation.every=9")
"""Eight initial towers, then three by the robot, in two acquisitions."""
TIMES = ["wall", "processor", "planning"]


def reports(run: Path) -> list[tuple[int, dict]]:
    """(tower, report) of every label in a run's journal that has one."""
    records = [json.loads(line) for line in (run / "journal.jsonl").read_text().splitlines() if line.endswith("}")]
    return [(record["plan"], record["report"]) for record in records if "report" in record]


@pytest.mark.slow
def test_a_killed_run_ends_as_one_that_was_not(tmp_path: Path) -> None:
    """The one that was not keeps a log of each tower that the robot builds, too."""
    whole, stopped = tmp_path / "whole", tmp_path / "stopped"
    result = spawn(["-m", "apf.main", *ROBOT, "world.log=motion", f"hydra.run.dir={whole}"], cwd=tmp_path).must_work()
    assert {path.name for path in (whole / "logs").iterdir()} == {"8.mcap", "9.mcap", "10.mcap"}
    assert "argv[0]" not in result.out + result.err
    assert "world: pick_and_places" in result.err
    assert [tower for tower, _ in reports(whole)] == [8, 9, 10], "the first eight are labelled in the noisy world"

    command = [sys.executable, "-m", "apf.main", *ROBOT, f"hydra.run.dir={stopped}"]
    with subprocess.Popen(command, cwd=tmp_path, env=child_environment(), stderr=subprocess.DEVNULL) as process:
        while process.poll() is None and not ((stopped / "journal.jsonl").exists() and reports(stopped)):
            time.sleep(0.05)
        process.send_signal(signal.SIGKILL)
    assert len(reports(stopped)) < 3
    spawn(["-m", "apf.main", f"resume={stopped}"], cwd=tmp_path, PYTHONHASHSEED="7").must_work()
    for name in ("plans", "regret", "accuracy", "world"):
        one, other = (pd.read_parquet(run / f"{name}.parquet") for run in (whole, stopped))
        times = [column for column in TIMES if column in one]
        pd.testing.assert_frame_equal(one.drop(columns=times), other.drop(columns=times), check_exact=True)
    assert [report["blocks"] for _, report in reports(whole)] == [report["blocks"] for _, report in reports(stopped)]


def test_the_robot_is_loaded_only_where_it_is_chosen(tmp_path: Path) -> None:
    code = "import apf.main, sys; sys.exit('pybullet' in sys.modules)"
    spawn(["-c", code], cwd=tmp_path).must_work()


@pytest.mark.parametrize(("missing", "extra"), [("frankik", "panda"), ("mujoco", "mujoco")])
def test_what_is_not_installed_is_named(missing: str, extra: str, tmp_path: Path) -> None:
    code = f"import sys; sys.modules['{missing}'] = None; from apf.main import main; main()"
    result = spawn(["-c", code, "world=panda", "world/reality=mujoco", "hydra.run.dir=run"], cwd=tmp_path)
    result.must_refuse("world", f"needs {missing}", f"pip install 'apf[{extra}]'")


def test_the_paper_s_experiment_is_the_default() -> None:
    with initialize_config_dir(config_dir(), version_base="1.3"):
        config = validate(compose("config", ["world=panda", "sampler=incremental"]))
    assert isinstance(config.world.initial_world, NoisyWorld)
    assert config.sampler.initial.max == 2
    assert (config.initial.train, config.acquisition.plans, config.plans) == (40, 10, 400)
    assert config.domain.training_blocks.dims.max() <= 0.075
    assert config.domain.evaluation_blocks.dims.max() <= 0.075


def test_values_given_win_over_what_the_world_needs() -> None:
    with initialize_config_dir(config_dir(), version_base="1.3"):
        cfg = compose("config", ["world=panda", "domain.training.com_share=0.1", "domain.training.side=[0.05,0.06]"])
    assert cfg.domain.training.com_share == 0.1
    assert list(cfg.domain.evaluation.side) == [0.05, 0.06]


def test_the_config_says_what_the_classes_do() -> None:
    values = yaml.safe_load((CONF / "world" / "panda.yaml").read_text())
    world = PandaWorld()
    for group in ("layout", "arm", "gripper", "reach", "motion", "search", "sight", "handling", "judging"):
        part = getattr(world, group)
        for key, value in values[group].items():
            default = getattr(part, key)
            assert value == (list(default) if isinstance(default, tuple) else default), f"{group}.{key}"
        assert set(values[group]) == set(part.__dataclass_fields__), group
    rest = {"initial", "cameras"}
    assert set(values) - {"_target_", "defaults", *rest} == set(world.__dataclass_fields__) - {
        "_open",
        "_logs",
        "reality",
        "flaws",
        *rest,
    }


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (("world=panda", "domain.training.side=[0.09,0.1]"), ("world", "block train_0", "gripper takes", "0.075")),
        (("+world@evaluation.worlds.panda=panda",), ("evaluation.worlds.panda", "block novel_0", "shortest side")),
        (("world=panda", "sampler.candidates.longest=10"), ("world", "m high", "reaches")),
        (("world=panda", "domain.training.blocks=11"), ("world", "11 blocks", "places for 10")),
        (("world=panda", "world.layout.base=[1.5,0]"), ("world.layout", "base", "x is 1.5", "0.87")),
        (
            ("world=panda", "world.cameras.left.focal=200", "world.cameras.right.focal=200"),
            ("world: camera", "block train_", "pixels wide", "at least 12", "larger blocks"),
        ),
        (("world=panda", "world.cameras.left.focal=0"), ("world.cameras.left.focal",)),
        (("world=panda", "world.cameras.left.target=[0.95,0.75,0.75]"), ("world.cameras.left", "another point")),
        (("world=panda", "world.hold=glue"), ("world.hold", "friction", "constraint")),
        (("world=panda", "world.interventions=never"), ("world.interventions", "auto", "ask", "stop")),
        (("world=panda", "+world.motion.nonsense=1"), ("world.motion.nonsense", "no such key")),
    ],
)
def test_bad_input_is_refused_in_one_line(overrides: tuple[str, ...], words: tuple[str, ...], here: Path) -> None:
    call(*TINY, "sampler=incremental", *overrides, "hydra.run.dir=run").must_refuse(*words)
    assert list(here.iterdir()) == []


@pytest.fixture
def tower_file(here: Path, graspable: BlockSet) -> Path:
    """A tower of two blocks, and one of three that is out of reach."""
    good = Towers(graspable, np.array([[2, 0]]), np.array([[0, 9]]), np.zeros((1, 2, 2)))
    far = Towers(graspable, np.array([[0, 1, 2]]), np.zeros((1, 3), int), np.full((1, 3, 2), 0.45))
    write_towers([good, far], here / "towers.csv")
    return here / "towers.csv"


@pytest.mark.slow
def test_a_film_and_its_stills(tower_file: Path, here: Path) -> None:
    small = ("camera.width=64", "camera.height=48", "camera.fps=5", "log=film.mcap", "world.log=motion")
    result = call(f"tower={tower_file}", "out=film.mp4", *small, command="apf.panda.show").must_work()
    assert result.out == "film.mp4, film.png: stood, labels 1 1\n"
    assert imageio.imread("film.png").shape == (48, 3 * 64, 3)
    assert Path("film.mcap").read_bytes().startswith(b"\x89MCAP")
    frames = list(imageio.get_reader("film.mp4").iter_data())
    assert len(frames) > 20
    assert np.ptp(frames[0]) > 50, "there is something to see"
    assert any((frame != frames[0]).any() for frame in frames)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("out=film.avi",), ("film.avi", ".mp4 or .gif")),
        (("log=film.bag",), ("log=film.bag", ".mcap")),
        (("number=2",), ("number=2", "2 towers")),
        (("number=1",), ("block", "from the robot; it reaches")),
        (("tower=none.csv",), ("none.csv", "no such file")),
        (("world=noisy",), ("world.gui", "no such key")),
        (("gui=true",), ("gui=true", "display")),
    ],
)
def test_show_refuses(
    arguments: tuple[str, ...], words: tuple[str, ...], tower_file: Path, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    call(f"tower={tower_file}", *arguments, command="apf.panda.show").must_refuse(*words)
    assert {path.name for path in here.iterdir()} == {"towers.csv"}


def test_label_asks_the_robot(here: Path, graspable: BlockSet) -> None:
    wide = BlockSet(("wide",), np.full((1, 3), 0.1), np.zeros((1, 3)), np.ones(1))
    write_towers(Towers(wide, np.zeros((1, 1), int), np.zeros((1, 1), int), np.zeros((1, 1, 2))), "wide.csv")
    call("plans=wide.csv", "out=out.csv", "world=panda", command="apf.label").must_refuse("block wide", "0.100 m")


@pytest.mark.slow
def test_a_chosen_tower_is_built_by_the_robot_for_its_reward(here: Path, graspable: BlockSet) -> None:
    write_blocks(graspable, "blocks.csv")
    call(
        *TINY,
        "plans=8",
        "+world@evaluation.worlds.panda=panda",
        "domain.evaluation.file=blocks.csv",
        "task=[tallest]",
        "hydra.run.dir=run",
    ).must_work()
    regret = pd.read_parquet("run/regret.parquet")
    assert sorted(regret["world"]) == ["analytic", "noisy", "panda"]
    assert not (here / "run" / "world.parquet").exists()
