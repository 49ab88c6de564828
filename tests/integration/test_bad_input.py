"""A bad input gets one clear line that names the key or the file, an exit code, and leaves no run behind."""

from pathlib import Path

import pandas as pd
import pytest

from apf.towers import BlockSource, write_blocks
from integration.command_line import TINY, call, spawn

UNKNOWN_OPTION = [
    *((f"{group}=nonsense", group, "nonsense") for group in ("model", "sampler", "world", "planner", "predictor")),
    ("tracker=nonsense", "tracker", "wandb"),
    ("domain=nonsense", "domain", "towers"),
    ("task=nonsense", "task", "tallest"),
    ("task=[tallest,nonsense]", "task", "nonsense", "overhang, tallest, unsupported"),
    ("world@evaluation.worlds.noisy=nonsense", "world", "nonsense"),
    ("+experiment=nonsense", "experiment", "smoke"),
    ("+nonsense=option", "nonsense", "no such key"),
]

UNKNOWN_KEY = [
    *((f"{sign}nonsense=1", "nonsense") for sign in ("", "+", "++")),
    *((f"{sign}training.nonsense=1", "training.nonsense") for sign in ("", "+", "++")),
    *((f"{sign}model.nonsense=1", "model.nonsense") for sign in ("", "+", "++")),
    *((f"{sign}sampler.candidates.nonsense=1", "sampler.candidates.nonsense") for sign in ("+", "++")),
    *(
        (f"+{group}.nonsense=1", f"{group}.nonsense")
        for group in (
            "initial",
            "acquisition",
            "evaluation",
            "evaluation.worlds.noisy",
            "domain",
            "domain.training",
            "domain.offset",
            "model.network",
            "sampler",
            "sampler.initial",
            "sampler.candidates.lengths",
            "sampler.score",
            "world",
            "task.tallest",
            "planner",
            "predictor",
            "tracker",
        )
    ),
    ("+task.nonsense=1", "task.nonsense"),
    ("hydra.nonsense=1", "hydra.nonsense"),
    ("+hydra.nonsense=1", "hydra.nonsense"),
    ("+hydra.sweep.nonsense=1", "hydra.sweep.nonsense"),
    ("+execution.nonsense=1", "execution.nonsense"),
]

OUT_OF_RANGE = [
    ("model.members=0", "model.members"),
    ("model.network.hidden=0", "model.network.hidden"),
    ("world.noise=-1", "world.noise"),
    ("world.noise=nan", "world.noise"),
    ("plans=5", "plans"),
    ("seed=-1", "seed"),
    ("threads=0", "threads"),
    ("initial.train=0", "initial.train"),
    ("acquisition.plans=0", "acquisition.plans"),
    ("acquisition.validation=10", "acquisition.validation"),
    ("acquisition.rehearsed=10", "acquisition.rehearsed"),
    ("acquisition.rehearsed=-1", "acquisition.rehearsed"),
    ("training.learning_rate=0", "training.learning_rate"),
    ("evaluation.every=0", "evaluation.every"),
    ("evaluation.length=1", "evaluation.length"),
    ("evaluation.length=11", "evaluation.length"),
    ("evaluation.lengths=[11]", "evaluation.lengths"),
    ("evaluation.lengths=[2,1]", "evaluation.lengths"),
    ("evaluation.test_plans=3", "evaluation.test_plans"),
    ("planner.candidates=0", "planner.candidates"),
    ("sampler.candidates.lengths.max=11", "sampler"),
    ("sampler.candidates.lengths.min=6", "sampler.candidates.lengths"),
    ("sampler.candidates.lengths.min=1", "sampler.candidates.lengths.min"),
    ("sampler.initial.max=11", "sampler"),
    ("domain.training.blocks=0", "domain.training.blocks"),
    ("domain.training.blocks=3", "training"),
    ("domain.training.com_share=1", "domain.training.com_share"),
    ("domain.training.mass=[0,1]", "domain.training.mass"),
    ("domain.training.side=[0.15,0.05]", "side"),
    ("domain.training.mass=[1.0,0.1]", "mass"),
    ("domain.offset.limit=1", "domain.offset.limit"),
    ("task=[]", "task"),
    ("device=cuda:9", "device"),
    ("device=nonsense", "device"),
    ("device=meta", "device"),
]

