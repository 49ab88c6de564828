"""A run directory whose run.yaml or config.yaml somebody edited by hand: every reader says one line, or reads on."""

import itertools
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml

from apf.commands.relabel import domain_of
from apf.errors import InputError
from apf.report.runs import find_runs, label_runs
from apf.report.summary import print_summary
from apf.rundir.directory import check, finished, lengthen, reopen
from apf.rundir.kept import read_config, read_state
from apf.rundir.resume import go_where_it_began, resumed
from apf.rundir.store import Store
from apf.schema import Config
from apf.terminal import console
from integration.command_line import ANALYSIS, TINY, call, spawn

GONE = object()
"""In place of a value: the key is not there."""
VALUES: dict[str, Any] = {
    "gone": GONE,
    "null": None,
    "text": "[red]many",
    "empty text": "",
    "true": True,
    "number": 7,
    "negative": -1,
    "infinite": float("inf"),
    "list": [1],
    "list of null": [None],
    "mapping": {"a": 1},
    "mapping of null": {"a": None},
    "mapping of numbers": {3: [4]},
}
NEEDED_ALWAYS = ("name", "hash", "sweep", "choices", "versions", "finished", "seconds")
NEEDED_TO_GO_ON = (*NEEDED_ALWAYS, "id", "overrides", "cwd", "objects")


def edited(run: Path, file: str, key: str, value: Any) -> None:
    """Give a key of a YAML file, `a.b` of a mapping in it, another value."""
    content = yaml.safe_load((run / file).read_text())
    *outer, last = key.split(".")
    node = content
    for name in outer:
        node = node[name]
    if value is GONE:
        del node[last]
    else:
        node[last] = value
    (run / file).write_text(yaml.safe_dump(content, sort_keys=False))


@pytest.fixture
def run(tiny_run: Path, tmp_path: Path) -> Path:
    """A copy of a finished run."""
    return shutil.copytree(tiny_run, tmp_path / "run")


def readers(run: Path) -> Iterator[tuple[str, Callable[[], Any]]]:
    """What reads a run directory, with what it does."""
    config, domain = yaml.safe_load((run / "config.yaml").read_text()), domain_of(run)
    longer = {**config, "plans": config["plans"] + 2}

    def analyse() -> None:
        runs, _ = find_runs([run])
        label_runs(runs)

    def summarise() -> None:
        with (run.parent / "said.txt").open("w") as file:
            print_summary(run, console(file=file))

    yield "resume", lambda: resumed([f"resume={run}"], Config.__dataclass_fields__)
    yield "resume, where it began", lambda: go_where_it_began(run)
    yield "relabel", lambda: domain_of(run)
    yield "the same command again", lambda: check(run, config, domain)
    yield "a longer run", lambda: (check(run, longer, domain), lengthen(run, longer))
    yield "a sweep", lambda: finished(run)
    yield "a correction", lambda: reopen(run)
    yield "the store", lambda: Store(run, domain).close()
    yield "analysis", analyse
    yield "the summary", summarise


def keys_of(content: dict[str, Any]) -> Iterator[str]:
    """All keys of a file, and those of mappings in it that are not some part's own."""
    for key, value in content.items():
        yield key
        if isinstance(value, dict) and "_target_" not in value and len(value) < 6:
            yield from (f"{key}.{name}" for name in value if "." not in str(name))


def told(error: Exception, path: Path, key: str) -> bool:
    """Is it one line that names file and key?"""
    line = str(error)
    return line.isprintable() and path.parent.name in line and key.partition(".")[0] in line


@pytest.mark.parametrize(("file", "read"), [("run.yaml", read_state), ("config.yaml", read_config)])
def test_every_key_given_all_values(run: Path, file: str, read: Callable[[Path], Any]) -> None:
    """A file is read as it is, or refused in one line."""
    begun, refused, complaints = yaml.safe_load((run / file).read_text()), set(), []
    for key, kind in itertools.product(keys_of(begun), VALUES):
        (run / file).write_text(yaml.safe_dump(begun, sort_keys=False))
        edited(run, file, key, VALUES[kind])
        try:
            read(run)
        except InputError as error:
            refused.add((key, kind))
            if not told(error, run / file, key):
                complaints.append(f"{key} {kind}: {error}")
    assert complaints == []
    needed = NEEDED_TO_GO_ON if file == "run.yaml" else ("plans", "initial", "acquisition.plans", "model", "task")
    assert {(key, "gone") for key in needed} <= refused
    assert {(key, "list") for key in needed} <= refused


