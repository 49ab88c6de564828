"""A run touches nothing but what it made: files of the user's own, of other runs, and of other users stay."""

import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
import yaml

import apf.rundir.versions
from apf.errors import InputError
from apf.towers import BlockSource, write_blocks
from apf.tracking import ConsoleTracker, RunInfo
from integration.command_line import TINY, call

pytestmark = pytest.mark.usefixtures("no_figures")

MINE = (
    *("training_blocks.csv", "evaluation_blocks.csv", "run.yaml", "config.yaml", "journal.jsonl", "run.log", "lock"),
    *("plans.parquet", "regret.parquet", "accuracy.parquet", "evaluation_plans.parquet", "world.parquet"),
    *("weights/step_0001.safetensors", "figures/regret.png"),
)


def contents(folder: Path) -> dict[Path, bytes]:
    """Of all files below it."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", MINE)
def test_a_file_of_the_users_own_is_named_and_stays(here: Path, name: str) -> None:
    path = here / "run" / name
    path.parent.mkdir(parents=True)
    (here / "run" / "notes.txt").write_text("mine, too")
    for text in ("my own words\n", "and: more\nthan: one line\n"):
        path.write_text(text)
        before = contents(here)
        call(*TINY, "hydra.run.dir=run").must_refuse(f"{path} is there already", "choose another hydra.run.dir")
        assert contents(here) == before


@pytest.mark.parametrize("name", ["training_blocks.csv", "run.yaml", "journal.jsonl", "lock"])
@pytest.mark.parametrize("target", ["mine.txt", "missing.txt", "."])
def test_a_link_is_not_followed(here: Path, name: str, target: str) -> None:
    (here / "mine.txt").write_text("mine")
    (here / "run").mkdir()
    (here / "run" / name).symlink_to(here / target)
    call(*TINY, "hydra.run.dir=run").must_refuse(name)
    assert contents(here)[here / "mine.txt"] == b"mine"
    assert [path.name for path in (here / "run").iterdir()] == [name]


def test_the_users_block_set_may_lie_where_the_run_keeps_its_own(here: Path) -> None:
    path = here / "run" / "training_blocks.csv"
    write_blocks(BlockSource(seed=5).load(), path, units=True)
    before = path.read_bytes()
    (here / "run" / "notes.txt").write_text("mine")
    refused = call(*TINY, "domain.training.file=run/training_blocks.csv", "tracker.nonsense=1", "hydra.run.dir=run")
    refused.must_refuse("tracker.nonsense")
    call(*TINY, "domain.training.file=run/training_blocks.csv", "hydra.run.dir=run").must_work()
    assert path.read_bytes() == before
    assert (here / "run" / "notes.txt").read_text() == "mine"


def test_a_run_that_is_refused_after_it_began_takes_back_what_it_made_alone(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(self: ConsoleTracker, run: RunInfo) -> None:
        names = {path.name for path in run.directory.iterdir()}
        assert {"config.yaml", "run.yaml", "journal.jsonl", "lock", "training_blocks.csv", "weights"} <= names
        raise InputError("tracker: no")

    path = here / "run" / "evaluation_blocks.csv"
    write_blocks(BlockSource(seed=1).load(), path, units=True)
    (here / "run" / "notes.txt").write_text("mine")
    before = contents(here)
    monkeypatch.setattr(ConsoleTracker, "start", refuse)
    call(*TINY, "domain.evaluation.file=run/evaluation_blocks.csv", "hydra.run.dir=run").must_refuse("tracker: no")
    assert contents(here) == before
    assert not (here / "run" / "weights").exists()
    call(*TINY, "hydra.run.dir=new").must_refuse("tracker: no")
    assert not (here / "new").exists()


def test_a_start_that_was_killed_is_no_foreigner(here: Path) -> None:
    """Of the same run; another one leaves it alone."""
    call(*TINY, "hydra.run.dir=run").must_work()
    run = here / "run"
    whole = contents(run)
    first = ["lock", "evaluation_blocks.csv", "training_blocks.csv", "run.yaml", "journal.jsonl"]
    header = whole[run / "journal.jsonl"].splitlines(keepends=True)[0]
    for n in range(len(first) + 1):
        folder = here / f"run{n}"
        folder.mkdir()
        for name in first[:n]:
            (folder / name).write_bytes(header if name == "journal.jsonl" else whole[run / name])
        (folder / ".config.yaml.0123abcd.apf-part").write_text("half")
        if n > 3:
            before = contents(folder)
            call(*TINY, "seed=7", f"hydra.run.dir={folder.name}").must_refuse("run.yaml is there already")
            assert contents(folder) == before
        call(*TINY, f"hydra.run.dir={folder.name}").must_work()
        for name in ("plans.parquet", "regret.parquet", "accuracy.parquet"):
            assert (folder / name).read_bytes() == whole[run / name]
        assert not list(folder.glob(".*"))


def test_a_lock_that_is_a_link_stops_a_resume_too(here: Path) -> None:
    call(*TINY, "hydra.run.dir=run").must_work()
    (here / "mine.txt").write_text("mine")
    (here / "run" / "lock").unlink()
    (here / "run" / "lock").symlink_to(here / "mine.txt")
    call("resume=run", "plans=14").must_refuse("lock is a link out of the run directory")
    call("run=run", "plan=0", "labels=0", command="apf.relabel").must_refuse("lock is a link")
    assert (here / "mine.txt").read_text() == "mine"


# -- a journal that is not what it was ----------------------------------------------------------------------------


@pytest.fixture
def finished(here: Path) -> Path:
    """The journal of a finished run in run/."""
    call(*TINY, "hydra.run.dir=run").must_work()
    return here / "run" / "journal.jsonl"


def test_a_finished_run_whose_journal_is_damaged_says_so(finished: Path) -> None:
    lines = finished.read_bytes().splitlines(keepends=True)
    n = len(lines)
    for wrong, words in (
        ([*lines[:-9], *(b"x" + line for line in lines[-9:])], f"line {n - 8} of {n} is not what was written"),
        ([line.replace(b"\n", b"\r\n") for line in lines], "CRLF"),
        ([*lines, lines[3]], f"line {n + 1} is line 4 once more"),
        (lines[:-1], f"line {n} is missing; by run.yaml there were {n} lines"),
        ([*lines[:-1], lines[-1][:-20]], f"line {n} is missing; by run.yaml there were {n} lines"),
        ([b""], "is empty"),
    ):
        finished.write_bytes(b"".join(wrong))
        for arguments, command in (
            (("resume=run",), "apf.main"),
            ((*TINY, "hydra.run.dir=run"), "apf.main"),
            (("run=run", "plan=0", "labels=0"), "apf.relabel"),
        ):
            assert words in call(*arguments, command=command).err.splitlines()[-1]
        assert finished.read_bytes() == b"".join(wrong)
    finished.write_bytes(b"".join(lines))
    assert "finished" in call("resume=run").must_work().err


def test_the_journal_of_another_run_is_refused(finished: Path) -> None:
    call(*TINY, "hydra.run.dir=other").must_work()
    finished.write_bytes((finished.parents[1] / "other" / "journal.jsonl").read_bytes())
    call("resume=run").must_refuse("is the journal of run", "put back its own")


def test_what_was_torn_is_kept_and_told(finished: Path) -> None:
    state = finished.with_name("run.yaml")
    reopened = yaml.safe_load(state.read_text()) | {"finished": False}
    del reopened["journal"]
    state.write_text(yaml.safe_dump(reopened))
    lines = finished.read_bytes().splitlines(keepends=True)
    finished.write_bytes(b"".join(lines)[:-9])
    result = call("resume=run").must_work()
    line = "the last record of the journal was torn: what it held is done again; journal.torn-1.jsonl keeps the rest"
    assert line in result.err
    assert line in finished.with_name("run.log").read_text()
    assert finished.with_name("journal.torn-1.jsonl").read_bytes() == lines[-1][:-9]
    assert "journal was torn" not in call("resume=run", "plans=14").must_work().err
    finished.write_bytes(finished.read_bytes() + b'{"kind": "correc')
    result = call("run=run", "plan=0", "labels=0", command="apf.relabel").must_work()
    assert "journal.torn-2.jsonl" in result.err


# -- versions -----------------------------------------------------------------------------------------------------


def test_going_on_with_other_versions_says_so(finished: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = yaml.safe_load(finished.with_name("run.yaml").read_text())["versions"]
    assert kept == apf.rundir.versions.versions()
    assert torch.backends.cpu.get_cpu_capability() in kept["cpu"]
    assert "begun with" not in call("resume=run", "plans=14").must_work().err
    now = {**kept, "torch": "9.9.9", "cpu": "riscv64 DEFAULT"}
    monkeypatch.setattr(apf.rundir.versions, "versions", lambda: now)
    result = call("resume=run", "plans=16").must_work()
    (line,) = [line for line in result.err.splitlines() if line.startswith("begun with")]
    for word in (f"torch {kept['torch']} (now 9.9.9)", f"cpu {kept['cpu']} (now riscv64 DEFAULT)"):
        assert word in line
    assert "numpy" not in line
    assert line in finished.with_name("run.log").read_text()


# -- modes, and other users ---------------------------------------------------------------------------------------


def test_all_files_can_be_read_by_whom_the_umask_lets(here: Path) -> None:
    before = os.umask(0o027)
    try:
        call(*TINY, "hydra.run.dir=run").must_work()
    finally:
        os.umask(before)
    modes = {str(path.relative_to(here)): stat.S_IMODE(path.stat().st_mode) for path in (here / "run").rglob("*.*")}
    assert "run/weights/step_0001.safetensors" in modes
    assert modes == dict.fromkeys(modes, 0o640)
    assert stat.S_IMODE((here / "run" / "lock").stat().st_mode) == 0o640


@pytest.fixture
def read_only(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A finished run in a folder in which this user may write nothing, as if another one had made it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        monkeypatch.chdir(folder)
        call(*TINY, "hydra.run.dir=run").must_work()
        folders = [folder, *(path for path in folder.rglob("*") if path.is_dir())]
        for path in folders:
            path.chmod(0o555)
        root = os.geteuid() == 0
        if root:
            os.seteuid(65534)
        try:
            yield folder / "run"
        finally:
            if root:
                os.seteuid(0)
            for path in folders:
                path.chmod(0o755)


def test_a_finished_run_of_another_user_returns_at_once(read_only: Path) -> None:
    before = contents(read_only)
    for arguments in ((*TINY, "hydra.run.dir=run"), ("resume=run",)):
        assert "holds this run already, finished" in call(*arguments).must_work().err
    call("resume=run", "plans=14").must_refuse("Permission denied")
    assert contents(read_only) == before


def test_a_file_that_may_not_be_read_is_named(read_only: Path) -> None:
    weights = read_only / "weights" / "step_0001.safetensors"
    if os.getuid() == 0:
        os.seteuid(0)
    weights.chmod(0o600 if os.getuid() == 0 else 0)
    if os.getuid() == 0:
        os.seteuid(65534)
    call("resume=run").must_refuse(f"{weights}: cannot be read: Permission denied")
