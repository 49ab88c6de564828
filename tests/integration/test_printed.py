"""Paths and names that hold brackets, colons, dollars are printed as they are, by every command; and can be typed."""

import re
import shlex
import shutil
import sys
from pathlib import Path

import pandas as pd
import pytest
import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import given
from hypothesis import strategies as st

from apf.launch.cli import typed
from apf.rng import stream
from apf.rundir.resume import quoted
from apf.terminal import console
from apf.towers import BlockSource, random_towers, write_towers
from integration.command_line import ANALYSIS, TINY, call, spawn

ODD = "[red]x/a[/b] task=[tallest] :tada: _$1_$"
"""Markup of rich, an emoji's name, and what matplotlib takes for mathematics."""
ANSI = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]")


@pytest.fixture(scope="module")
def odd_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, str]:
    """A finished run with figures in a folder of an odd name, and what its command printed, on a terminal."""
    folder = tmp_path_factory.mktemp("odd") / "runs" / ODD
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FORCE_COLOR", "1")
        patch.setenv("COLUMNS", "200")
        result = call(*TINY, f"hydra.run.dir={quoted(folder)}").must_work()
    return folder, ANSI.sub("", result.out), ANSI.sub("", result.err)


def test_a_run_on_a_terminal(odd_run: tuple[Path, str, str]) -> None:
    folder, _, err = odd_run
    assert f"{folder.name} in {folder}" in err.splitlines()
    assert err.splitlines()[-1] == str(folder)
    assert (folder / "figures" / "regret.png").exists()


def test_a_finished_run_and_a_refused_one(odd_run: tuple[Path, str, str]) -> None:
    folder, *_ = odd_run
    again = call(*TINY, f"hydra.run.dir={quoted(folder)}").must_work()
    assert again.err.strip() == f"{folder} holds this run already, finished"
    call(*TINY, f"hydra.run.dir={quoted(folder)}", "seed=1").must_refuse(f"{folder} holds a run of another config")


def test_relabel_and_resume(odd_run: tuple[Path, str, str], tmp_path: Path) -> None:
    folder = shutil.copytree(odd_run[0], tmp_path / ODD)
    table = pd.read_parquet(folder / "plans.parquet")
    old = "".join("-" if pd.isna(label) else str(label) for label in table[table["tower"] == 9]["label"])
    new = "0" + "-" * (len(old) - 1) if old[0] == "1" else "1" * len(old)
    done = call(f"run={quoted(folder)}", "plan=9", f"labels='{new}'", command="apf.relabel").must_work()
    advice = done.out.splitlines()[-1].partition(": ")[2]
    assert shlex.split(advice)[3:] == [f"resume={folder}"]
    resumed = call(*shlex.split(advice)[3:], "tracker=none").must_work()
    assert resumed.err.splitlines()[-1] == str(folder)


def test_label(here: Path) -> None:
    blocks = BlockSource().load()
    (here / "[red]in").mkdir()
    write_towers(random_towers(blocks, 3, 4, stream(0, "test")), here / "[red]in" / "a[b].csv")
    given_paths = [f"plans={quoted('[red]in/a[b].csv')}", f"out={quoted('[/b]/:tada:.csv')}"]
    assert call(*given_paths, command="apf.label").must_work().out.startswith("[/b]/:tada:.csv: 4 plans labelled")


def test_a_sweep(here: Path) -> None:
    result = call("-m", *TINY, "world=noisy,analytic", f"sweep={quoted(ODD)}", "threads=900")
    lines = [line for line in result.err.splitlines() if line.startswith("failed")]
    assert [line.split()[1].split("-")[2] for line in lines] == ["noisy", "analytic"]
    names = call(*TINY, "hydra.sweep.subdir='[red]a[tallest]'", "seed=-1", "-m")
    assert "failed            [red]a[tallest]: seed is -1" in names.err


