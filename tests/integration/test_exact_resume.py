"""A run goes on exactly as it was, whatever it was started with and wherever its directory is now."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf

from apf.rundir.files import write_yaml
from apf.rundir.resume import as_literal, quoted
from apf.towers import BlockSet, BlockSource, write_blocks
from integration.command_line import REPOSITORY, TINY, Result, call, spawn
from integration.test_resume import stop_after

pytestmark = pytest.mark.usefixtures("no_figures")
UNUSUAL = ["a\\b", "${seed}", "\\${seed}", "it's", 'say "so"', "a b", "a[b]", "a,b", "a=b", "{a: b}", "%s", "a\\", "é"]


def stopped(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    """Start the run, and stop it after five labels."""
    with monkeypatch.context() as patch:
        stop_after(5, patch, lambda: (_ for _ in ()).throw(KeyboardInterrupt))
        assert call(*TINY, *arguments).code == 130


def config_of(run: Path) -> dict:
    return yaml.safe_load((run / "config.yaml").read_text())


def must_be_finished(run: Path) -> None:
    assert yaml.safe_load((run / "run.yaml").read_text())["finished"] is True
    assert (run / "plans.parquet").exists()


def must_be_equal(one: Path, other: Path) -> None:
    for name in ("plans", "regret", "accuracy"):
        tables = [pd.read_parquet(run / f"{name}.parquet") for run in (one, other)]
        pd.testing.assert_frame_equal(*tables, check_exact=True)


def test_values_from_the_environment(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are kept, not looked up again."""
    write_blocks(BlockSource(seed=5).load(), here / "my, [blocks].csv")
    numbers = ("seed=${oc.env:N}", "world.noise=${oc.env:NOISE}", "domain.mirror=${oc.env:MIRROR}")
    given = (*numbers, "domain.training.file=${oc.env:BLOCKS}", "hydra.run.dir=run")
    monkeypatch.setenv("NOISE", "1e-3")
    monkeypatch.setenv("MIRROR", "false")
    monkeypatch.setenv("N", "7")
    monkeypatch.setenv("BLOCKS", "my, [blocks].csv")
    stopped(monkeypatch, *given)
    call(*TINY, *given[:-1], "hydra.run.dir=whole").must_work()
    for name in ("N", "BLOCKS", "NOISE", "MIRROR"):
        monkeypatch.delenv(name)
    call("resume=run").must_work()
    config = config_of(here / "run")
    assert (config["seed"], config["world"]["noise"], config["domain"]["mirror"]) == (7, 0.001, False)
    must_be_equal(here / "run", here / "whole")