WRONG_TYPE = [
    ("plans=many", "plans"),
    ("plans=12.5", "plans"),
    ("seed=null", "seed"),
    ("seed=???", "seed"),
    ("seed=[1]", "seed"),
    ("world.noise=loud", "world.noise"),
    ("world.noise=null", "world.noise"),
    ("model.members=ten", "model.members"),
    ("model=3", "model"),
    ("training=3", "training"),
    ("evaluation.lengths=5", "evaluation.lengths"),
    ("evaluation.lengths=[two]", "evaluation.lengths"),
    ("sampler.kind=both", "sampler.kind"),
    ("sampler.initial.max=null", "sampler.initial.max"),
    ("domain.training.side=[0.05]", "domain.training.side"),
    ("model.network._target_=apf.models.Nonsense", "model.network"),
    ("world._target_=nonsense.World", "world"),
    ("world._target_=apf.towers.Tallest", "world"),
    ("~world", "world"),
    ("~world.noise", "world.noise"),
    ("seed=${nonsense}", "seed"),
    ("seed=[1,2", "[1,2"),
    ("seed", "seed"),
    ("seed=0,1", "seed"),
    ("sampler=greedy,complete", "sampler"),
    ("--config-name=nonsense", "nonsense"),
]


def refused(here: Path, *overrides: str, words: tuple[str, ...]) -> str:
    """The line that a run in a new directory is refused with; nothing is left of it."""
    before = sorted(here.iterdir())
    line = call(*TINY, "hydra.run.dir=runs/new", *overrides).must_refuse(*words)
    assert sorted(here.iterdir()) == before, "something was left behind"
    return line


@pytest.mark.parametrize(("override", "words"), [(first, tuple(rest)) for first, *rest in UNKNOWN_OPTION])
def test_unknown_option(here: Path, override: str, words: tuple[str, ...]) -> None:
    refused(here, override, words=words)


@pytest.mark.parametrize(("override", "key"), UNKNOWN_KEY)
def test_unknown_key(here: Path, override: str, key: str) -> None:
    refused(here, override, words=(key,))


@pytest.mark.parametrize(
    ("override", "hint"),
    [
        ("training.update=1", "training.update: there is no such key; did you mean updates?"),
        ("trainin.updates=1", "trainin: there is no such key; did you mean training?"),
        ("+predictor.odd=1", "predictor.odd: there is no such key; did you mean odds?"),
        ("evaluation.worlds.moon=1", "evaluation.worlds.moon: there is no such key; known here: analytic, noisy"),
    ],
)
def test_a_mistyped_key_is_told_what_was_meant(here: Path, override: str, hint: str) -> None:
    assert refused(here, override, words=()) == f"error: {hint}"


@pytest.mark.parametrize(("override", "key"), OUT_OF_RANGE)
def test_out_of_range(here: Path, override: str, key: str) -> None:
    refused(here, override, words=(key,))


@pytest.mark.parametrize(("override", "key"), WRONG_TYPE)
def test_wrong_type_or_form(here: Path, override: str, key: str) -> None:
    refused(here, override, words=(key,))


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("tracker.wandb.mode=bogus", ("mode", "bogus", "offline", "online")),
        ("+tracker.wandb.nonsense=1", ("tracker.wandb.nonsense", "project, entity, mode")),
        ("++tracker.wandb.nonsense=1", ("tracker", "nonsense")),
    ],
)
def test_tracker(here: Path, override: str, words: tuple[str, ...]) -> None:
    refused(here, "tracker=wandb", override, words=words)


def test_what_the_sampler_cannot_do(here: Path) -> None:
    refused(here, "sampler.kind=complete", words=("sampler", "ExpectedBald"))
    refused(here, "sampler=greedy", "sampler.candidates.longest=11", words=("sampler", "11", "10"))
    refused(here, "sampler=incremental", "sampler.candidates.longest=1", words=("sampler.candidates.longest",))


def test_a_line_says_what_would_be_right(here: Path) -> None:
    assert "did you mean members" in refused(here, "+model.member=3", words=("model.member",))
    assert "did you mean plans" in refused(here, "+plan=3", words=("plan",))
    assert "8" in refused(here, "plans=5", words=("plans",))
    assert "lstm" in refused(here, "model=nonsense", words=("fcgn", "tgn"))


def test_an_unknown_key_is_not_answered_with_advice_that_fails(here: Path) -> None:
    """Hydra would suggest `+nonsense=1`, which is refused as well."""
    assert "+nonsense" not in refused(here, "nonsense=1", words=("nonsense",))


def test_a_directory_that_cannot_be_made(here: Path) -> None:
    (here / "file").write_text("mine")
    for directory in ("file", "file/run"):
        call(*TINY, f"hydra.run.dir={directory}").must_refuse("file")
    assert (here / "file").read_text() == "mine"
    assert list(here.iterdir()) == [here / "file"]


