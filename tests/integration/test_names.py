"""Names of the runs of a sweep, and what run.yaml says of where a run comes from."""

import re
import socket
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

import apf
from apf.config.values import config_hash
from apf.launch.names import MOST, words_for
from apf.rundir.provenance import cpu_model
from apf.source import commit_of
from integration.command_line import TINY, call, spawn

VALUES = {
    "training": {"learning_rate": 1e-3, "patience": None, "early_stopping": True},
    "evaluation": {"lengths": [2, 3]},
    "domain": {"training": {"side": [0.05, 0.15]}, "evaluation": {"side": 2.0}},
    "task": {"tallest": {}, "overhang": {}},
    "initial": {"train": 1},
    "plans": 100,
    "threads": 2,
}
CHOICES = {"planner": "search", "sampler": "greedy", "experiment": "a/b c"}


@pytest.mark.parametrize(
    ("varied", "words"),
    [
        ([], []),
        (["training.learning_rate"], ["learning_rate_0.001"]),
        (["training.patience", "training.early_stopping"], ["patience_null", "early_stopping_true"]),
        (["sampler", "seed", "model", "plans", "threads", "tracker.wandb.mode"], []),  # said anyway, or no effect
        (["planner", "task"], ["planner_search", "task_tallest+overhang"]),
        (["evaluation.lengths"], ["lengths_2+3"]),
        (
            ["domain.training.side", "domain.evaluation.side"],
            ["domain.training.side_0.05+0.15", "domain.evaluation.side_2"],
        ),
        (["initial.train"], ["train_1"]),
        (["experiment"], ["experiment_a_b_c"]),
    ],
)
def test_words(varied: list[str], words: list[str]) -> None:
    assert words_for(varied, VALUES, CHOICES) == words


@given(st.dictionaries(st.text(min_size=1).filter(lambda key: "." not in key), st.text() | st.floats() | st.none()))
def test_words_are_short_and_safe(values: dict[str, Any]) -> None:
    name = "-".join(words_for(list(values), values, {}))
    assert len(name) <= MOST
    assert re.fullmatch(r"[\w.+-]*", name, re.ASCII)


@pytest.mark.slow
def test_a_sweep_names_its_runs_by_what_it_varied(here: Path) -> None:
    command = ("-m", *TINY, "training.learning_rate=1e-3,0.01", "sampler=greedy")
    spawn(["-m", "apf.main", *command], cwd=here).must_work()
    folders = sorted(path.parent for path in here.rglob("run.yaml"))
    pattern = r"greedy-tgn-noisy-learning_rate_(0\.001|0\.01)-seed0-([0-9a-f]{8})"
    matches = [re.fullmatch(pattern, folder.name) for folder in folders]
    assert [match and match[1] for match in matches] == ["0.001", "0.01"]
    for folder, match in zip(folders, matches, strict=True):
        assert match and match[2] == config_hash(yaml.safe_load((folder / "config.yaml").read_text()))
    again = call(*command[:-2], "training.learning_rate=0.001", "sampler=greedy").must_work()
    assert f"already finished  {folders[0].name}" in again.err, "found whatever the sweep varies"
    assert len(list((here / "runs" / "sweep").glob("greedy-*"))) == 2


def test_where_a_run_comes_from(tiny_run: Path) -> None:
    state = yaml.safe_load((tiny_run / "run.yaml").read_text())
    commit = commit_of()
    assert state["source"] == {"commit": commit and commit.hash, "dirty": commit and commit.dirty}
    assert state["machine"] == {"host": socket.gethostname(), "cpu": cpu_model(), "gpu": None}
    assert state["started"] <= state["ended"]
    assert state["versions"]["apf"] == apf.__version__
    assert {"python", "torch"} <= set(state["versions"])


def test_the_name_of_a_processor(tmp_path: Path) -> None:
    described = tmp_path / "cpuinfo"
    described.write_text("processor\t: 0\nmodel name\t: Fast 9000 @ 3: GHz\nmodel name\t: Other\n")
    assert cpu_model(described) == "Fast 9000 @ 3: GHz"
    assert cpu_model(tmp_path / "none") != ""
