"""What is promised to be on the disk is there after a power cut: on a disk that keeps only what was synced."""

import itertools
import json
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from disk import Disk

from apf.domain import Scored
from apf.errors import InputError
from apf.rundir.claim import locked
from apf.rundir.files import make_folder, remove_unfinished, replacing, write_yaml
from apf.rundir.journal import Journal
from apf.rundir.store import Store
from apf.rundir.tables import write_table
from apf.towers import TowerDomain


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    """Of what a test does in tmp_path."""
    disk = Disk(tmp_path)
    with disk.watching():
        yield disk


def towers(journal: bytes) -> list[int]:
    """Those labelled in the lines of a journal."""
    records = [json.loads(line) for line in journal.splitlines()]
    return [record["plan"] for record in records if record["kind"] == "label"]


def test_the_disk_of_these_tests_forgets(disk: Disk, tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"one")
    assert disk.after_a_cut() == {}
    assert disk.after_a_cut(eager=True) == {"file": b""}
    with path.open("ab") as file:
        os.fsync(file.fileno())
        assert disk.after_a_cut() == {}
        assert disk.after_a_cut(eager=True) == {"file": b"one"}
        folder = os.open(tmp_path, os.O_RDONLY)
        os.fsync(folder)
        os.close(folder)
        file.write(b"two")
        file.flush()
    assert disk.after_a_cut() == disk.after_a_cut(eager=True) == {"file": b"one"}


