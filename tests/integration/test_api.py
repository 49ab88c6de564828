"""What the package offers a program or a notebook: the same as its commands."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
import yaml
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig

import apf
from apf.errors import InputError
from apf.towers import BlockSource, Towers, stands, write_blocks
from integration.command_line import TINY, call

pytestmark = pytest.mark.usefixtures("no_figures")
QUICK = ["planner.generations=5", "planner.start=300", "planner.candidates=1000"]


@pytest.fixture
def mine(here: Path) -> pd.DataFrame:
    """Six blocks of somebody, as a frame and in `mine.parquet`."""
    write_blocks(BlockSource(blocks=6, seed=9, prefix="mine").load(), here / "mine.parquet")
    return pd.read_parquet("mine.parquet")


@pytest.fixture(scope="module")
def run(tiny_run: Path) -> apf.Run:
    return apf.load_run(tiny_run)


class TestRuns:
    def test_what_a_run_holds(self, run: apf.Run, tiny_run: Path) -> None:
        assert run.config == yaml.safe_load((tiny_run / "config.yaml").read_text())
        assert list(run.tables) == ["accuracy", "evaluation_plans", "plans", "regret"]
        pd.testing.assert_frame_equal(run.tables["regret"], pd.read_parquet(tiny_run / "regret.parquet"))
        assert run.tables["regret"] is run.tables["regret"]
        assert run.steps == [1, 2]
        assert run.finished
        with pytest.raises(KeyError, match="losses; there are accuracy, evaluation_plans, plans, regret"):
            _ = run.tables["losses"]

    def test_the_towers_that_were_labelled(self, run: apf.Run) -> None:
        """Executed again in the world without noise, they get the same labels."""
        assert sum(len(batch.plans) for batch in run.plans) == 12
        for batch in run.plans:
            assert isinstance(batch.plans, Towers)
            np.testing.assert_array_equal(stands(batch.plans), (batch.labels == 1).all(1))

    def test_its_ensembles(self, run: apf.Run) -> None:
        plans = run.plans[-1].plans
        last, first = run.model(), run.model(1)
        np.testing.assert_array_equal(last.feasibility(plans), run.model(2).feasibility(plans))
        assert (last.feasibility(plans) != first.feasibility(plans)).any()
        with pytest.raises(InputError, match=r"step is 7; .* keeps the ensembles of steps 1, 2"):
            run.model(7)

    def test_a_run_from_python_is_that_of_the_command(self, run: apf.Run, here: Path) -> None:
        threads, hydra = torch.get_num_threads(), HydraConfig.instance().cfg
        mine = apf.run([*TINY, "world=analytic"], "runs/mine")
        assert mine.directory == here / "runs" / "mine"
        for name in run.tables:
            pd.testing.assert_frame_equal(mine.tables[name], run.tables[name])
        assert (torch.get_num_threads(), HydraConfig.instance().cfg) == (threads, hydra)
        assert not GlobalHydra.instance().is_initialized()

    def test_going_on(self, here: Path, capsys: pytest.CaptureFixture) -> None:
        """The same call again returns at once; more plans, or `resume`, go on with it."""
        first = apf.run([*TINY, "plans=10"], "mine")
        assert first.steps == [1]
        assert apf.run([*TINY, "plans=10"], "mine") == first
        assert "holds this run already, finished" in capsys.readouterr().err
        longer = apf.run([f"resume={first.directory}", "plans=12"])
        assert longer.directory == first.directory
        assert longer.steps == [1, 2]
        assert Path.cwd() == here

    @pytest.mark.parametrize(
        ("overrides", "said"),
        [
            (["seeed=1"], "seeed: there is no such key; did you mean seed?"),
            (["sampler=best"], "sampler=best"),
            (["plans=many"], "plans is 'many'"),
            (["resume=mine"], "no run there"),
            (["seed=[1"], "cannot be read"),
        ],
    )
    def test_mistakes(self, here: Path, overrides: list[str], said: str) -> None:
        with pytest.raises(InputError) as error:
            apf.run(overrides, None if "resume" in overrides[0] else "mine")
        assert said in str(error.value)
        assert "\n" not in str(error.value)
        assert list(here.iterdir()) == []

    def test_no_run(self, here: Path) -> None:
        with pytest.raises(InputError, match=r"nowhere holds no run: there is no config\.yaml in it"):
            apf.load_run("nowhere")


class TestQuestions:
    def test_a_plan_is_that_of_the_command(self, run: apf.Run, mine: pd.DataFrame) -> None:
        command = ("objects=mine.parquet", "task=tallest", "length=3", "top=2", f"run={run.directory}")
        call(*command, *QUICK, "out=plan.parquet", command="apf.plan").must_work()
        expected = pd.read_parquet("plan.parquet")
        for objects in ("mine.parquet", mine):
            found = apf.plan(objects, "tallest", run=run, length=3, top=2, overrides=QUICK)
            pd.testing.assert_frame_equal(found.table, expected, check_dtype=False)
        assert all(choice.chance < mean for choice, mean in zip(found.choices, found.chances[:, -1], strict=True))

    def test_pictures(self, mine: pd.DataFrame, here: Path) -> None:
        found = apf.plan(mine, "tallest", length=2, top=2, predictor="analytic", overrides=QUICK)
        assert found.save_pictures(Path("a.png")) == [Path("a_0.png"), Path("a_1.png")]
        assert all(path.stat().st_size > 10_000 for path in here.glob("*.png"))

    def test_chances_and_labels_of_plans_frames_and_files(self, run: apf.Run, mine: pd.DataFrame) -> None:
        found = apf.plan(mine, "overhang", run=run, length=3, top=2, overrides=QUICK)
        found.table.to_csv("plans.csv", index=False)
        given = [found.plans, found.table, "plans.csv", Path("plans.csv")]
        chances = [apf.predict(plans, run) for plans in given]
        labels = [apf.label(plans, "noisy", seed=3) for plans in given]
        for each in chances[1:]:
            pd.testing.assert_frame_equal(each, chances[0])
        for each in labels[1:]:
            pd.testing.assert_frame_equal(each, labels[0])
        np.testing.assert_allclose(chances[0]["chance"], found.chances.ravel(), rtol=1e-5)
        np.testing.assert_allclose(chances[0]["deviation"], found.deviations.ravel(), atol=1e-6)
        call("plans=plans.csv", "world=noisy", "seed=3", "out=labels.csv", command="apf.label").must_work()
        pd.testing.assert_frame_equal(pd.read_csv("labels.csv"), labels[0], check_dtype=False)
        bare = found.table[["tower", "position", "block", "x", "y", "z", "qx", "qy", "qz", "qw"]]
        pd.testing.assert_frame_equal(apf.predict(bare, run, objects=mine), chances[0])

    def test_the_domain_is_that_of_the_run(self, here: Path) -> None:
        run = apf.run([*TINY, "domain=packing"], "mine")
        plans = run.plans[0].plans
        assert len(apf.predict(plans, run)) == len(plans) * plans.length
        with pytest.raises(InputError, match="is a run of PackingDomain; domain is TowerDomain"):
            apf.predict(plans, run, overrides=["domain=towers"])

    def test_mistakes(self, run: apf.Run, mine: pd.DataFrame) -> None:
        lengths = list(mine.columns[1:7])
        in_mm = mine.assign(**{name: mine[name] * 1000 for name in lengths})
        questions = {
            "the frame of objects, row 2: block mine_00, .* above 1 m; .* dim_x .mm.": {"objects": in_mm},
            "the frame of objects: column mass is missing": {"objects": mine.drop(columns="mass")},
            "objects: none.csv: no such file": {"objects": "none.csv"},
            "task=oberhang": {"task": "oberhang"},
            "length: towers of 7 blocks need 7 blocks; objects has 6": {"length": 7},
            "stand is 0.99999; no plan was found": {"stand": 0.99999},
            "planer: there is no such key; did you mean planner": {"overrides": ["planer.start=3"]},
            "nowhere holds no run": {"run": "nowhere"},
        }
        for said, changed in questions.items():
            asked = {"objects": mine, "task": "overhang", "run": run, "length": 3, "overrides": QUICK, **changed}
            with pytest.raises(InputError, match=said) as error:
                apf.plan(**asked)
            assert "\n" not in str(error.value)
        with pytest.raises(InputError, match=r"the frame of plans: column .*position"):
            apf.label(pd.DataFrame({"tower": [0]}))


def test_a_command_beside_a_program(here: Path) -> None:
    """`apf.plan` is the function, wherever commands have been used before it."""
    code = (
        "import apf, apf.commands.plan, apf.api; print(callable(apf.plan), callable(apf.label), apf.predict.__name__)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True", "predict"]
