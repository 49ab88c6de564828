"""The site and the README: they build, their links lead somewhere, their commands and examples work."""

import importlib.util
import os
import re
import shlex
import subprocess
import sys
import textwrap
from collections import Counter
from pathlib import Path

import pandas as pd
import pytest
import yaml

import apf
from integration.command_line import CONF, REPOSITORY, TINY, call, child_environment

DOCS = REPOSITORY / "docs"
README = REPOSITORY / "README.md"
PAGES = [README, REPOSITORY / "CONTRIBUTING.md", *sorted(DOCS.glob("*.md"))]
FENCE = re.compile(r'^```(\w+)(?: title="([^"]+)")?\n(.*?)^```$', re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)#\s]+)[^)]*\)|<img[^>]*src=\"([^\"]+)\"")
MADE = {"configs.md", "contributing.md"}
"""Pages that are made when the site is built."""
COMMAND = re.compile(r"python -m apf\.main ([^\n`|]*)")
ELSEWHERE = ("resume=", "searchpath", "--", "hydra/sweeper=optuna", "install=")
"""Commands that need a run, a file or a plug-in of somebody's; those of extend.md are run below."""


def ids(path: Path) -> str:
    return str(path.relative_to(REPOSITORY))


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_links_lead_to_files(page: Path) -> None:
    for match in LINK.finditer(page.read_text()):
        link = match[1] or match[2]
        if not link.startswith(("https://", "http://", "mailto:")) and link not in MADE:
            assert (page.parent / link).exists(), link


def commands(page: Path) -> list[str]:
    """The arguments of the apf.main commands of a page, as they are typed, without comments."""
    found = [match[1].split("  #")[0].strip() for match in COMMAND.finditer(page.read_text())]
    return [text for text in found if text and not any(word in text for word in ELSEWHERE) and text.upper() != text]


def first(word: str) -> str:
    """Of an override of a sweep, the first of its values."""
    key, _, value = word.partition("=")
    if value.startswith("range("):
        return f"{key}=0"
    return word if "[" in value else f"{key}={value.split(',')[0]}"


@pytest.mark.parametrize(
    ("page", "text"), [pytest.param(page, text, id=f"{page.stem}: {text}") for page in PAGES for text in commands(page)]
)
def test_commands_compose(page: Path, text: str, here: Path) -> None:
    """What a page says to type can be composed; of a sweep, its first combination."""
    call(*[first(word) for word in shlex.split(text) if word != "-m"], "--cfg", "job").must_work()


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_commands_of_analysis_are_those_of_an_installed_apf(page: Path) -> None:
    text = page.read_text()
    assert "python analysis/" not in text, "it works in a checkout alone"
    for name in re.findall(r"python -m analysis\.(\w+)", text):
        assert (REPOSITORY / "analysis" / f"{name}.py").exists(), name


@pytest.mark.parametrize(
    "overrides",
    [
        "training.update=5",
        "training.batch=0",
        "training.batch=many",
        "sampler=greddy",
        "plans=20",
        "evaluation.length=50",
        "resume=nowhere",
        "domain=packing task=[tallest]",
        "sampler=complete sampler.score._target_=apf.acquisition.ExpectedBald",
    ],
)
def test_the_lines_of_troubleshooting_are_those_that_people_meet(overrides: str, here: Path) -> None:
    said = call(*overrides.split()).must_refuse().removeprefix("error: ").replace(str(here / "nowhere"), "DIR")
    page = (DOCS / "troubleshooting.md").read_text()
    lines = [
        line.split("`")[1].removesuffix(" ...").removesuffix("...") for line in page.splitlines() if line[:3] == "| `"
    ]
    assert any(said.startswith(line) for line in lines), said


def test_the_readme_is_short() -> None:
    assert len(README.read_text().splitlines()) <= 150


def test_the_citation_is_of_this_version_and_of_the_paper() -> None:
    citation = yaml.safe_load((REPOSITORY / "CITATION.cff").read_text())
    assert citation["version"] == apf.__version__
    assert citation["preferred-citation"]["url"] in README.read_text()


@pytest.mark.slow
def test_the_tutorial_plans_for_own_blocks(tiny_run: Path, here: Path) -> None:
    """Its block file and its commands, with a tiny run."""
    tutorial = (DOCS / "tutorial.md").read_text()
    rows = re.search(r"(?:^    (?:block,|\w+,-?[\d.]+,).*\n)+", tutorial, re.MULTILINE)
    assert rows is not None
    (here / "mine.csv").write_text(textwrap.dedent(rows[0]))
    (plan,) = re.findall(r"python -m apf\.plan (.*)", tutorial)
    (predict,) = re.findall(r"python -m apf\.predict (.*)", tutorial)
    (label,) = re.findall(r"python -m apf\.label (.*)", tutorial)
    call(*plan.replace("run=runs/first", f"run={tiny_run}").split(), command="apf.plan").must_work()
    call(*predict.replace("run=runs/first", f"run={tiny_run}").split(), command="apf.predict").must_work()
    call(*label.split(), command="apf.label").must_work()
    labels = pd.read_csv("labels.csv")
    assert list(labels) == ["tower", "position", "label"] and len(labels) == 3
    assert Path("plan.png").exists()