def test_a_record_is_on_the_disk_when_append_returns(disk: Disk, tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal.jsonl")
    for number in range(3):
        journal.append("label", plan=number)
        assert towers(disk.after_a_cut()["journal.jsonl"]) == list(range(number + 1))
    journal.close()


def test_a_torn_end_is_aside_before_it_is_cut_off(disk: Disk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "journal.jsonl"
    journal = Journal(path)
    journal.append("label", plan=0)
    journal.close()
    whole = path.read_bytes()
    torn = whole.splitlines(keepends=True)[-1][:-5]
    with path.open("ab") as file:
        file.write(torn)
        file.flush()
        os.fsync(file.fileno())
    found = []
    truncate = os.ftruncate
    monkeypatch.setattr(os, "ftruncate", lambda *args: (found.append(disk.after_a_cut()), truncate(*args)))
    Journal(path).close()
    assert found[0]["journal.torn-1.jsonl"] == torn
    assert disk.after_a_cut()["journal.jsonl"] == path.read_bytes() == whole


@pytest.mark.parametrize("eager", [False, True])
def test_a_file_is_replaced_whole_and_durably(disk: Disk, tmp_path: Path, eager: bool) -> None:
    for number in range(3):
        write_yaml(tmp_path / "run.yaml", {"number": number})
        assert disk.after_a_cut(eager) == {"run.yaml": b"number: %d\n" % number}
    with pytest.raises(ZeroDivisionError), replacing(tmp_path / "run.yaml") as half:
        half.write_text("number: 3")
        raise ZeroDivisionError
    assert disk.after_a_cut(eager) == {"run.yaml": b"number: 2\n"}
    assert [path.name for path in tmp_path.iterdir()] == ["run.yaml"]


@pytest.mark.parametrize("eager", [False, True])
@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_a_table_is_there_with_its_folders(disk: Disk, tmp_path: Path, ending: str, eager: bool) -> None:
    path = tmp_path / "new" / "folders" / f"table{ending}"
    write_table(pd.DataFrame({"n": [1, 2]}), path)
    assert disk.after_a_cut(eager)[str(path.relative_to(tmp_path))] == path.read_bytes()


def test_a_label_is_on_the_disk_in_a_folder_that_somebody_else_just_made(disk: Disk, tmp_path: Path) -> None:
    """Hydra makes the run directory, and those above it."""
    run = tmp_path / "runs" / "2026-01-01" / "run"
    run.mkdir(parents=True)
    domain = TowerDomain()
    with locked(run):
        store = Store(run, domain)
        store.plan(0, [Scored(domain.random_plans(3, 1, np.random.default_rng(0)), 0.5)], ["train"])
        store.record(0, np.array([1, 1, 0]))
        name = str((run / "journal.jsonl").relative_to(tmp_path))
        assert towers(disk.after_a_cut()[name]) == [0]
        evaluation = [pd.DataFrame(columns=columns) for columns in (["a"], ["b"])]
        store.record_evaluation(0, *evaluation, [], lambda half: half.write_bytes(b"weights") and None)
        found = disk.after_a_cut()
        store.close()
    written = {str(path.relative_to(tmp_path)): path.read_bytes() for path in run.rglob("*.*")}
    assert {name: text for name, text in found.items() if not name.endswith("/lock")} == written
    assert len(written) == 6


def test_folders_are_made_durably(disk: Disk, tmp_path: Path) -> None:
    make_folder(tmp_path / "a" / "b")
    write_yaml(tmp_path / "a" / "b" / "c.yaml", {})
    assert list(disk.after_a_cut()) == ["a/b/c.yaml"]


# -- modes, and files of others -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o002, 0o664), (0o077, 0o600)])
def test_a_file_has_the_mode_of_a_new_file(tmp_path: Path, umask: int, mode: int) -> None:
    """However it is written: safetensors gives its files to their owner alone."""

    def private(path: Path) -> None:
        other = path.with_name("of a library")
        other.write_bytes(b"weights")
        other.chmod(0o600)
        other.replace(path)

    writers: tuple[Callable[[Path], Any], ...] = (private, lambda path: path.write_bytes(b"weights"))
    before = os.umask(umask)
    try:
        for number, write in enumerate(writers):
            path = tmp_path / f"{number}.safetensors"
            with replacing(path) as half:
                write(half)
            assert path.stat().st_mode & 0o777 == mode
    finally:
        os.umask(before)


def test_files_with_names_like_those_of_half_written_ones_stay(tmp_path: Path) -> None:
    names = ["table.csv.part", ".table.csv.part", ".table.csv.12345678.apf-parts", "12345678.apf-part"]
    for name in names:
        (tmp_path / name).write_text("mine")
    write_table(pd.DataFrame({"n": [1, 2]}), tmp_path / "table.csv")
    (tmp_path / ".table.csv.0123abcd.apf-part").write_text("of a killed process")
    remove_unfinished(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*names, "table.csv"])
    assert {(tmp_path / name).read_text() for name in names} == {"mine"}


def test_a_link_in_the_place_of_a_file_is_replaced_not_followed(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "run.yaml").symlink_to(tmp_path / "mine")
    write_yaml(tmp_path / "run.yaml", {})
    assert (tmp_path / "mine").read_text() == "mine"


# -- the lock -----------------------------------------------------------------------------------------------------


def test_a_lock_is_held_by_one_and_says_by_whom(tmp_path: Path) -> None:
    for _ in range(2):
        with locked(tmp_path):
            assert (tmp_path / "lock").read_text() == f"process {os.getpid()} on {os.uname().nodename}"
            with pytest.raises(InputError, match=f"process {os.getpid()} on .* works in it"), locked(tmp_path):
                pass
            assert (tmp_path / "lock").read_text().startswith("process ")


def test_a_lock_is_free_when_its_process_is_gone(tmp_path: Path) -> None:
    ready, told = os.pipe()
    child = os.fork()
    if child == 0:
        with locked(tmp_path):
            os.write(told, b"x")
            threading.Event().wait()
    os.read(ready, 1)
    with pytest.raises(InputError, match=f"process {child} on"), locked(tmp_path):
        pass
    os.kill(child, 9)
    os.waitpid(child, 0)
    with locked(tmp_path):
        assert f"process {os.getpid()} on" in (tmp_path / "lock").read_text()


def test_a_lock_that_is_a_link_empties_nothing(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    (tmp_path / "run").mkdir()
    for target in (tmp_path / "thesis.txt", tmp_path / "missing", tmp_path):
        (tmp_path / "run" / "lock").symlink_to(target)
        with pytest.raises(InputError, match="lock is not a file of its own"), locked(tmp_path / "run"):
            pass
        (tmp_path / "run" / "lock").unlink()
    assert (tmp_path / "thesis.txt").read_text() == "years of work"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run", "thesis.txt"]


def test_a_lock_file_of_somebody_else_is_held_and_not_written(tmp_path: Path) -> None:
    for text in ("", "mine", "process of marriage"):
        (tmp_path / "lock").write_text(text)
        with locked(tmp_path) as claim:
            assert (tmp_path / "lock").read_text() == text
            claim.abandon(TowerDomain())
        assert (tmp_path / "lock").read_text() == text


@pytest.mark.parametrize("replaced", [False, True])
def test_a_lock_that_went_with_an_abandoned_run_is_taken_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, replaced: bool
) -> None:
    """Two could work in it otherwise: one holds the file that is gone, one the file that is there."""
    opened, open_ = itertools.count(), os.open

    def removing(path: Any, *args: Any) -> int:
        descriptor = open_(path, *args)
        if Path(path).name == "lock" and next(opened) == 0:
            Path(path).unlink()
            if replaced:
                Path(path).write_text("")  # which does not call os.open
        return descriptor

    monkeypatch.setattr(os, "open", removing)
    with locked(tmp_path), pytest.raises(InputError, match="works in it"), locked(tmp_path):
        pass
    assert next(opened) == 3
