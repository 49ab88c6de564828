"""python -m apf.predict: how likely are somebody's own towers to stand?"""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from safetensors.numpy import load_file, save_file

from apf.rng import stream
from apf.towers import BlockSource, random_towers, read_towers, stands, write_blocks, write_towers
from apf.towers.files import BLOCK_COLUMNS
from apf.trained import load_ensemble
from integration.command_line import TINY, call

pytestmark = pytest.mark.usefixtures("no_figures")


@pytest.fixture
def mine(here: Path) -> Path:
    """Five towers of three blocks and four of two, and the blocks in a file of their own."""
    blocks = BlockSource(blocks=5, seed=9, prefix="mine").load()
    towers = [random_towers(blocks, length, n, stream(0, "mine", length)) for length, n in ((3, 5), (2, 4))]
    write_towers(towers, here / "towers.csv")
    write_blocks(blocks, here / "blocks.csv")
    return here / "towers.csv"


def test_the_chance_of_each_prefix_and_its_deviation(mine: Path, tiny_run: Path) -> None:
    result = call("plans=towers.csv", f"run={tiny_run}", "out=chances.parquet", command="apf.predict").must_work()
    table = pd.read_parquet("chances.parquet")
    assert list(table) == ["tower", "position", "chance", "deviation"]
    ensemble = load_ensemble(tiny_run)
    for batch in read_towers(mine):
        members = ensemble.predict(batch.plans).numpy()
        means = members.mean(0).cumprod(-1)
        spread = members.cumprod(-1).std(0)
        for name, chance, deviation in zip(batch.names, means, spread, strict=True):
            rows = table[table["tower"] == name]
            np.testing.assert_allclose(rows["chance"], [1, *chance], rtol=1e-5)
            np.testing.assert_allclose(rows["deviation"], [0, *deviation], atol=1e-6)
    assert result.out.startswith("tower 0: chance 0.")
    assert f"9 plans: {table.groupby('tower')['chance'].last().sum():.1f} are expected to succeed" in result.out
    assert result.out.endswith("written: chances.parquet\n")


def test_the_members_of_a_model_of_whole_plans(mine: Path) -> None:
    """Each member gives each prefix a probability of its own."""
    call(*TINY, "sampler=complete", "hydra.run.dir=run").must_work()
    call("plans=towers.csv", "run=run", "out=chances.csv", command="apf.predict").must_work()
    table = pd.read_csv("chances.csv")
    ensemble, (batch, _) = load_ensemble(Path("run")), read_towers(mine)
    for length in (2, 3):
        members = ensemble.predict(batch.plans.prefix(length)).numpy()[..., 0]
        rows = table[table["tower"].isin(batch.names) & (table["position"] == length - 1)]
        np.testing.assert_allclose(rows["chance"], members.mean(0), rtol=1e-5)
        np.testing.assert_allclose(rows["deviation"], members.std(0), atol=1e-6)


def test_who_knows_the_physics_has_no_members(mine: Path) -> None:
    call("plans=towers.csv", "predictor=analytic", "out=chances.csv", command="apf.predict").must_work()
    table = pd.read_csv("chances.csv")
    assert table["deviation"].isna().all()
    standing = [stood for batch in read_towers(mine) for stood in stands(batch.plans)]
    assert (table.groupby("tower")["chance"].last() == standing).all()


def test_objects_in_a_file_of_their_own(mine: Path, tiny_run: Path) -> None:
    command = (f"run={tiny_run}", "out=chances.csv")
    call("plans=towers.csv", *command, command="apf.predict").must_work()
    expected = Path("chances.csv").read_text()
    pd.read_csv(mine).drop(columns=BLOCK_COLUMNS[1:]).to_csv("bare.csv", index=False)
    call("plans=bare.csv", *command, command="apf.predict").must_refuse("bare.csv", "dim_x", "missing")
    call("plans=bare.csv", "objects=blocks.csv", *command, command="apf.predict").must_work()
    assert Path("chances.csv").read_text() == expected
    few = pd.read_csv("blocks.csv").iloc[:2]
    few.to_csv("few.csv", index=False)
    refused = call("plans=bare.csv", "objects=few.csv", *command, command="apf.predict")
    refused.must_refuse("bare.csv, row", "is not among the objects: mine_00, mine_01")


def without_weights(run: Path) -> None:
    shutil.rmtree(run / "weights")


def other_features(run: Path) -> None:
    """As an earlier version would have trained it, whose networks saw one feature less."""
    for path in (run / "weights").iterdir():
        weights = load_file(path)
        name = next(name for name, weight in weights.items() if weight.ndim == 3)
        save_file({**weights, name: np.ascontiguousarray(weights[name][:, 1:])}, path)


def torn(run: Path) -> None:
    for path in (run / "weights").iterdir():
        path.write_bytes(path.read_bytes()[:100])


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (without_weights, ("keeps no weights",)),
        (other_features, ("step_0002.safetensors", "other features", "TowerDomain", "train it again")),
        (torn, ("step_0002.safetensors", "cannot be read")),
    ],
)
def test_a_run_that_cannot_be_asked(
    mine: Path, tiny_run: Path, spoil: Callable[[Path], None], words: tuple[str, ...]
) -> None:
    shutil.copytree(tiny_run, "run")
    spoil(Path("run"))
    for command in (("apf.predict", "plans=towers.csv"), ("apf.plan", "objects=blocks.csv", "task=tallest")):
        call(*command[1:], "run=run", "out=out.csv", command=command[0]).must_refuse(*words)
    assert not Path("out.csv").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run=nowhere",), ("nowhere holds no run",)),
        (("predictor=analytic", "plans=none.csv"), ("none.csv", "no such file")),
        (("predictor=analytic", "out=chances.txt"), ("chances.txt", ".csv or .parquet")),
        (("predictor=analytic", "objects=none.csv"), ("objects: none.csv", "no such file")),
        (("predictor=analytic", "odds=0"), ("odds is 0", "greater than 0")),
    ],
)
def test_mistakes(mine: Path, arguments: tuple[str, ...], words: tuple[str, ...]) -> None:
    given = {text.partition("=")[0] for text in arguments}
    rest = [text for text in ("plans=towers.csv", "out=chances.csv") if text.partition("=")[0] not in given]
    call(*rest, *arguments, command="apf.predict").must_refuse(*words)
    assert not list(mine.parent.glob("chances*"))


def test_a_run_of_another_domain(mine: Path, tiny_run: Path) -> None:
    boxes = "packing,position,box,dim_x,dim_y,dim_z,orientation,x,y\n0,0,a,0.1,0.1,0.1,z0,0,0\n"
    Path("packings.csv").write_text(boxes)
    command = ("domain=packing", "plans=packings.csv", f"run={tiny_run}", "out=chances.csv")
    call(*command, command="apf.predict").must_refuse("is a run of TowerDomain; domain is PackingDomain")


def test_help(here: Path) -> None:
    page = call("--help", command="apf.predict").must_work().out
    for word in ("python -m apf.predict plans=FILE", "objects", "deviation", "predictor"):
        assert word in page
