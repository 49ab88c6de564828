"""Somebody else's run directory is data: whatever its files say, nothing of it is called, looked up, or imported."""

import contextlib
import os
import shutil
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import yaml
from hydra.core.plugins import Plugins

import apf.commands.run
from integration.command_line import TINY, call, spawn
from integration.test_plugin import CODE

pytestmark = pytest.mark.usefixtures("no_figures")
TRAP = """
from pathlib import Path
from apf.settings import settings
from apf.towers import TowerDomain
from apf.towers import AnalyticWorld

Path(__file__).with_name("sprung").touch()


@settings
class World(AnalyticWorld):
    pass


@settings
class Domain(TowerDomain):
    pass


def make(**anything):
    return World()
"""


@pytest.fixture(scope="module")
def began(once: Callable) -> Path:
    """A finished run, to be copied."""
    folder, result = once("foreign", lambda folder: call(*TINY, f"hydra.run.dir={folder / 'run'}"))
    result.must_work()
    return folder / "run"


@pytest.fixture
def foreign(here: Path, began: Path) -> Path:
    """The run in run/, as it came from somebody else."""
    shutil.copytree(began, here / "run")
    edit(here / "run", "run.yaml", "cwd", str(here))
    return here / "run"


def edit(run: Path, name: str, key: str, value: Any) -> None:
    """Put a value into config.yaml or run.yaml, as somebody else may have."""
    content = yaml.safe_load((run / name).read_text())
    node = content
    *outer, last = key.split("/")
    for part in outer:
        node = node[part]
    node[last] = value
    (run / name).write_text(yaml.safe_dump(content, sort_keys=False))


def must_be_refused(run: Path, *words: str) -> None:
    """By a resume in one line, as it is."""
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file() and path.name != "lock"}
    call("resume=run").must_refuse(*words)
    assert {path: path.read_bytes() for path in before} == before


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> None:
    """What runs import late is there: without exec, nothing can be imported."""
    with contextlib.suppress(ImportError):
        import_module("apf.panda.show")
        import_module("apf.panda.commands.show")
    Plugins.instance()  # Hydra imports these when it is first used
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(apf.commands.run, "save_figures", lambda directory: None)
        call(*TINY, f"hydra.run.dir={tmp_path_factory.mktemp('imported')}").must_work()


@pytest.fixture
def calls(imported: None, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Notes what these tests' configs would have called, had it been called."""
    called: list[str] = []

    def noting(name: str) -> Callable[..., None]:
        return lambda *args, **kwargs: called.append(name)

    for name in ("pandas.read_pickle", "os.system", "subprocess.Popen", "shutil.rmtree", "builtins.exec"):
        module, _, function = name.rpartition(".")
        monkeypatch.setattr(sys.modules[module], function, noting(name))
    return called


TARGETS = [
    {"_target_": "pandas.read_pickle", "filepath_or_buffer": "evil.pkl"},
    {"_target_": "builtins.exec", "_args_": ["raise SystemExit('called')"]},
    {"_target_": "os.system", "command": "touch sprung"},
    {"_target_": "subprocess.Popen", "args": ["touch", "sprung"]},
    {"_target_": "functools.partial", "_args_": ["os.system"]},
    {"_target_": "pathlib.Path.touch", "self": "sprung"},
    {"_target_": "apf.rundir.files.Path", "_args_": ["x"]},
    {"_target_": "apf.rundir.files.write_yaml", "path": "sprung", "content": {}},
    {"_target_": "apf.main.main"},
    {"_target_": "apf.rundir.store.Store", "directory": "sprung"},
    {"_target_": "apf.main.run_command"},
    {"_target_": "hydra.utils.call", "config": {"_target_": "os.system", "command": "touch sprung"}},
    {"_target_": "antigravity.fly"},
    {"_target_": "this.s"},
    {"_target_": "__main__.x"},
    {"_target_": "..x"},
    {"_target_": "apf"},
    {"_target_": ["os.system"]},
    {"_target_": {"_target_": "os.system"}},
    {"_target_": None},
    {"_target_": 3},
]
PLACES = ["world", "tracker", "domain", "sampler", "sampler/score", "task/tallest", "predictor", "planner", "training"]


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: str(target["_target_"]))
@pytest.mark.parametrize("place", ["world", "tracker"])
def test_only_what_fits_its_place(foreign: Path, calls: list[str], place: str, target: dict) -> None:
    edit(foreign, "config.yaml", place, target)
    must_be_refused(foreign, f"{place}.")
    edit(foreign, "config.yaml", place, target | {"_partial_": True})
    must_be_refused(foreign, f"{place}.")
    assert calls == []
    assert not Path("sprung").exists()


