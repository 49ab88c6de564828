"""python -m apf.plan: a plan for somebody's own blocks."""

import re
from pathlib import Path

import numpy as np
import pytest

from apf.commands.plan import plan
from apf.planning import SearchPlanner
from apf.towers import (
    AnalyticPredictor,
    BlockSource,
    Overhang,
    Tallest,
    TowerDomain,
    read_towers,
    stands,
    write_blocks,
)
from integration.command_line import TINY, call

pytestmark = pytest.mark.usefixtures("no_figures")


@pytest.fixture
def mine(here: Path) -> Path:
    """Six blocks of somebody."""
    write_blocks(BlockSource(blocks=6, seed=9, prefix="mine").load(), here / "mine.csv")
    return here / "mine.csv"


def test_who_knows_the_physics_gets_a_tower_that_stands(mine: Path) -> None:
    command = ("objects=mine.csv", "task=overhang", "length=4", "predictor=analytic")
    result = call(*command, "out=mine_plan.csv", command="apf.plan").must_work()
    ((tower,),) = ([batch.plans] for batch in read_towers(mine.with_name("mine_plan.csv")))
    assert stands(tower).tolist() == [True]
    assert set(np.array(tower.blocks.name)[tower.block[0]]) <= {f"mine_{i:02d}" for i in range(6)}
    said = re.match(r"overhang (\S+) m, chance 1.00\n", result.out)
    assert said is not None
    assert float(said[1]) == pytest.approx(Overhang().value(tower)[0], rel=0.01)
    assert "chance of each prefix: 1.00 1.00 1.00 1.00\n" in result.out
    assert result.out.endswith("written: mine_plan.csv, mine_plan.png\n")
    assert Path("mine_plan.png").stat().st_size > 10_000
    call(*command, "out=b.csv", command="apf.plan").must_work()
    assert Path("b.csv").read_text() == Path("mine_plan.csv").read_text()


def test_a_run_that_has_learned(mine: Path) -> None:
    call(*TINY, "hydra.run.dir=run").must_work()
    result = call(
        "objects=mine.csv", "task=tallest", "length=3", "run=run", "planner.generations=2", command="apf.plan"
    )
    result.must_work()
    assert re.search(r"members say: 0\.\d\d to 0\.\d\d, standard deviation 0\.\d\d\n", result.out)
    labels = call("plans=plan.csv", "out=labels.csv", command="apf.label").must_work()
    assert "1 plans labelled" in labels.out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("task=overhang",), ("run is missing", "predictor=analytic")),
        (("run=run",), ("task is tallest, overhang, unsupported", "task=NAME")),
        (("task=overhang", "run=run"), ("run holds no run",)),
        (("task=overhang", "predictor=analytic", "length=7"), ("length", "6")),
        (("task=overhang", "predictor=analytic", "out=plan.txt"), ("plan.txt", ".csv or .parquet")),
        (("task=overhang", "predictor=analytic", "objects=none.csv"), ("objects: none.csv", "no such file")),
    ],
)
def test_mistakes(mine: Path, arguments: tuple[str, ...], words: tuple[str, ...]) -> None:
    call("objects=mine.csv", *arguments, command="apf.plan").must_refuse(*words)
    assert {path.name for path in mine.parent.iterdir()} == {"mine.csv"}


def test_from_python() -> None:
    """Longer towers of more blocks are taller; the same seed gives the same tower."""
    domain = TowerDomain(training=BlockSource(blocks=8, seed=3))
    planner = SearchPlanner(candidates=1000, generations=5)
    three, four, again = (plan(domain, Tallest(), AnalyticPredictor(), planner, n, seed=1) for n in (3, 4, 4))
    assert stands(four.plan).all()
    assert four.value > three.value
    np.testing.assert_array_equal(four.plan.xy, again.plan.xy)
