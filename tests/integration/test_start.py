"""What a command does before it works: it says its version, its help and its completions, and waits for no library."""

import re
import runpy
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import apf
from apf.source import Commit, commit_of, version_line
from integration.command_line import MAINS, REPOSITORY, call, child_environment, spawn

HEAVY = ("torch", "pandas", "numpy", "matplotlib", "wandb", "pybullet")
PROBE = """
import sys
from importlib import import_module
name, *sys.argv[1:] = sys.argv[1:]
try:
    import_module(name).main()
finally:
    print("loaded:", *[library for library in {heavy} if library in sys.modules])
"""


def loaded(command: str, *arguments: str, cwd: Path, **environment: str) -> tuple[str, str]:
    """What a command printed, and which heavy libraries it had imported by its end."""
    result = spawn(["-c", PROBE.format(heavy=HEAVY), command, *arguments], cwd, **environment)
    return result.out + result.err, result.out.rpartition("loaded:")[2].strip()


@pytest.mark.parametrize("command", MAINS)
@pytest.mark.parametrize("arguments", [("--help",), ("--version",)], ids=" ".join)
def test_help_and_version_import_no_heavy_library(tmp_path: Path, command: str, arguments: tuple[str, ...]) -> None:
    said, libraries = loaded(command, *arguments, cwd=tmp_path)
    assert ("Usage" if arguments == ("--help",) else f"apf {apf.__version__}") in said
    assert libraries == ""


def test_completion_imports_no_heavy_library(tmp_path: Path) -> None:
    said, libraries = loaded("apf.main", "-sc", "install=bash", cwd=tmp_path)
    assert "complete " in said
    assert libraries == ""
    line = "apf sampler="
    said, libraries = loaded("apf.main", "-sc", "query=bash", cwd=tmp_path, COMP_LINE=line, COMP_POINT=str(len(line)))
    assert {"sampler=greedy", "sampler=sequential"} <= set(said.split())
    assert libraries == ""


@pytest.mark.parametrize("command", MAINS)
def test_a_wrong_key_imports_no_heavy_library(tmp_path: Path, command: str) -> None:
    given = ("run=x", "world=noisy") if command == "apf.evaluate" else ()
    said, libraries = loaded(command, *given, "seeed=1", cwd=tmp_path)
    assert "error: seeed: there is no such key" in said
    assert libraries == ""


@pytest.mark.parametrize("command", ["apf.panda.show", "apf.panda.sheets"])
def test_a_command_of_the_robot_names_the_extra_that_is_missing(tmp_path: Path, command: str) -> None:
    without = f"import sys; sys.modules.update(pybullet=None, cv2=None); import {command} as it; it.main()"
    result = spawn(["-c", without, "tower=a.csv" if command == "apf.panda.show" else "blocks=a.csv"], tmp_path)
    result.must_refuse(f"{command} needs ", "pip install 'apf[panda]'")


@pytest.mark.parametrize("command", MAINS)
def test_version_of_every_command(command: str) -> None:
    assert call("--version", command=command).must_work().out == version_line() + "\n"


def test_hydras_page_is_printed_where_more_is_asked(tmp_path: Path) -> None:
    """Our page has what Hydra's has, and the sweeps; not what they alone use."""
    asked = (["--help"], ["--help", "seed=1"])
    ours, hydras = (spawn(["-m", "apf.main", *words], tmp_path).must_work().out for words in asked)
    ((mine, theirs),) = [(a, b) for a, b in zip(ours.splitlines(), hydras.splitlines(), strict=True) if a != b]
    assert theirs.startswith("experiment:")
    assert {*mine.replace(",", "").split()} - {*theirs.replace(",", "").split()} > {"strategies", "paper"}


def test_every_command_is_a_console_script() -> None:
    scripts = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]["scripts"]
    for target in scripts.values():
        module, _, function = target.partition(":")
        assert callable(runpy.run_module(module, run_name="started")[function])
    assert {target.partition(":")[0] for target in scripts.values()} == {*MAINS, "apf.dashboard"}


def git(folder: Path, *arguments: str) -> str:
    identity = ["-c", "user.name=a", "-c", "user.email=a@b"]
    command = ["git", "-C", str(folder), *identity, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True, env=child_environment()).stdout.strip()


def test_the_commit_of_a_checkout(tmp_path: Path) -> None:
    package = tmp_path / "checkout" / "package"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    assert commit_of(package) is None, "no repository"
    git(package.parent, "init", "-q")
    commit_of.cache_clear()
    assert commit_of(package) is None, "a repository that does not hold the package, as around an environment"
    git(package.parent, "add", ".")
    git(package.parent, "commit", "-qm", "first")
    commit_of.cache_clear()
    assert commit_of(package) == Commit(git(package, "rev-parse", "HEAD"), dirty=False)
    (package / "__init__.py").write_text("changed = True")
    commit_of.cache_clear()
    found = commit_of(package)
    assert found is not None and found.dirty
    assert re.fullmatch(r"[0-9a-f]{7}, changed since", str(found))
    commit_of.cache_clear()


def test_without_git(tmp_path: Path) -> None:
    code = "from apf.source import version_line; print(version_line())"
    result = spawn(["-c", code], cwd=tmp_path, PATH=str(tmp_path), PYTHONPATH=":".join(sys.path)).must_work()
    assert result.out == f"apf {apf.__version__}\n"