@pytest.mark.parametrize("place", [*PLACES, "model", "model/network", "evaluation/worlds/noisy", "initial", "seed"])
def test_every_place(foreign: Path, calls: list[str], place: str) -> None:
    """Also inside of what fits, in a list, and under a key that is none."""
    original = yaml.safe_load((foreign / "config.yaml").read_text())
    pickle = {"_target_": "pandas.read_pickle", "filepath_or_buffer": "evil.pkl"}
    edit(foreign, "config.yaml", place, pickle)
    must_be_refused(foreign, place.replace("/", "."))
    (foreign / "config.yaml").write_text(yaml.safe_dump(original, sort_keys=False))
    for inner in (pickle, [pickle], {"deep": {"er": [[pickle]]}}):
        if place != "seed":
            edit(foreign, "config.yaml", f"{place}/more", inner)
            must_be_refused(foreign, place.replace("/", "."))
            (foreign / "config.yaml").write_text(yaml.safe_dump(original, sort_keys=False))
    assert calls == []


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("world/_args_", [0.003]),
        ("world/_recursive_", False),
        ("world/_convert_", "object"),
        ("world/_partial_", True),
        ("world/_partial_", None),
        ("world/_partial_", "yes"),
        ("model/network/_partial_", False),
        ("model/network/_target_", "apf.models.layers.EnsembleLinear"),
        ("model/network/_target_", "apf.towers.AnalyticWorld"),
        ("world/_target_", "apf.towers.Tallest"),
        ("world/_target_", "apf.domain.world.labels_from"),
        ("evaluation/_target_", "apf.planning.EvaluationSettings.__init__"),
        ("training/_partial_", True),
        ("_target_", "apf.schema.Config"),
        ("_partial_", True),
        ("hydra", {"searchpath": ["file://evil"]}),
        ("hydra", {"callbacks": {"x": {"_target_": "os.system", "command": "touch sprung"}}}),
        ("defaults", [{"override hydra/launcher": "basic"}]),
        ("world/defaults", [{"/hydra/callbacks": "evil"}]),
        ("nonsense", 1),
        ("world", None),
        ("seed", None),
        ("task", ["tallest"]),
    ],
)
def test_keys_that_are_none_of_a_run(foreign: Path, calls: list[str], key: str, value: Any) -> None:
    edit(foreign, "config.yaml", key, value)
    must_be_refused(foreign, key.partition("/")[0])
    assert calls == []


