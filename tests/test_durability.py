"""After a power cut a disk holds what was synced, and perhaps no more: what the package calls durable is in that."""

import os
import stat
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from apf.acquisition import Scored
from apf.files import replacing, write_yaml
from apf.journal import Journal
from apf.planning import ACCURACY_COLUMNS, REGRET_COLUMNS
from apf.store import Store
from apf.tables import write_table
from apf.towers import TowerDomain


class Disk:
    """What would be left after a power cut now: files and folders as they were when last synced, by their inode."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.files: dict[int, bytes] = {}
        self.folders: dict[int, dict[str, int]] = {}
        fsync, replace = os.fsync, os.replace

        def noted_fsync(file: int) -> None:
            fsync(file)
            inode, mode = os.fstat(file).st_ino, os.fstat(file).st_mode
            if stat.S_ISDIR(mode):
                self.folders[inode] = {entry.name: entry.inode() for entry in os.scandir(file)}
            else:
                self.files[inode] = Path(f"/proc/self/fd/{file}").read_bytes()

        def checked_replace(half: Path, path: Path) -> None:
            assert self.files.get(Path(half).stat().st_ino) == Path(half).read_bytes(), f"{path} could become empty"
            replace(half, path)

        monkeypatch.setattr(os, "fsync", noted_fsync)
        monkeypatch.setattr(os, "replace", checked_replace)

    def read(self, path: Path) -> bytes | None:
        """What would be found under this name."""
        inode = self.folders.get(path.parent.stat().st_ino, {}).get(path.name)
        return None if inode is None else self.files.get(inode)

    def holds(self, path: Path) -> bool:
        """Would the file be there as it is now?"""
        return self.read(path) == path.read_bytes()


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    return Disk(monkeypatch)


def test_what_was_only_written_is_lost(disk: Disk, tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_text("not synced")
    assert disk.read(path) is None


def test_a_record_is_durable_once_append_returns(disk: Disk, tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    journal = Journal(path)
    assert path.name in disk.folders[tmp_path.stat().st_ino], "the file's own name"
    assert not journal.torn
    for number in range(3):
        journal.append("label", tower=number)
        assert disk.holds(path)
    assert (disk.read(path) or b"").count(b"\n") == 3
    journal.close()


def test_a_torn_record_is_gone_for_good_once_the_journal_is_open(disk: Disk, tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    journal = Journal(path)
    journal.append("label", tower=0)
    whole = path.read_bytes()
    journal.close()
    path.write_bytes(whole + b"torn")
    journal = Journal(path)
    journal.close()
    assert disk.read(path) == whole == path.read_bytes()
    assert journal.torn
    journal = Journal(path)
    journal.close()
    assert not journal.torn
    assert path.read_bytes() == whole


def test_labels_weights_and_tables_are_durable(disk: Disk, domain: TowerDomain, tmp_path: Path) -> None:
    store = Store(tmp_path, domain)
    journal = tmp_path / "journal.jsonl"
    plans = domain.random_plans(2, 1, np.random.default_rng(0))
    steps: list[Callable[[], None]] = [
        lambda: store.plan(0, [Scored(plans, 0.5)], ["train"]),
        lambda: store.record(0, np.array([1, 0])),
        lambda: store.record_training(0, {"loss/train": 0.5}),
        lambda: store.correct(0, "11", "misread"),
    ]
    for step in steps:
        before = disk.read(journal)
        step()
        assert disk.holds(journal)
        assert disk.read(journal) != before
    regret, accuracy = pd.DataFrame(columns=REGRET_COLUMNS), pd.DataFrame(columns=ACCURACY_COLUMNS)
    store.record_evaluation(0, regret, accuracy, lambda path: path.write_bytes(b"weights") and None)
    for path in (journal, store.weights(0), *(tmp_path / f"{name}.parquet" for name in ("towers", "regret"))):
        assert disk.holds(path)
    store.close()


@pytest.mark.parametrize("before", [None, b"old"])
def test_a_file_takes_the_place_of_another_once_it_is_durable(disk: Disk, tmp_path: Path, before: bytes | None) -> None:
    path = tmp_path / "a.txt"
    if before:
        path.write_bytes(before)
    with replacing(path) as half:
        half.write_bytes(b"new")
        assert (path.read_bytes() if path.exists() else None) == before
    assert path.read_bytes() == disk.read(path) == b"new"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.txt"]


def test_a_file_that_fails_half_way_leaves_the_old_one(disk: Disk, tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"old")
    with pytest.raises(OSError, match="full"), replacing(path) as half:
        half.write_bytes(b"ne")
        raise OSError("full")
    assert path.read_bytes() == b"old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.txt"]


def test_yaml_files_and_tables_are_durable(disk: Disk, tmp_path: Path) -> None:
    write_yaml(tmp_path / "a.yaml", {"name": "ä", "first": 1})
    assert (tmp_path / "a.yaml").read_text() == "name: ä\nfirst: 1\n"
    write_table(pd.DataFrame({"a": [1]}), tmp_path / "new" / "a.csv")
    write_table(pd.DataFrame({"a": [1]}), tmp_path / "a.parquet")
    for path in (tmp_path / "a.yaml", tmp_path / "new" / "a.csv", tmp_path / "a.parquet"):
        assert disk.holds(path)