def test_analysis(odd_run: tuple[Path, str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = tmp_path / "[red]x"
    for name in ("[/b]", "$x$"):
        copy = shutil.copytree(odd_run[0], runs / name / odd_run[0].name)
        for file, key, value in (("config.yaml", "sweep", name), ("run.yaml", "sweep", name)):
            content = yaml.safe_load((copy / file).read_text())
            (copy / file).write_text(yaml.safe_dump({**content, key: value}))
        config = yaml.safe_load((copy / "config.yaml").read_text())
        config["domain"]["training"]["prefix"] = f"_{name}"  # a key by which runs differ: its value is in the legend
        (copy / "config.yaml").write_text(yaml.safe_dump(config))
    table = spawn([ANALYSIS / "table_regret.py", runs, "--out", tmp_path / "[b].csv"], cwd=tmp_path).must_work()
    assert "domain.training.prefix=_[/b]" in table.out
    curves = spawn([ANALYSIS / "plot_regret.py", runs], cwd=tmp_path).must_work()
    assert "domain.training.prefix=_$x$: 1 run" in curves.out
    assert str(runs / "regret.png") in curves.out.splitlines()
    kept = spawn([ANALYSIS / "keep.py", runs, "--out", tmp_path / "[/kept]"], cwd=tmp_path).must_work()
    assert str(tmp_path / "[/kept]" / "[/b]" / odd_run[0].name) in kept.out.splitlines()


def test_a_robot_table(odd_run: tuple[Path, str, str], tmp_path: Path) -> None:
    folder = shutil.copytree(odd_run[0], tmp_path / "a[b][red]")
    columns = ["purpose", "outcome", "tower", "plans", "replans", "regrasps", "simulated", "wall", "planning", "error"]
    pd.DataFrame([["build", "done", 0, 1, 0, 0, 1.0, 1.0, 0.1, 0.001]], columns=columns).to_parquet(
        folder / "world.parquet"
    )
    table = spawn([ANALYSIS / "table_robot.py", folder], cwd=tmp_path).must_work()
    assert "a[b][red]" in table.out
    assert "simulated time [h]" in table.out


def test_names_that_are_no_text(tmp_path: Path) -> None:
    """A file name of bytes that are no UTF-8, as other systems write them: shown escaped, where it cannot be shown."""
    code = "import sys; from apf.terminal import accept_any_name; accept_any_name(); print('a\\udcffb')"
    assert spawn(["-c", code], cwd=tmp_path).must_work().out == "a\\udcffb\n"


def test_a_long_path_is_not_broken(capsys: pytest.CaptureFixture[str]) -> None:
    console(width=20).print("[a]" * 30)
    assert capsys.readouterr().out == "[a]" * 30 + "\n"


@pytest.mark.parametrize(
    ("argument", "line"),
    [
        ("hydra.run.dir=runs/a[/b]", "in others: \"hydra.run.dir='runs/a[/b]'\""),
        ("hydra.run.dir=[red]x", "in others: \"hydra.run.dir='[red]x'\""),
        ("sweep=it's", "in others: \"sweep='it\\'s'\""),
        ("sweep=a{b", "in others: \"sweep='a{b'\""),
        ("sweep=a=b", "in others: \"sweep='a=b'\""),
        ("sweep=(x", "in others: \"sweep='(x'\""),
        ("a b", "an argument is KEY=VALUE"),
        ("seed=range(1,2,3,4)", "too many positional arguments"),
        ("experiment=smoke", "+experiment=smoke"),
    ],
)
def test_what_hydra_cannot_read(here: Path, argument: str, line: str) -> None:
    said = call(*TINY, argument).must_refuse(argument, line)
    assert "Exception" not in said
    assert "mismatched" not in said
    assert list(here.iterdir()) == []


def test_the_advice_works(here: Path) -> None:
    said = call(*TINY, "hydra.run.dir=runs/a[/b]").must_refuse()
    [advice] = shlex.split(said.rpartition(": ")[2])
    call(*TINY, advice, "--cfg", "job").must_work()


@given(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\x00")))
def test_any_text_can_be_typed(value: str) -> None:
    [argument] = shlex.split(typed("sweep", value))
    assert OverridesParser.create().parse_override(argument).value() == value


MINE = '''
from apf.settings import settings
from apf.towers import AnalyticWorld


@settings
class Mine(AnalyticWorld):
    """A world of one's own."""
'''


def test_a_class_in_the_current_folder(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The console script does not look there by itself, as `python -m` does."""
    (here / "my_world.py").write_text(MINE)
    script = f"import sys; sys.path[0] = {str(Path(sys.prefix) / 'bin')!r}; from apf.main import main; main()"
    done = spawn(["-c", script, *TINY, "world._target_=my_world.Mine", "~world.noise", "hydra.run.dir=run"], cwd=here)
    done.must_work()
    assert yaml.safe_load((here / "run" / "config.yaml").read_text())["world"] == {"_target_": "my_world.Mine"}
    call(*TINY, "world._target_=your_world.Mine").must_refuse(
        "world._target_ is your_world.Mine; there is no module your_world"
    )
