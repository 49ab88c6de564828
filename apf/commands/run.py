"""What `python -m apf.main` does: check, run, report."""

import contextlib
import functools
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pydantic
import torch
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig

from apf.config.messages import check_hydra, describe
from apf.domain import Predictor
from apf.errors import InputError
from apf.experiment import Experiment
from apf.launch.machine import check_machine, check_weights
from apf.models import Ensemble, pick_device
from apf.planning import Evaluator, Learned, Trained
from apf.planning.objective import must_be_number, optimises, returned
from apf.report.pictures import curves, plan_pictures
from apf.report.summary import print_summary, save_figures
from apf.rundir.claim import CONFIG, TABLES, WORLD_TABLE, locked
from apf.rundir.directory import begin, check, finish, output_directory, resumable
from apf.rundir.kept import read_state
from apf.rundir.resume import RESUME, go_where_it_began
from apf.rundir.store import Store
from apf.rundir.tables import write_table
from apf.rundir.versions import changed
from apf.schema import Config, settle
from apf.tracking import ConsoleTracker, RunFiles, RunInfo, Tracker, Trackers, log_end
from apf.trained import load_ensemble, with_objects_of


def work(cfg: DictConfig) -> float | tuple[float, ...] | None:
    """One run, in Hydra's output directory. A finished run of the same config returns at once.

    Returns the run's objective, for a sweeper.
    """
    hydra_config = HydraConfig.get()
    directory = output_directory(hydra_config)
    optimised = hydra_config.mode == RunMode.MULTIRUN and optimises(hydra_config, cfg.get("objective"))
    config = start(cfg, hydra_config, directory)
    value = returned(directory, config.objective, config.plans)
    if optimised:
        must_be_number(value)
    return value


def start(cfg: DictConfig, hydra_config: Any, directory: Path) -> Config:
    """Check a composed config, and do what is missing of its run; nothing, if the run has finished.

    Args:
        cfg: What Hydra composed.
        hydra_config: Hydra's own part of it.
        directory: Where the run is, or is to be.

    Returns:
        The config of the run.

    Raises:
        InputError: The config is wrong, or the directory is not for this run.
        Stopped: The run cannot go on for now.
    """
    check_hydra(hydra_config)
    resuming = hydra_config.job.config_name == RESUME
    if resuming:
        go_where_it_began(directory)
    try:
        plain_config, config = settle(cfg, kept=directory if resuming else None)
    except InputError as error:
        if not resuming or hydra_config.overrides.task:
            raise
        raise InputError(f"{directory / CONFIG}: {error}") from None  # nothing else was typed
    if isinstance(config.predictor, Trained) and not resuming:
        config = with_objects_of(config, config.predictor)
    check_machine(config)
    torch.set_num_threads(config.threads)
    model = make_model(cfg, config)
    if check(directory, plain_config, config.domain):
        print(f"{directory} holds this run already, finished", file=sys.stderr)
    else:
        with locked(directory) as claim:
            try:
                begin(directory, plain_config, config.domain, config.task)
                with resumable(directory):
                    run(directory, plain_config, config, model)
            except InputError:
                claim.abandon(config.domain)
                raise
    return config


