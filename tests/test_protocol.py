"""Runs of the protocol, and of others: what is said of them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from integration.command_line import REPOSITORY
from omegaconf import OmegaConf

from analysis.protocol import SHOWN, deviations, note_on
from apf.api.composed import composed
from apf.config.values import plain
from apf.report.figures import Words
from apf.report.runs import Run, find_runs


def made(*overrides: str, experiment: str | None = "strategies", **keys: Any) -> Run:
    """A run as the command line makes it, without running it; keys: changed in its config, `a__b` for a.b."""
    words = ["tracker=none", *([f"+experiment={experiment}"] if experiment else []), *overrides]
    with composed("config", words) as (config, _):
        values = OmegaConf.create(plain(config))
    for key, value in keys.items():
        OmegaConf.update(values, key.replace("__", "."), value)
    return Run(Path("run"), OmegaConf.to_container(values), {"experiment": experiment}, Words())  # type: ignore[arg-type]


def test_published_runs_are_of_the_protocol() -> None:
    """Runs of an earlier version, whose config lacks keys of this one."""
    runs, _ = find_runs([REPOSITORY / "results" / "runs"])
    assert len(runs) > 30
    assert [deviation for run in runs for deviation in deviations(run)] == []


@pytest.mark.parametrize("name", ["strategies", "baselines", "architectures", "predictors", "early_stopping"])
def test_a_run_of_a_sweep_is_of_the_protocol(name: str) -> None:
    assert deviations(made("seed=13", experiment=name)) == []


def test_training_and_more_evaluations_are_free() -> None:
    more = made("plans=1000", "training.updates=5", "sampler.candidates.n=7", "predictor.odds=1", "domain.mirror=false")
    assert deviations(more) == []
    assert deviations(made(evaluation__also=[25, 80, 120, 140, 160, 180], evaluation__every=50)) == []
    assert deviations(made(evaluation__also=[], evaluation__every=20)) == []
    assert deviations(made(evaluation__lengths=[2, 3, 4, 5, 6, 7, 8])) == []
    assert deviations(made(planner__chunk=1)) == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda: made(evaluation__problems=3), "evaluation.problems is 3 (protocol: 50)"),
        (lambda: made(planner__candidates=2000), "planner.candidates is 2000 (protocol: 20000)"),
        (lambda: made(evaluation__test_plans=100), "evaluation.test_plans is 100 (protocol: 1000)"),
        (lambda: made(domain__evaluation__seed=1), "domain.evaluation.seed is 1 (protocol: 2)"),
        (lambda: made(evaluation__length=4), "evaluation.length is 4 (protocol: 5)"),
        (lambda: made(evaluation__worlds__noisy__noise=0.1), "evaluation.worlds.noisy.noise is 0.1 (protocol: 0.003)"),
        (lambda: made(plans=40), "plans is 40 (protocol: 400)"),
        (lambda: made(evaluation__every=80), "evaluation.every is 80 (protocol: 100)"),
        (lambda: made(evaluation__also=[80]), "evaluation.also is [80] (protocol: [80, 120, 140, 160, 180])"),
        (
            lambda: made(evaluation__lengths=[2, 3]),
            "evaluation.lengths is [2, 3] (protocol: [2, 3, 4, 5, 6, 7])",
        ),
    ],
)
def test_another_evaluation_is_named(change: Callable[[], Run], said: str) -> None:
    assert deviations(change()) == [said]


def test_a_run_of_no_sweep_is_compared_with_the_protocol_itself() -> None:
    for experiment in (None, "smoke", "beyond", "packing"):
        assert deviations(made(experiment=experiment)), experiment
    assert "planner._target_ is apf.planning.SearchPlanner" in " ".join(deviations(made(experiment="beyond")))


def test_a_key_that_the_run_lacks_is_not_compared() -> None:
    run = made(evaluation__also=[])
    run.config["evaluation"].pop("also")
    assert deviations(run) == []


def test_a_note_counts_runs_and_names_each_deviation_once() -> None:
    good, bad = made(), made(evaluation__problems=3)
    assert note_on({"sequential": [good], "greedy": [good, good]}) == ""
    assert note_on({"sequential": [bad, good], "greedy": [bad, bad], "complete": [good]}) == (
        "runs of another protocol (1 of 2 of sequential, 2 of 2 of greedy): evaluation.problems is 3 (protocol: 50)"
    )
    smoke = note_on({"sequential": [made(experiment="smoke")]})
    assert smoke.count("(protocol: ") == SHOWN
    assert smoke.endswith("more")
