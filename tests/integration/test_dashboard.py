"""The workspace, the report and the sweeps for Weights & Biases: what they name is what runs tell."""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from hydra import compose, initialize_config_dir
from wandb.sdk.launch.sweeps.utils import create_sweep_command_args

from apf.config.values import config_dir
from apf.dashboard import pictures, sections
from apf.planning.objective import names_of
from apf.schema import validate
from integration.command_line import REPOSITORY, spawn

SWEEPS = sorted((REPOSITORY / "sweeps" / "wandb").glob("*.yaml"))


def composed(*overrides: str) -> Any:
    with initialize_config_dir(config_dir(), version_base="1.3"):
        return compose("config", [*overrides])


@pytest.mark.parametrize("overrides", [(), ("domain=packing",), ("task=[tallest]", "evaluation.lengths=[2,7]")])
def test_it_shows_metrics_that_runs_have(overrides: tuple[str, ...]) -> None:
    config = composed("tracker=none", *overrides)
    shown = {name for section in sections(config) for name in section.metrics}
    evaluated = {
        name for name in names_of(validate(config).evaluation, config.task) if not name.startswith("predicted")
    }
    assert shown == evaluated | {"loss/train", "data/feasible_share", "score/mean"}
    assert pictures(config) == [f"chosen/{task}" for task in config.task]


@pytest.mark.parametrize("arguments", [("--dry-run",), ()], ids=["dry run", "offline"])
def test_what_would_be_made(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    command = ["-m", "apf.dashboard", *arguments, "tracker.wandb.project=mine", "tracker.wandb.entity=us"]
    made = json.loads(spawn(command, tmp_path, WANDB_MODE="offline").must_work().out)
    workspace, report = made
    assert [(part["entity"], part["project"]) for part in made] == [("us", "mine")] * 2
    names = [section["name"] for section in workspace["sections"]]
    assert names[0] == "Median regret" and names[-1] == "Chosen plans"
    assert workspace["sections"][0]["panels"][0]["groupby"] == {"name": "sampler"}
    assert sum("panels" in block for block in report["blocks"]) == len(names)


def test_without_a_network(tmp_path: Path) -> None:
    environment = {"WANDB_BASE_URL": "http://127.0.0.1:9", "WANDB_API_KEY": "a" * 40, "HOME": str(tmp_path)}
    result = spawn(["-m", "apf.dashboard"], tmp_path, **environment)
    assert result.code == 1
    assert result.err.startswith("error: W&B cannot be reached, nothing was made: ")
    assert len(json.loads(result.out)) == 2


def test_other_trackers_have_no_dashboard(tmp_path: Path) -> None:
    spawn(["-m", "apf.dashboard", "tracker=csv"], tmp_path).must_refuse("tracker=wandb")


def drawn(parameter: dict[str, Any]) -> list[Any]:
    """Values that a sweep may draw of a parameter."""
    if "value" in parameter:
        return [parameter["value"]]
    return parameter.get("values") or [parameter["min"], parameter["max"]]


@pytest.mark.parametrize("path", SWEEPS, ids=lambda path: path.stem)
def test_the_command_of_an_agent_composes(path: Path) -> None:
    """W&B's own function makes the arguments, as `wandb agent` does."""
    sweep = yaml.safe_load(path.read_text())
    parameters = sweep["parameters"]
    for i in range(max(len(drawn(parameter)) for parameter in parameters.values())):
        values = {key: drawn(parameter)[i % len(drawn(parameter))] for key, parameter in parameters.items()}
        arguments = create_sweep_command_args({"args": {key: {"value": value} for key, value in values.items()}})
        env, *python, last = sweep["command"]
        assert (env, python[:3], last) == ("${env}", ["python", "-m", "apf.main"], "${args_no_hyphens}")
        config = composed(*python[3:], *arguments["args_no_hyphens"])
        validate(config)
        assert config.tracker.wandb.mode == "online", "an agent's run must reach the server"
    goal = sweep["metric"]["name"]
    assert goal in names_of(validate(composed("tracker=none")).evaluation, config.task)
