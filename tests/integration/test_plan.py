"""python -m apf.plan: plans for somebody's own blocks."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from apf.commands.judge import judge_of
from apf.errors import InputError
from apf.packing import PackingDomain
from apf.towers import BlockSource, Overhang, TowerDomain, Towers, read_towers, stands, write_blocks
from apf.trained import SHIPPED
from integration.command_line import call

pytestmark = pytest.mark.usefixtures("no_figures")
QUICK = ("planner.generations=5", "planner.start=300", "planner.candidates=1000")


@pytest.fixture
def mine(here: Path) -> Path:
    """Six blocks of somebody."""
    write_blocks(BlockSource(blocks=6, seed=9, prefix="mine").load(), here / "mine.csv")
    return here / "mine.csv"


def towers_of(path: Path) -> Towers:
    ((towers),) = (batch.plans for batch in read_towers(path))
    return towers


def test_who_knows_the_physics_gets_a_tower_that_stands(mine: Path) -> None:
    command = ("objects=mine.csv", "task=overhang", "length=4", "predictor=analytic")
    result = call(*command, "out=mine_plan.csv", command="apf.plan").must_work()
    tower = towers_of(mine.with_name("mine_plan.csv"))
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


def test_several_that_differ_from_each_other(mine: Path) -> None:
    """From the best on, in one file; a picture each."""
    command = ("objects=mine.csv", "task=tallest", "length=3", "predictor=analytic", "top=3", "out=p.csv")
    result = call(*command, *QUICK, command="apf.plan").must_work()
    towers = towers_of(mine.with_name("p.csv"))
    assert stands(towers).tolist() == [True] * 3
    domain = TowerDomain()
    pairs = [(i, j) for i in range(3) for j in range(3) if i != j]
    assert all(domain.differ(towers[[i]], towers[[j]]).all() for i, j in pairs)
    table = pd.read_csv("p.csv")
    values = table.groupby("tower")["value"].first()
    assert values.is_monotonic_decreasing
    assert re.findall(r"^(\d): tallest", result.out, re.MULTILINE) == ["0", "1", "2"]
    assert {path.name for path in mine.parent.glob("*.png")} == {"p_0.png", "p_1.png", "p_2.png"}


def test_a_run_that_has_learned(mine: Path, tiny_run: Path) -> None:
    result = call(
        "objects=mine.csv", "task=tallest", "length=3", f"run={tiny_run}", "planner.generations=2", command="apf.plan"
    )
    result.must_work()
    assert re.search(r"standard deviation of the members: 0\.00 0\.\d\d 0\.\d\d\n", result.out)
    labels = call("plans=plan.csv", "out=labels.csv", command="apf.label").must_work()
    assert "1 plans labelled" in labels.out


def test_a_least_chance(mine: Path, tiny_run: Path) -> None:
    """Each plan has it; if there is none, the highest chance that was found is said."""
    command = ("objects=mine.csv", "task=overhang", "length=3", f"run={tiny_run}", "top=2", *QUICK)
    line = call(*command, "stand=0.9999", command="apf.plan").must_refuse("stand is 0.9999", "0.9999", "length")
    found = re.search(r"best chance that was found is (0\.\d\d)", line)
    assert found is not None
    assert {path.name for path in mine.parent.iterdir()} == {"mine.csv"}
    least = float(found[1]) - 0.02
    call(*command, f"stand={least}", command="apf.plan").must_work()
    table = pd.read_csv("plan.csv")
    assert (table[table["position"] == 2]["chance"] >= least - 1e-4).all()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run=run",), ("task is tallest, overhang, unsupported", "task=NAME")),
        (
            ("task=overhnag",),
            ("task=overhnag: there is no such option", "did you mean overhang?", "task is one of", "tallest"),
        ),
        (("task=overhang", "run=run"), ("run holds no run",)),
        (("task=overhang", "predictor=analytic", "length=7"), ("length", "7 blocks", "objects has 6")),
        (("task=overhang", "predictor=analytic", "out=plan.txt"), ("plan.txt", ".csv or .parquet")),
        (("task=overhang", "predictor=analytic", "objects=none.csv"), ("objects: none.csv", "no such file")),
        (("task=overhang", "predictor=analytic", "top=0"), ("top is 0", "greater than or equal to 1")),
        (("task=overhang", "predictor=analytic", "stand=90"), ("stand is 90", "less than or equal to 1")),
    ],
)
def test_mistakes(mine: Path, arguments: tuple[str, ...], words: tuple[str, ...]) -> None:
    call("objects=mine.csv", *arguments, command="apf.plan").must_refuse(*words)
    assert {path.name for path in mine.parent.iterdir()} == {"mine.csv"}


@pytest.mark.parametrize(
    ("factor", "words"),
    [(1000, ("above 1 m", "dim_x [mm]")), (100, ("above 1 m", "dim_x [cm]")), (0.01, ("below 5 mm", "sides are in m"))],
)
def test_blocks_in_another_unit(mine: Path, factor: float, words: tuple[str, ...]) -> None:
    table = pd.read_csv(mine)
    table[table.columns[1:7]] *= factor
    table.to_csv(mine, index=False)
    command = ("objects=mine.csv", "task=overhang", "predictor=analytic")
    call(*command, command="apf.plan").must_refuse("objects: mine.csv, row 2", *words)


@pytest.mark.slow
def test_as_a_person_types_it(mine: Path) -> None:
    """In a process of its own: nothing but what was found is printed."""
    from integration.command_line import spawn

    command = ["-m", "apf.plan", "objects=mine.csv", "task=tallest", "length=2", "predictor=analytic", *QUICK]
    result = spawn(command, cwd=mine.parent).must_work()
    assert result.err == ""
    assert result.out.startswith("tallest ")


def test_without_a_run_the_ensemble_that_comes_with_apf_is_asked(mine: Path) -> None:
    """It is small, the table of how good it is lies beside it, and the tower that it finds stands."""
    result = call("objects=mine.csv", "task=tallest", "length=4", "stand=0.5", command="apf.plan").must_work()
    assert "standard deviation of the members" in result.out
    assert stands(towers_of(mine.with_name("plan.csv"))).tolist() == [True]
    (folder,) = SHIPPED.iterdir()
    assert sum(path.stat().st_size for path in folder.rglob("*.*")) < 1_000_000
    quality = pd.read_csv(folder / "quality.csv").set_index(["quantity", "of"])["value"]
    assert quality["mean regret", "tallest, noisy"] < 0.1
    assert quality["auc", "5 placements"] > 0.98


def test_of_a_domain_without_one_a_run_must_be_given() -> None:
    with pytest.raises(InputError, match=r"run is missing.*no ensemble for PackingDomain"):
        judge_of(None, None, None, PackingDomain())
