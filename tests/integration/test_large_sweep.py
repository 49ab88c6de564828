"""A sweep of hundreds of runs: what each job costs before it is known whether it needs to be started."""

import shutil
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from hydra._internal.config_loader_impl import ConfigLoaderImpl  # only to count what it is asked

from apf.config.values import config_hash
from integration.command_line import TINY, Result, call


@pytest.fixture
def composed(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The overrides of each job that Hydra composes."""
    jobs: list[list[str]] = []
    load = ConfigLoaderImpl.load_sweep_config

    def counting(self: ConfigLoaderImpl, master_config: object, sweep_overrides: list[str]) -> object:
        jobs.append(sweep_overrides)
        return load(self, master_config, sweep_overrides)

    monkeypatch.setattr(ConfigLoaderImpl, "load_sweep_config", counting)
    return jobs


@pytest.fixture(scope="session")
def finished_run(once: Callable) -> Path:
    """A finished run of seed 0 in a sweep's folder."""
    folder, result = once("finished_in_a_sweep", lambda folder: call("-m", *TINY, f"hydra.sweep.dir={folder}"))
    result.must_work()
    (run,) = (path.parent for path in folder.glob("*/run.yaml"))
    return run


def multiply(run: Path, folder: Path, seeds: int) -> list[str]:
    """Copies of a finished run that say that they had other seeds. Returns their names."""
    names = []
    for seed in range(seeds):
        config = {**yaml.safe_load((run / "config.yaml").read_text()), "seed": seed}
        name = f"{run.name.rpartition('-seed')[0]}-seed{seed}-{config_hash(config)}"
        shutil.copytree(run, folder / name)
        (folder / name / "config.yaml").write_text(yaml.safe_dump(config, sort_keys=False))
        names.append(name)
    return names


def states(result: Result) -> dict[str, str]:
    """What the last lines say of each run, by its name."""
    lines = [line for line in result.err.splitlines() if "-seed" in line]
    return {line[18:].partition(":")[0]: line[:18].strip() for line in lines}


def test_finished_jobs_are_found_without_composing_each(here: Path, finished_run: Path, composed: list) -> None:
    names = multiply(finished_run, here / "runs", 6)
    (here / "runs" / names[4] / "training_blocks.csv").write_text("block\n")
    shutil.copy(finished_run / "config.yaml", here / "runs" / names[5] / "config.yaml")
    result = call("-m", *TINY, "hydra.sweep.dir=runs", "seed=range(6)", "threads=1,2")
    assert states(result) == dict(zip(names, ["already finished"] * 4 + ["failed"] * 2, strict=True))
    assert "training_blocks.csv" in result.err
    assert "holds a run of another config; these keys differ: seed" in result.err
    assert len(composed) == 1


def test_each_choice_of_a_group_is_composed_once(here: Path, composed: list) -> None:
    result = call("-m", *TINY, "plans=1", "seed=range(5)", "sampler=greedy,sequential", "model=tgn,lstm")
    assert len(composed) == 4
    names = [name.rpartition("-")[0] for name in states(result)]
    assert sorted(names) == sorted(
        f"{sampler}-{model}-noisy-seed{seed}"
        for sampler in ("greedy", "sequential")
        for model in ("tgn", "lstm")
        for seed in range(5)
    )
    assert result.err.count("plans is 1; it must be at least the 8 initial ones") == 20


def test_each_refused_job_says_what_is_wrong_with_it(here: Path, finished_run: Path) -> None:
    """Whether or not an earlier job had the same parts, all of them right."""
    multiply(finished_run, here / "runs", 1)
    command = ("-m", *TINY, "hydra.sweep.dir=runs", "seed=0,-1,abc", "evaluation.length=2,99")
    lines = [line for line in call(*command).err.splitlines() if "-seed" in line]
    seeds = ["seed is -1;", "seed is 'abc';"]
    right = ["already finished", *seeds, "evaluation.length: towers of 99 blocks", *seeds]
    for line, words in zip(lines, right, strict=True):
        assert words in line
    assert call(*command, "+typo=1").err.count("typo: there is no such key") == 2


@pytest.mark.slow
def test_five_hundred_finished_jobs_return_at_once(here: Path, finished_run: Path) -> None:
    """Within 5 s of one core, after imports; twice as long is let pass, for a busy machine."""
    multiply(finished_run, here / "runs", 500)
    call("-m", *TINY, "hydra.sweep.dir=runs", "seed=0").must_work()  # what the first command imports and compiles
    begun = time.process_time()
    result = call("-m", *TINY, "hydra.sweep.dir=runs", "seed=range(500)").must_work()
    taken = time.process_time() - begun
    assert list(states(result).values()) == ["already finished"] * 500
    assert taken < 10