@pytest.mark.parametrize("file", ["run.yaml", "config.yaml"])
def test_every_reader(run: Path, file: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever reads it goes on as if nothing were wrong, or raises one line that names file and key."""
    monkeypatch.chdir(run.parent)
    begun = {name: (run / name).read_text() for name in ("run.yaml", "config.yaml")}
    complaints = []
    reading = list(readers(run))
    keys = NEEDED_TO_GO_ON if file == "run.yaml" else ("plans", "initial", "acquisition.plans", "domain", "world")
    for key, kind, (who, read) in itertools.product(keys, ("gone", "null", "mapping of null"), reading):
        for name, text in begun.items():
            (run / name).write_text(text)
        edited(run, file, key, VALUES[kind])
        try:
            read()
        except InputError as error:
            if not told(error, run / file, key):
                complaints.append(f"{who}: {key} {kind}: {error}")
        except Exception as error:
            complaints.append(f"{who}: {key} {kind}: a crash: {type(error).__name__}: {error}")
        else:
            if kind == "gone" and key in missed(who, file):
                complaints.append(f"{who}: {key} {kind}: accepted")
    assert complaints == []


def missed(who: str, file: str) -> tuple[str, ...]:
    """The keys that a reader must miss, if they are gone."""
    if file == "run.yaml":
        brief = {"analysis": NEEDED_ALWAYS, "the summary": NEEDED_ALWAYS, "relabel": ()}
        return brief.get(who, NEEDED_TO_GO_ON)
    whole = ("plans", "initial", "acquisition", "model", "world", "sampler", "task")
    return whole if who in ("resume", "relabel", "the same command again", "a longer run", "analysis") else ()


@pytest.mark.parametrize(
    ("file", "key", "value", "words"),
    [
        ("run.yaml", "id", GONE, "id is missing"),
        ("run.yaml", "sweep", 5, "sweep is 5"),
        ("run.yaml", "choices", None, "choices is null"),
        ("run.yaml", "finished", "yes, it has", "finished is 'yes, it has'"),
        ("run.yaml", "seconds", "a minute", "seconds is 'a minute'"),
        ("run.yaml", "files", ["plans.parquet"], "files is ['plans.parquet']"),
        ("config.yaml", "plans", GONE, "plans is missing"),
        ("config.yaml", "initial", GONE, "initial is missing"),
        ("config.yaml", "initial.train", None, "initial.train is null"),
        ("config.yaml", "world", "noisy", "world is 'noisy'"),
        ("config.yaml", "model.members", "ten", "model.members is 'ten'"),
        ("config.yaml", "model.network", None, "model.network"),
        ("config.yaml", "evaluation.lengths", [2, 2], "evaluation.lengths: 2 stands twice"),
        ("config.yaml", "evaluation.worlds", None, "evaluation.worlds"),
        ("config.yaml", "training.updates", GONE, "there is no such key"),
    ],
)
def test_resume(run: Path, file: str, key: str, value: Any, words: str) -> None:
    if words == "there is no such key":
        key, value = "training.update", 3
    edited(run, file, key, value)
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file() and path.name != "lock"}
    call(f"resume={run}").must_refuse(str(run / file), words)
    assert before == {path: path.read_bytes() for path in run.rglob("*") if path.is_file() and path.name != "lock"}


@pytest.mark.parametrize(
    "text",
    ["", "text", "- a\n- list\n", "a: [", "seconds: 2024-13-45", "1: 2\n", "[" * 5000, "a: \x00", "&a [*a]"],
)
@pytest.mark.parametrize("file", ["run.yaml", "config.yaml"])
def test_a_file_that_is_no_mapping(run: Path, file: str, text: str) -> None:
    (run / file).write_text(text)
    call(f"resume={run}").must_refuse(str(run / file))
    if file == "config.yaml" or text:
        with pytest.raises(InputError, match=file):
            find_runs([run])


def test_relabel(run: Path) -> None:
    table = pd.read_parquet(run / "plans.parquet")
    old = "".join("-" if pd.isna(label) else str(label) for label in table[table["tower"] == 9]["label"])
    new = "0" + "-" * (len(old) - 1) if old[0] == "1" else "1" * len(old)
    for file, key, value in (("config.yaml", "domain", None), ("config.yaml", "domain.training", 3)):
        kept = (run / file).read_text()
        edited(run, file, key, value)
        journal = (run / "journal.jsonl").read_bytes()
        call(f"run={run}", "plan=9", f"labels='{new}'", command="apf.relabel").must_refuse(str(run / file), key)
        assert (run / "journal.jsonl").read_bytes() == journal
        (run / file).write_text(kept)


def test_the_same_command(run: Path) -> None:
    edited(run, "run.yaml", "objects", GONE)
    call(*TINY, "world=analytic", f"hydra.run.dir={run}").must_refuse(str(run / "run.yaml"), "objects is missing")


@pytest.mark.parametrize(
    "script",
    [
        "keep",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("table_regret", "plot_accuracy", "claims", "table_robot")
        ),
    ],
)
def test_analysis(run: Path, tmp_path: Path, script: str) -> None:
    edited(run, "run.yaml", "choices", ["tgn"])
    spawn([ANALYSIS / f"{script}.py", run], cwd=tmp_path).must_refuse(str(run / "run.yaml"), "choices is ['tgn']")