@pytest.mark.slow
def test_a_sweep_hands_on_what_was_typed(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A block file whose name comes from the environment, with symbols of the override grammar."""
    write_blocks(BlockSource(seed=5).load(), here / "my, [blocks].csv")
    monkeypatch.setenv("BLOCKS", "my, [blocks].csv")
    call("-m", *TINY, "plans=8", "domain.training.file=${oc.env:BLOCKS}", "hydra.sweep.dir='a \\${b}'").must_work()
    (config,) = (here / "a ${b}").glob("*/config.yaml")
    assert config_of(config.parent)["domain"]["training"]["file"] == "my, [blocks].csv"


@pytest.mark.parametrize("name", UNUSUAL)
def test_a_directory_of_any_name(here: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    stopped(monkeypatch, f"hydra.run.dir={quoted(Path('runs', name))}")
    assert [path.name for path in (here / "runs").iterdir()] == [name]
    assert not (here / "runs" / name / "plans.parquet").exists()
    call(f"resume=runs/{name}").must_work()
    must_be_finished(here / "runs" / name)
    assert [path.name for path in (here / "runs").iterdir()] == [name]
    assert [path.name for path in here.iterdir()] == ["runs"]


@given(st.text(st.characters(blacklist_categories=["Cs"], blacklist_characters="\0"), min_size=1, max_size=12))
def test_any_text_comes_through_as_it_is(text: str) -> None:
    if text != "???":  # OmegaConf's missing value
        assert OmegaConf.create({"text": as_literal(text), "seed": 1}).text == text


def test_a_directory_that_was_moved(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On another machine the folder where it began is not there, nor the block file."""
    (here / "project").mkdir()
    monkeypatch.chdir(here / "project")
    write_blocks(BlockSource(seed=5).load(), here / "project" / "blocks.csv")
    stopped(monkeypatch, "domain.training.file=blocks.csv", "hydra.run.dir=run")
    call(*TINY, "domain.training.file=blocks.csv", "hydra.run.dir=whole").must_work()
    for run in ("run", "whole"):
        shutil.move(here / "project" / run, here / f"moved {run}")
    monkeypatch.chdir(here)
    shutil.rmtree(here / "project")
    call("resume=moved run").must_work()
    must_be_equal(here / "moved run", here / "moved whole")
    assert config_of(here / "moved run")["domain"]["training"]["file"] == "blocks.csv"
    labels = "0" if pd.read_parquet(here / "moved run" / "plans.parquet")["label"].iloc[1] == 1 else "1"
    call("run=moved run", "plan=0", f"labels='1{labels}'", command="apf.relabel").must_work()


def test_block_sets_are_those_that_it_began_with(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_blocks(BlockSource(seed=5).load(), here / "blocks.csv")
    stopped(monkeypatch, "domain.training.file=blocks.csv", "hydra.run.dir=run")
    write_blocks(BlockSource(seed=6).load(), here / "blocks.csv")
    call(*TINY, "domain.training.file=blocks.csv", "hydra.run.dir=run").must_refuse("training_blocks.csv", "differs")
    kept = here / "run" / "training_blocks.csv"
    before = kept.read_bytes()
    shutil.copy(here / "blocks.csv", kept)
    call("resume=run").must_refuse("training_blocks.csv", "was changed")
    call("run=run", "plan=0", "labels=0", command="apf.relabel").must_refuse("training_blocks.csv", "was changed")
    kept.write_bytes(before)
    call("resume=run").must_work()


@pytest.mark.parametrize(
    "given", ["threads=2", "device=cpu", "sweep=other", "execution.time_limit=50", "tracker=none", "world=noisy"]
)
def test_what_may_be_given_with_resume(here: Path, monkeypatch: pytest.MonkeyPatch, given: str) -> None:
    stopped(monkeypatch, "tracker=wandb", "hydra.run.dir=run")
    call("resume=run", "tracker=none", given).must_work()
    must_be_finished(here / "run")


def test_another_tracker_takes_the_place_of_the_kept_one(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stopped(monkeypatch, "tracker=none", "hydra.run.dir=run")
    call("resume=run", "tracker=wandb", "tracker.wandb.project=mine").must_work()
    assert list((here / "run" / "wandb").glob("offline-run-*"))
    call("resume=run", "tracker.wandb.project=mine").must_refuse("tracker.wandb")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("seed=1", ("another config", "differ: seed")),
        ("sampler=random_ss", ("another config", "sampler.score")),
        ("world=analytic", ("another config", "world._target_", "world.noise")),
        ("~world@evaluation.worlds.noisy", ("evaluation.worlds.noisy",)),
        ("task=[tallest]", ("another config", "task.overhang._target_")),
        ("+nonsense=1", ("nonsense", "no such key")),
        ("tracker=nonsense", ("tracker", "nonsense")),
        ("hydra.run.dir=other", ("hydra.run.dir", "leave it out")),
        ("--config-name=label", ("--config-name", "leave it out")),
        ("hydra.mode=MULTIRUN", ("sweep",)),
    ],
)
def test_what_may_not_be_given_with_resume(
    here: Path, monkeypatch: pytest.MonkeyPatch, given: str, words: tuple[str, ...]
) -> None:
    stopped(monkeypatch, "hydra.run.dir=run")
    before = {path: path.read_bytes() for path in here.rglob("*") if path.is_file()}
    call("resume=run", given).must_refuse(*words)
    assert {path: path.read_bytes() for path in here.rglob("*") if path.is_file()} == before


def test_groups_of_a_folder_of_ones_own(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Needed to start, not to go on; asked for again, they are found again."""
    (here / "conf" / "tracker").mkdir(parents=True)
    (here / "conf" / "tracker" / "mine.yaml").write_text("_target_: apf.tracking.NoTracker\n")
    (here / "conf" / "preset").mkdir()
    (here / "conf" / "preset" / "small.yaml").write_text("# @package _global_\nevaluation: {problems: 0}\nthreads: 1\n")
    folder = ("--config-dir", "conf")
    given = (*TINY, "tracker=mine", "+preset=small", "evaluation.problems=1", "hydra.run.dir=run")
    with monkeypatch.context() as patch:
        stop_after(5, patch, lambda: (_ for _ in ()).throw(KeyboardInterrupt))
        assert call(*folder, *given).code == 130
    (here / "elsewhere").mkdir()

    def resume(*arguments: str) -> Result:
        monkeypatch.chdir(here / "elsewhere")
        return call("resume=../run", *arguments)

    resume("plans=14", "tracker=mine", "--config-dir=../conf").must_work()
    resume("plans=16", "hydra.searchpath=[file://../conf]", "tracker=mine").must_work()
    resume("tracker=mine").must_refuse("tracker", "mine")
    resume("+preset=small", "--config-dir=../conf").must_refuse("evaluation.problems")
    shutil.rmtree(here / "conf")
    resume("plans=18").must_work()
    assert config_of(here / "run")["plans"] == 18


NOT_NUMBERS = ["plans='12'", "initial.train='4'", "seed=true", "world.noise='0.003'", "evaluation.lengths=['2']"]


@pytest.mark.parametrize(
    "given", [*NOT_NUMBERS, "model.network.hidden='8'", "seed=1.0", "model.network.hidden=8.0", "domain.mirror='yes'"]
)
def test_values_of_another_type_are_refused_or_kept_as_numbers(
    here: Path, monkeypatch: pytest.MonkeyPatch, given: str
) -> None:
    with monkeypatch.context() as patch:
        stop_after(5, patch, lambda: (_ for _ in ()).throw(KeyboardInterrupt))
        result = call(*TINY, given, "hydra.run.dir=run")
    if result.code != 130:
        result.must_refuse(given.partition("=")[0])
        assert list(here.iterdir()) == []
        return
    key, _, value = given.partition("=")
    kept = OmegaConf.select(OmegaConf.load(here / "run" / "config.yaml"), key)
    assert kept == {"true": 1, "'yes'": True, "['2']": [2]}.get(value) or kept == float(value.strip("'"))
    assert type(kept) is (bool if key == "domain.mirror" else list if "[" in value else int)
    call("resume=run").must_work()
    call(*TINY, given, "hydra.run.dir=run").must_work()


ODD_NAMES = [
    " leading",
    "trailing ",
    "tab\there",
    "bell\a",
    "line\nbreak",
    "cr\rhere",
    "nul\0",
    "",
    "a,b",
    'q"q',
    "é\u2028",
]


@pytest.mark.parametrize("name", ODD_NAMES)
def test_block_names_survive_or_are_refused_before_it_begins(
    here: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Parquet can hold any name."""
    blocks = BlockSource(seed=5).load()
    names = (name, *blocks.name[1:])
    table = pd.DataFrame({"block": names, "mass": blocks.mass})
    for axis, (side, com) in enumerate(zip(blocks.dims.T, blocks.com.T, strict=True)):
        table[f"dim_{'xyz'[axis]}"], table[f"com_{'xyz'[axis]}"] = side, com
    table.to_parquet(here / "blocks.parquet")
    with monkeypatch.context() as patch:
        stop_after(5, patch, lambda: (_ for _ in ()).throw(KeyboardInterrupt))
        result = call(*TINY, "domain.training.file=blocks.parquet", "hydra.run.dir=run")
    if result.code != 130:
        result.must_refuse("block")
        assert [path.name for path in here.iterdir()] == ["blocks.parquet"]
        return
    before = BlockSource(file=here / "blocks.parquet").load()
    (here / "blocks.parquet").unlink()
    call("resume=run").must_work()
    kept = BlockSource(file=here / "run" / "training_blocks.csv").load()
    assert kept.equals(before)
    assert kept.name[0].strip() == name.strip()


@pytest.mark.parametrize("prefix", ["' '", "''", "'\\t'"])
def test_odd_prefixes(here: Path, monkeypatch: pytest.MonkeyPatch, prefix: str) -> None:
    with monkeypatch.context() as patch:
        stop_after(5, patch, lambda: (_ for _ in ()).throw(KeyboardInterrupt))
        result = call(*TINY, f"domain.training.prefix={prefix}", "hydra.run.dir=run")
    if result.code == 130:
        call("resume=run").must_work()
    else:
        assert any(word in result.must_refuse() for word in ("block", "domain.training.prefix"))
        assert list(here.iterdir()) == []


def test_what_is_written_is_read_back(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk, a file system or a library that changes something is noticed before the run begins."""

    def altered_blocks(blocks: BlockSet, path: Path, **options: bool) -> None:
        write_blocks(replace(blocks, mass=np.nextafter(blocks.mass, 0)), path, **options)

    def altered_values(path: Path, content: dict) -> None:
        write_yaml(path, content | {"seed": 1} if "seed" in content else content)

    for name, function, words in (
        ("apf.towers.domain.write_blocks", altered_blocks, ("blocks", "training_blocks.csv")),
        ("apf.rundir.directory.write_yaml", altered_values, ("seed", "config.yaml")),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(name, function)
            call(*TINY, "hydra.run.dir=run").must_refuse(*words)
        assert list(here.iterdir()) == []


@pytest.mark.slow
def test_a_checkout_that_is_not_installed(tmp_path: Path) -> None:
    """What it needs is installed, itself is not: it runs, and its launcher of sweeps is found."""
    libraries = tmp_path / "libraries"
    libraries.mkdir()
    for path in Path(pd.__file__).parents[1].iterdir():
        if not path.name.lower().startswith(("apf", "_apf", "__editable__")) and path.suffix != ".pth":
            (libraries / path.name).symlink_to(path)
    environment = {"PYTHONPATH": os.pathsep.join([str(REPOSITORY), str(libraries)])}

    def run(*arguments: str) -> Result:
        return spawn(["-S", "-m", "apf.main", *arguments], cwd=tmp_path, **environment).must_work()

    shown = spawn(["-S", "-c", "import importlib.metadata as m; m.version('apf')"], cwd=tmp_path, **environment)
    assert "PackageNotFoundError" in shown.err
    run(*TINY, "hydra.run.dir=run")
    must_be_finished(tmp_path / "run")
    assert "SweepLauncher" in run("--info", "plugins").out