def test_every_key_and_comment_is_on_the_page_of_configs() -> None:
    """Each leaf of each YAML file, by the key that one types, with the words beside it."""
    page = page_of_configs()
    for path in sorted(CONF.rglob("*.yaml")):
        if path.is_relative_to(CONF / "hydra" / "help") or path.name == "resume.yaml":
            continue
        group = path.parent.relative_to(CONF).as_posix()
        title = "" if group == "." else f"{group}={path.stem}`"
        assert title in page, path
        for key in leaves(yaml.safe_load(path.read_text())):
            assert f"{key}`" in page, f"{path}: {key}"
        for comment in re.findall(r"\s# (.+)$", path.read_text(), re.MULTILINE):
            if not comment.startswith("@package"):
                assert " ".join(comment.split()).replace("|", "\\|") in page, f"{path}: {comment}"


def leaves(node: object) -> list[str]:
    """The keys of a config, joined by dots, without its defaults list."""
    if not isinstance(node, dict):
        return []
    inner = [(key, leaves(value)) for key, value in node.items() if key != "defaults"]
    return [text for key, keys in inner for text in ([f"{key}.{more}" for more in keys] or [str(key)])]


def test_the_page_of_configs_has_defaults_types_and_bounds() -> None:
    page = page_of_configs()
    assert "| `training.batch` | `64` | whole number, at least 1, at most 100,000,000 |" in page
    assert (
        "| `sampler.kind` | `subsequence` | `complete`, `subsequence`, `whole` | Theta_ss: every prefix is labelled |"
        in page
    )
    assert "| `sampler` | `sequential` |" in page, "the default option of a group"
    assert (
        "| `model.network.hidden` | `64` | whole number, at least 1, at most 4,096 | width of every hidden layer |"
        in page
    )


def page_of_configs() -> str:
    spec = importlib.util.spec_from_file_location("configs", DOCS / "hooks" / "configs.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["configs"] = module  # dataclasses look their module up
    try:
        spec.loader.exec_module(module)
        return module.page_of_configs(REPOSITORY)
    finally:
        del sys.modules["configs"]


@pytest.fixture(scope="module")
def extended(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files of extend.md: blocks of one name are parts of one file, in their order."""
    folder = tmp_path_factory.mktemp("extend")
    for _, name, text in blocks():
        if name:
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text((path.read_text() + "\n\n" if path.exists() else "") + text)
    return folder


def blocks() -> list[tuple[str, str, str]]:
    """Language, file name (or nothing) and text of each fenced block of extend.md."""
    return FENCE.findall((DOCS / "extend.md").read_text())


EXAMPLES = [text.strip() for language, _, text in blocks() if language == "bash"]


def test_extend_has_an_example_of_each_kind() -> None:
    folders = Counter(name.split("/")[1] for _, name, _ in blocks() if name.startswith("conf/"))
    assert set(folders) == {"sampler", "model", "world", "task", "domain"}
    assert len(EXAMPLES) == 6


@pytest.mark.slow
@pytest.mark.parametrize("command", EXAMPLES)
def test_examples_run(command: str, extended: Path, tmp_path: Path) -> None:
    """As they are typed, in their folder, but tiny."""
    tiny = " ".join(map(shlex.quote, (*TINY, f"hydra.run.dir={tmp_path / 'run'}")))
    command = command.replace("PYTHONPATH=.", "PYTHONPATH=.:$PYTHONPATH")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"  # `python` is the one that tests
    environment = child_environment(PATH=path)
    shell = ["bash", "-c", f"{command} {tiny}"]
    done = subprocess.run(shell, cwd=extended, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    assert yaml.safe_load((tmp_path / "run" / "run.yaml").read_text())["finished"]


@pytest.mark.slow
def test_the_site_builds(tmp_path: Path) -> None:
    """Without a warning: a broken link is one. Nothing is loaded from elsewhere."""
    pytest.importorskip("mkdocs", reason='needs pip install ".[docs]"')
    pytest.importorskip("mkdocstrings", reason='needs pip install ".[docs]"')
    site = tmp_path / "site"
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(site)]
    environment = child_environment(NO_MKDOCS_2_WARNING="1")
    done = subprocess.run(command, cwd=REPOSITORY, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    for path in sorted(site.rglob("*.html")):
        html = path.read_text()
        loaded = re.findall(r'<(?:script|img|link)[^>]*(?:src|href)="(https?://[^"]+)"', html)
        assert not loaded, f"{path.name} loads {loaded}"
    home = (site / "index.html").read_text()
    assert 'src="results/robot/build.gif"' in home and (site / "results" / "robot" / "build.gif").exists()
    api = (site / "api" / "domain.html").read_text()
    assert 'id="apf.domain.World.execute"' in api
