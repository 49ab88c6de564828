"""python -m apf.main: compose, check, run, report."""

import sys
import time
from importlib.metadata import version
from pathlib import Path

import hydra
import pydantic
import torch
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig

from apf.cli import MISTAKES, one_line_errors, run_command
from apf.config import Config, Learned, config_dir, config_hash, describe, flatten, identity, plain, validate
from apf.errors import InputError
from apf.experiment import Experiment
from apf.models import Ensemble, pick_device
from apf.planning import Evaluator
from apf.report import print_summary, save_figures
from apf.store import Store, read_yaml, write_yaml
from apf.towers import TowerDomain
from apf.tracking import ConsoleTracker, RunInfo, Tracker, Trackers


@hydra.main(version_base="1.3", config_path=config_dir(), config_name="config")
@one_line_errors
def job(cfg: DictConfig) -> None:
    """One run, in Hydra's output directory. A finished run of the same config returns at once."""
    started = time.time()
    directory = Path(HydraConfig.get().runtime.output_dir)
    try:
        config = validate(cfg)
        torch.set_num_threads(config.threads)
        model = make_model(cfg, config)
        finished = claim(directory, plain(cfg), config.domain)
    except MISTAKES:
        _remove_if_empty(directory)
        raise
    if finished:
        print(f"{directory} holds this run already, finished", file=sys.stderr)
        return

    store = Store(directory, config.domain)
    console = ConsoleTracker()
    tracker = Trackers([console, config.tracker])
    in_sweep = HydraConfig.get().mode == RunMode.MULTIRUN
    failed = True
    try:
        tracker.start(RunInfo(directory.name, directory, plain(cfg), config.sweep if in_sweep else None))
        experiment = make_experiment(config, model, store, tracker)
        if isinstance(config.predictor, Learned):
            experiment.run()
        elif not store.evaluated(0):
            experiment.evaluate(0, config.predictor)
        store.export()
        save_figures(directory)
        failed = False
    finally:
        tracker.finish(failed)
        store.close()
    state = read_yaml(directory / "run.yaml")
    seconds = state["seconds"] + time.time() - started
    write_yaml(directory / "run.yaml", {**state, "finished": True, "seconds": round(seconds, 1)})
    print_summary(directory, console.console)


def make_model(cfg: DictConfig, config: Config) -> Ensemble:
    """The untrained ensemble. Raises InputError if the device or a setting of the network is wrong."""
    try:
        device = pick_device(config.device)
        return Ensemble(config.model, config.sampler.kind, config.domain, config.training, device)
    except pydantic.ValidationError as error:
        raise InputError(describe(error, "model.network", cfg)) from None
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"device is {config.device!r}; {str(error).splitlines()[0]}") from None


def make_experiment(config: Config, model: Ensemble, store: Store, tracker: Tracker) -> Experiment:
    """The loop, with all its parts."""
    return Experiment(
        seed=config.seed,
        towers=config.towers,
        every=config.evaluation.every,
        initial=config.initial,
        acquisition=config.acquisition,
        sampler=config.sampler,
        world=config.world,
        model=model,
        evaluator=Evaluator(config.evaluation, config.domain, config.planner, config.task, tracker.detail),
        store=store,
        tracker=tracker,
    )


def claim(directory: Path, config: dict, domain: TowerDomain) -> bool:
    """Make the directory this run's own, or find that it is already. Returns whether the run has finished.

    Raises InputError, naming the keys that differ, if another run lives there.
    """
    if (directory / "config.yaml").exists():
        mine, theirs = (flatten(identity(c)) for c in (config, read_yaml(directory / "config.yaml")))
        differing = [key for key in sorted(mine.keys() | theirs.keys()) if mine.get(key) != theirs.get(key)]
        if differing:
            raise InputError(f"{directory} holds a run of another config; these keys differ: {', '.join(differing)}")
        domain.check_kept(directory)
        return bool(read_yaml(directory / "run.yaml").get("finished"))
    try:
        directory.mkdir(parents=True, exist_ok=True)
        choices = {key: value for key, value in HydraConfig.get().runtime.choices.items() if "hydra/" not in key}
        state = {
            "name": directory.name,
            "hash": config_hash(config),
            "choices": choices,
            "overrides": list(HydraConfig.get().overrides.task),
            "versions": {name: version(name) for name in ("apf", "torch", "torch-geometric", "numpy")},
            "finished": False,
            "seconds": 0.0,
        }
        domain.keep(directory)
        write_yaml(directory / "run.yaml", state)
        write_yaml(directory / "config.yaml", config)
    except OSError as error:
        raise InputError(f"{directory}: cannot be written: {error.strerror}") from None
    return False


def _remove_if_empty(directory: Path) -> None:
    """Take back the folders that Hydra made for a run that never began."""
    for folder in (directory, *directory.parents):
        if folder == Path.cwd() or not folder.is_dir() or any(folder.iterdir()):
            return
        folder.rmdir()


def main() -> None:
    """Entry point of the command."""
    run_command(job)


if __name__ == "__main__":
    main()