def run(directory: Path, plain_config: dict[str, Any], config: Config, model: Ensemble) -> None:
    """Do what is missing of the run in the (locked) directory, and show it.

    Args:
        directory: The run directory, locked.
        plain_config: The config as plain values.
        config: The same, as objects.
        model: The untrained ensemble.
    """
    store = Store(directory, config.domain)
    state = read_state(directory)
    console = ConsoleTracker()
    mirrors = config.tracker.values() if isinstance(config.tracker, dict) else [config.tracker]
    tracker = Trackers([console, *mirrors])
    experiment = make_experiment(config, model, store, tracker)
    identifier = f"{state['id']}-{store.corrections}" if store.corrections else state["id"]
    info = RunInfo(
        state["name"],
        identifier,
        directory,
        plain_config,
        state["sweep"],
        experiment.history(),
        words(state),
        about(state),
    )
    failed = True
    try:
        tracker.start(info)
        for notice in (changed(state["versions"]), store.journal.notice):
            if notice:
                console.say(notice)
        if isinstance(config.predictor, Learned):
            experiment.run()
        elif not store.evaluated(0):
            tracker.plan(0, experiment.evaluator.work())
            experiment.evaluate(0, predictor_of(config))
        tracker.begin(experiment.steps, "writing tables and figures")
        store.export()
        table = config.world.table(store.reports())
        if table is not None:
            write_table(table, directory / WORLD_TABLE)
        save_figures(directory)
        with contextlib.ExitStack() as stack:
            tracker.keep(run_files(directory, config, stack))
        finish(directory, store.journal)
        failed = False
    except BaseException as error:
        log_end(error)
        raise
    finally:
        tracker.finish(failed)
        for world in (config.world, *config.evaluation.worlds.values()):
            world.close()
        store.close()
    print_summary(directory, console.console)


def run_files(directory: Path, config: Config, stack: contextlib.ExitStack) -> RunFiles:
    """What a run leaves behind, for trackers.

    Args:
        directory: Of the run, its tables written.
        config: Of the run.
        stack: Removes the folder of the pictures, which is made if a tracker shows them.
    """

    @functools.cache
    def pictures() -> Mapping[str, Path]:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="apf-")))
        return {**plan_pictures(directory, config.domain, folder), **curves(directory)}

    tables = [path for name in (*TABLES, WORLD_TABLE) if (path := directory / name).exists()]
    weights = sorted((directory / "weights").glob("step_*.safetensors"))[-1:]
    return RunFiles(config.plans, tables, weights, pictures)


def words(state: Mapping[str, Any]) -> dict[str, str]:
    """What was chosen of each config group, as words, from `run.yaml`. Hydra's own groups are left out."""
    chosen = {group: choice for group, choice in state["choices"].items() if "@" not in group and choice is not None}
    return {group: "+".join(map(str, c)) if isinstance(c, list) else str(c) for group, c in chosen.items()}


def about(state: Mapping[str, Any]) -> dict[str, Any]:
    """Commit, host, CPU and GPU that a run began with, from `run.yaml`."""
    return {**state.get("source", {}), **state.get("machine", {})}


def predictor_of(config: Config) -> Predictor:
    """The predictor of a run that does not learn. Raises InputError if an ensemble is not to be had."""
    chosen = config.predictor
    if isinstance(chosen, Trained):
        return load_ensemble(chosen.run, chosen.step, chosen.odds, config.device)
    assert isinstance(chosen, Predictor)
    return chosen


def make_model(cfg: DictConfig, config: Config) -> Ensemble:
    """The untrained ensemble. Raises InputError if the device or a setting of the network is wrong."""
    try:
        device = pick_device(config.device)
        check_weights(config.model, config.domain, device)
        odds = config.predictor.odds if isinstance(config.predictor, Learned) else 1.0
        return Ensemble(config.model, config.sampler.kind, config.domain, config.training, device, odds)
    except pydantic.ValidationError as error:
        raise InputError(describe(error, "model.network", cfg)) from None
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"device is {config.device!r}; {str(error).splitlines()[0]}") from None


def make_experiment(config: Config, model: Ensemble, store: Store, tracker: Tracker) -> Experiment:
    """The loop, with all its parts.

    Args:
        config: Of the run.
        model: The untrained ensemble.
        store: The run directory.
        tracker: Is told what happens.
    """
    return Experiment(
        seed=config.seed,
        plans=config.plans,
        every=config.evaluation.every,
        also=config.evaluation.also,
        initial=config.initial,
        acquisition=config.acquisition,
        execution=config.execution,
        sampler=config.sampler,
        world=config.world,
        model=model,
        evaluator=Evaluator(
            config.evaluation, config.domain, config.planner, config.task, tracker.begin, config.execution.time_limit
        ),
        store=store,
        tracker=tracker,
    )