@pytest.mark.usefixtures("no_figures")
def test_a_bad_value_leaves_an_existing_run_as_it_is(here: Path) -> None:
    call(*TINY, "hydra.run.dir=run").must_work()
    before = {path: path.read_bytes() for path in here.rglob("*") if path.is_file()}
    call(*TINY, "hydra.run.dir=run", "model.members=0").must_refuse("model.members")
    assert {path: path.read_bytes() for path in here.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("override", ["model.members=0", "+nonsense=1", "seed=-1"])
def test_a_sweep_of_bad_values_leaves_no_run(here: Path, override: str) -> None:
    (here / "runs").mkdir()  # somebody made it: it stays
    result = call("-m", *TINY, override, "world=noisy,analytic")
    assert result.code == 1
    failed = [line for line in result.err.splitlines() if line.startswith("failed")]
    assert len(failed) == 2
    assert all(override.lstrip("+").partition("=")[0] in line for line in failed)
    assert result.err.splitlines()[-1].startswith("error: 2 of 2 runs did not finish")
    assert "Traceback" not in result.err
    assert list(here.rglob("*")) == [here / "runs"]


def block_file(path: Path, **changes: object) -> None:
    """A block file of ten blocks whose row 3 (the second block) has other values; a value of None drops the column."""
    write_blocks(BlockSource().load(), path)
    table = pd.read_csv(path)
    for column, value in changes.items():
        if value is None:
            table = table.drop(columns=column)
        else:
            table[column] = table[column].astype(object)
            table.loc[1, column] = value
    table.to_csv(path, index=False)


BAD_BLOCKS = {
    "a missing column": ({"mass": None}, ("mass",)),
    "a value missing": ({"dim_y": ""}, ("dim_y", "row 3")),
    "NaN": ({"com_x": "nan"}, ("com_x", "row 3")),
    "infinite": ({"mass": "inf"}, ("mass", "row 3")),
    "no number": ({"dim_z": "wide"}, ("dim_z", "wide", "row 3")),
    "no size": ({"dim_x": 0}, ("dim_x", "block_01")),
    "negative size": ({"dim_z": -0.1}, ("dim_z", "block_01")),
    "no mass": ({"mass": 0}, ("mass", "block_01")),
    "centre of mass outside": ({"com_y": 0.2}, ("com_y", "block_01", "outside")),
    "a name twice": ({"block": "block_00"}, ("block_00",)),
    "no name": ({"block": ""}, ("block", "row 3")),
}


@pytest.mark.parametrize("case", BAD_BLOCKS)
def test_bad_block_file(here: Path, case: str) -> None:
    changes, words = BAD_BLOCKS[case]
    block_file(here / "mine.csv", **changes)
    refused(here, "domain.training.file=mine.csv", words=("mine.csv", *words))


def test_bad_block_file_of_the_evaluation(here: Path) -> None:
    block_file(here / "mine.csv", dim_x=0)
    refused(here, "domain.evaluation.file=mine.csv", words=("mine.csv", "dim_x", "block_01"))


def test_block_files_that_are_none(here: Path) -> None:
    refused(here, "domain.training.file=nowhere.csv", words=("nowhere.csv", "no such file"))
    (here / "mine.txt").write_text("block\n")
    refused(here, "domain.training.file=mine.txt", words=("mine.txt", ".csv", ".parquet"))
    (here / "empty.csv").write_text("")
    refused(here, "domain.training.file=empty.csv", words=("empty.csv",))
    (here / "mine.parquet").write_text("this is no parquet file")
    refused(here, "domain.training.file=mine.parquet", words=("mine.parquet",))
    (here / "binary.csv").write_bytes(b"\x89PNG\xff\xfe\x00")
    refused(here, "domain.training.file=binary.csv", words=("binary.csv",))
    (here / "folder.csv").mkdir()
    refused(here, "domain.training.file=folder.csv", words=("folder.csv",))
    (here / "header.csv").write_text("block,dim_x,dim_y,dim_z,com_x,com_y,com_z,mass\n")
    refused(here, "domain.training.file=header.csv", words=("header.csv",))


def test_a_block_file_in_another_unit(here: Path) -> None:
    block_file(here / "mine.csv")
    text = (here / "mine.csv").read_text()
    (here / "mine.csv").write_text(text.replace("dim_x", "dim_x [inch]", 1))
    refused(here, "domain.training.file=mine.csv", words=("mine.csv", "dim_x", "inch", "mm"))


def test_a_block_file_with_too_few_blocks(here: Path) -> None:
    write_blocks(BlockSource(blocks=4).load(), here / "mine.csv")
    refused(here, "domain.training.file=mine.csv", words=("sampler", "5", "4"))


@pytest.mark.usefixtures("no_figures")
def test_a_good_block_file_works(here: Path) -> None:
    """The cases above differ from this one by what is wrong with them alone."""
    block_file(here / "mine.csv")
    call(*TINY, "hydra.run.dir=run", "domain.training.file=mine.csv", "domain.evaluation.file=mine.csv").must_work()
    placed = pd.read_parquet(here / "run" / "plans.parquet")
    assert set(placed["block"]) <= {f"block_{i:02d}" for i in range(10)}


@pytest.mark.slow
def test_in_a_process_of_its_own(tmp_path: Path) -> None:
    result = spawn(["-m", "apf.main", *TINY, "model.members=0"], cwd=tmp_path)
    result.must_refuse("model.members")
    assert result.code == 1
    assert result.out == ""
    assert list(tmp_path.iterdir()) == []