def test_texts_refer_to_nothing(foreign: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`${oc.env:SECRET}` is these characters, no secret that then leaves this machine by a tracker."""
    monkeypatch.setenv("SECRET", "12345")
    for text in ("${oc.env:SECRET}", "${seed}", "${run_name:}", "${hydra:job.name}", "\\${x}", "${nonsense"):
        edit(foreign, "config.yaml", "sweep", text)
        assert "finished" in call("resume=run").must_work().err
        edit(
            foreign, "config.yaml", "tracker", {"_target_": "apf.tracking.WandbTracker", "project": text, "mode": text}
        )
        must_be_refused(foreign, "tracker.mode", text)
        edit(foreign, "config.yaml", "tracker", {"_target_": "apf.tracking.NoTracker"})
    edit(foreign, "config.yaml", "seed", "${oc.env:SECRET}")
    must_be_refused(foreign, "seed", "${oc.env:SECRET}")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("overrides", ["world._target_=os.system", "hydra.searchpath=[file://evil]", "${oc.env:SECRET}"]),
        ("hydra", ["--config-dir", "evil", "hydra.callbacks.x._target_=os.system", "hydra/launcher=evil"]),
        ("choices", {"hydra/callbacks": "evil", "hydra": "evil", "../../evil": "x", "world@hydra.callbacks": "evil"}),
        ("choices", ["world"]),
        ("choices", {"world": {"_target_": "os.system"}, "seed": "x", "world@a.b": "x", "": "", "domain/training": []}),
        ("choices", None),
        ("cwd", "/nowhere"),
        ("cwd", ["x"]),
        ("cwd", None),
    ],
)
def test_run_yaml_decides_nothing(foreign: Path, calls: list[str], key: str, value: Any) -> None:
    """What is of the wrong form is refused; what else stands there changes nothing."""
    edit(foreign, "run.yaml", "finished", False)
    edit(foreign, "run.yaml", key, value)
    forms = {"overrides": list, "choices": dict, "cwd": str}
    nested = isinstance(value, dict) and any(isinstance(choice, dict) for choice in value.values())
    result = call("resume=run")
    assert calls == []
    if not isinstance(value, forms.get(key, object)) or nested:
        result.must_refuse("run.yaml", key)
        return
    result.must_work()
    assert yaml.safe_load((foreign / "run.yaml").read_text())["finished"] is True


@pytest.mark.parametrize("where", ["domain", "domain/training", "domain/training/file", "domain/offset"])
def test_a_correction_calls_nothing_either(foreign: Path, calls: list[str], where: str) -> None:
    edit(foreign, "config.yaml", where, {"_target_": "pandas.read_pickle", "filepath_or_buffer": "evil.pkl"})
    line = call("run=run", "plan=0", "labels=0", command="apf.relabel").must_refuse(where.replace("/", "."))
    assert "pandas.read_pickle" in line
    assert calls == []


def test_files_that_the_config_names_are_not_read(foreign: Path) -> None:
    """A pipe would wait for ever. The block sets are those of the directory."""
    os.mkfifo(foreign.parent / "pipe.csv")
    edit(foreign, "config.yaml", "domain/training/file", str(foreign.parent / "pipe.csv"))
    assert "finished" in call("resume=run").must_work().err


@pytest.mark.parametrize("value", [None, "text", 3, ["x"], {"a": 1}, ...])
@pytest.mark.parametrize(
    ("name", "key"),
    [
        *(("run.yaml", key) for key in ("id", "name", "sweep", "objects", "finished", "files", "versions", "seconds")),
        *(("config.yaml", key) for key in ("plans", "initial", "acquisition", "seed", "world", "task", "threads")),
    ],
)
def test_what_was_edited_by_hand(foreign: Path, name: str, key: str, value: Any) -> None:
    """Missing keys, null, text: in one line, or as if it were nothing; by resume and by the command of the start."""
    content = yaml.safe_load((foreign / name).read_text())
    content[key] = value
    if value is ...:
        del content[key]
    (foreign / name).write_text(yaml.safe_dump(content, sort_keys=False))
    for arguments in (("resume=run",), (*TINY, "hydra.run.dir=run"), (*TINY, "plans=14", "hydra.run.dir=run")):
        result = call(*arguments)
        if result.code:
            assert key in (line := result.must_refuse()) or "is the journal of run" in line
    relabelled = call("run=run", "plan=0", "labels=0", command="apf.relabel")
    if relabelled.code:
        relabelled.must_refuse()


ALIAS = "a: &a [x, x, x, x, x, x, x, x]\nb: &b [*a, *a, *a, *a, *a, *a, *a, *a]\nseed: [*b, *b]\n"


@pytest.mark.parametrize("name", ["config.yaml", "run.yaml"])
@pytest.mark.parametrize(
    "text",
    [
        "!!python/object/apply:os.system [touch sprung]\n",
        "seed: !!python/name:os.system\n",
        "seed: &a [*a]\n",
        ALIAS,
        "[" * 5000,
        "seed: 2026-13-45\n",
        "\x00",
        "",
        "seed: " + "{a: " * 400 + "}" * 400,
        "- list\n",
    ],
)
def test_yaml_that_is_more_than_values(foreign: Path, calls: list[str], name: str, text: str) -> None:
    (foreign / name).write_text(text)
    must_be_refused(foreign, name)
    call("run=run", "plan=0", "labels=0", command="apf.relabel").must_refuse(name)
    assert calls == []


def test_a_file_that_would_grow(foreign: Path) -> None:
    """By aliases, or by nesting."""
    text = (foreign / "config.yaml").read_text()
    for more, words in (("&a [x]\n  again: *a", ("config.yaml", "alias")), ("{a: " * 400 + "}" * 400, ("nested",))):
        (foreign / "config.yaml").write_text(text.replace("\ntracker:\n", f"\ntracker:\n  more: {more}\n"))
        must_be_refused(foreign, *words)


@pytest.mark.parametrize("target", ["trap.World", "trap.Domain", "trap.make", "trap"])
def test_a_module_in_the_directory_is_not_imported(foreign: Path, monkeypatch: pytest.MonkeyPatch, target: str) -> None:
    """Not even where it is the current folder, which Python looks in first."""
    (foreign / "trap.py").write_text(TRAP)
    place = "domain" if target.endswith("Domain") else "world"
    edit(foreign, "config.yaml", f"{place}/_target_", target)
    monkeypatch.setattr(sys, "path", [str(foreign), "", *sys.path])
    monkeypatch.chdir(foreign)
    call("resume=.").must_refuse(place, target)
    if place == "domain":
        call(f"run={foreign}", "plan=0", "labels=0", command="apf.relabel").must_refuse("domain", target)
    assert "trap" not in sys.modules
    assert not (foreign / "sprung").exists()


@pytest.mark.parametrize("source", ["", "import os\n", "# import apf\n", "x = 'import apf'\n"])
def test_a_module_that_is_not_made_for_apf_is_not_imported(
    foreign: Path, monkeypatch: pytest.MonkeyPatch, source: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("mine")
    (folder / "tidy_up.py").write_text(f"{source}\nraise SystemExit('imported')\n")
    monkeypatch.syspath_prepend(str(folder))
    edit(foreign, "config.yaml", "world/_target_", "tidy_up.World")
    must_be_refused(foreign, "world._target_", "tidy_up is not made for apf")


def test_ones_own_classes_go_on_with_the_same_command(
    here: Path, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("plugin")
    (folder / "my_notions.py").write_text(CODE)
    monkeypatch.syspath_prepend(str(folder))
    given = ("world._target_=my_notions.Earthquake", "~world.noise", "+world.highest=2")
    call(*TINY, *given, "hydra.run.dir=run").must_work()
    call("resume=run", "plans=14").must_work()
    edit(here / "run", "config.yaml", "world/_target_", "my_notions.Widest")
    must_be_refused(here / "run", "world._target_", "my_notions.Widest", "apf.domain.world.World")
    edit(here / "run", "config.yaml", "world/_target_", "my_notions.np.load")
    must_be_refused(here / "run", "world._target_", "my_notions.np.load")


@pytest.mark.parametrize("name", ["run.log", "journal.jsonl", "weights", "figures", "plans.parquet", "run.yaml"])
def test_links_do_not_lead_out(foreign: Path, name: str) -> None:
    """What a run writes, it writes in its directory."""
    mine = foreign.parent / "mine"
    (foreign / name).rename(mine) if (foreign / name).exists() else mine.mkdir()
    (foreign / name).symlink_to(mine)
    call("resume=run").must_refuse(name, "link")
    call("run=run", "plan=0", "labels=0", command="apf.relabel").must_refuse(name, "link")


@pytest.mark.parametrize("command", ["apf.label", "apf.panda.show"])
def test_the_other_commands_are_guarded_too(here: Path, calls: list[str], command: str) -> None:
    word = "tower" if command.endswith("show") else "plans"
    for given in ("world._target_=pandas.read_pickle", "+world.more={_target_:pandas.read_pickle}"):
        call(
            f"{word}=mine.csv", "out=out.mp4" if word == "tower" else "out=out.csv", given, command=command
        ).must_refuse("world.", "pandas.read_pickle")
    assert calls == []


@pytest.mark.slow
def test_in_a_process_of_its_own(tmp_path: Path) -> None:
    spawn(["-m", "apf.main", *TINY, "hydra.run.dir=run"], cwd=tmp_path).must_work()
    (tmp_path / "run" / "trap.py").write_text(TRAP)
    edit(tmp_path / "run", "config.yaml", "world/_target_", "trap.World")
    for folder, resume in ((tmp_path, "resume=run"), (tmp_path / "run", "resume=.")):
        spawn(["-m", "apf.main", resume], cwd=folder).must_refuse("world", "trap")
        assert not (tmp_path / "run" / "sprung").exists()
