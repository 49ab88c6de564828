"""The ensemble that a run has trained."""

from dataclasses import replace
from pathlib import Path

from omegaconf import OmegaConf
from safetensors import SafetensorError

from apf.domain import Domain
from apf.errors import InputError
from apf.models import Ensemble, pick_device
from apf.planning import Trained
from apf.rundir.claim import CONFIG
from apf.rundir.kept import read_config
from apf.schema import Config, check_together, settle

SHIPPED = Path(__file__).parent / "shipped"
"""As much of a few runs as their last ensembles need, which come with the package; made by `analysis/ship.py`."""


def shipped_for(domain: Domain) -> Path | None:
    """The directory of an ensemble that comes with the package, for plans of this domain; None: there is none."""
    for run in sorted(path.parent for path in SHIPPED.glob(f"*/{CONFIG}")):
        if type(config_of(run).domain) is type(domain):
            return run
    return None


def kept_steps(run: Path) -> list[int]:
    """The steps of which a run directory keeps the ensemble, in ascending order."""
    return sorted(int(path.stem.partition("_")[2]) for path in (run / "weights").glob("step_*.safetensors"))


def chosen_step(run: Path, step: int | None) -> int:
    """A step of which a run directory keeps the ensemble; None: the last one. Raises InputError if there is none."""
    steps = kept_steps(run)
    if not steps:
        _require_run(run)
        raise InputError(f"{run} keeps no weights: its predictor does not learn, or it was never evaluated")
    if step is not None and step not in steps:
        raise InputError(f"step is {step}; {run} keeps the ensembles of steps {', '.join(map(str, steps))}")
    return steps[-1] if step is None else step


def _require_run(run: Path) -> None:
    if not (run / CONFIG).is_file():
        raise InputError(f"{run} holds no run: there is no {CONFIG} in it")


def config_of(run: Path) -> Config:
    """The config of a run, with the objects that the run keeps. Raises InputError if there is no run."""
    _require_run(run)
    return settle(OmegaConf.create(read_config(run)), kept=run)[1]


def load_ensemble(run: Path, step: int | None = None, odds: float = 1.0, device: str = "cpu") -> Ensemble:
    """The ensemble that a run had trained by a step.

    Args:
        run: The run directory.
        step: One of those that were evaluated; None: the last.
        odds: Factor for the odds of each placement.
        device: Where the networks are to be: auto, cpu, cuda, cuda:1, ...

    Raises:
        InputError: There is no such run or device, no weights of this step, or they are of other networks.
    """
    step, config = chosen_step(run, step), config_of(run)
    try:
        place = pick_device(device)
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"device is {device!r}; {str(error).splitlines()[0]}") from None
    ensemble = Ensemble(config.model, config.sampler.kind, config.domain, config.training, place, odds)
    path = run / "weights" / f"step_{step:04d}.safetensors"
    try:
        ensemble.load(path)
    except SafetensorError as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    except RuntimeError:  # PyTorch names each weight that does not fit, line by line
        raise InputError(
            f"{path} holds other networks than {run / CONFIG} says, or networks that see other features than the "
            f"{config.domain.n_features} that {type(config.domain).__name__} has now: train it again"
        ) from None
    return ensemble


def with_objects_of(config: Config, trained: Trained) -> Config:
    """The config with the objects of the run whose ensemble is asked.

    Raises:
        InputError: That run is of another domain, lacks the weights, or its objects do not fit the worlds.
    """
    theirs = config_of(trained.run).domain
    chosen_step(trained.run, trained.step)
    if type(theirs) is not type(config.domain):
        what = f"{trained.run} is a run of {type(theirs).__name__}"
        raise InputError(f"predictor.run: {what}; domain is {type(config.domain).__name__}")
    config = replace(config, domain=config.domain.kept_in(trained.run))
    check_together(config)
    return config
