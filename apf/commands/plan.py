"""What `python -m apf.plan` does: the best plan found for somebody's own objects."""

from pathlib import Path

import numpy as np
from omegaconf import DictConfig, OmegaConf

from apf.config.build import build
from apf.config.values import without
from apf.domain import Domain, Predictor, Task
from apf.errors import InputError
from apf.models import Ensemble
from apf.planning import Choice, Planner, Problem
from apf.rng import stream
from apf.rundir.tables import check_ending, write_table
from apf.settings import CountOrNone, Length, Name, Seed, settings
from apf.trained import load_ensemble


@settings
class PlanConfig:
    """What the command is given; the comments in `conf/plan.yaml` say what for."""

    objects: Path
    run: Path | None
    step: CountOrNone | None
    length: Length
    out: Path
    seed: Seed
    device: Name
    domain: Domain
    task: dict[str, Task]
    planner: Planner
    predictor: Predictor | None


def work(cfg: DictConfig) -> None:
    """Plan, say what was found, and write it."""
    cfg = without(cfg, "model")
    if not OmegaConf.is_missing(cfg, "objects"):
        cfg.domain.training.file = cfg.objects
    try:
        config = build(cfg, PlanConfig)
        check_ending(config.out)
        if len(config.task) != 1:
            raise InputError(f"task is {', '.join(config.task) or 'none'}; choose one of them: task=NAME")
        config.domain.check_length(config.length, "length")
    except InputError as error:
        raise InputError(str(error).replace("domain.training.file", "objects")) from None
    predictor = predictor_of(config)
    ((name, task),) = config.task.items()
    choice = plan(config.domain, task, predictor, config.planner, config.length, config.seed)
    judge = config.planner.judge(predictor)
    chances = judge.prefix_feasibility(choice.plan, stream(config.seed, "chances"))[0]
    write_table(config.domain.table(choice.plan), config.out)
    title = f"{name} {choice.value:.3g} {task.unit}, chance {choice.chance:.2f}"
    print(title)
    print(f"chance of each prefix: {' '.join(f'{chance:.2f}' for chance in chances)}")
    if isinstance(judge, Ensemble):
        says = judge.predict(choice.plan).cpu().numpy().prod(-1)[:, 0]
        print(f"members say: {says.min():.2f} to {says.max():.2f}, standard deviation {says.std():.2f}")
    picture = config.out.with_suffix(".png")
    drawn = config.domain.save_picture(choice.plan, picture, title)
    print(f"written: {config.out}{f', {picture}' if drawn else ''}")


def predictor_of(config: PlanConfig) -> Predictor:
    """The predictor that is chosen, or the ensemble of a run. Raises InputError if there is neither."""
    if config.predictor is not None:
        return config.predictor
    if config.run is None:
        raise InputError("run is missing: a finished run's directory; or predictor=analytic, or predictor=simulation")
    ensemble = load_ensemble(config.run, config.step, device=config.device)
    if type(ensemble.domain) is not type(config.domain):
        theirs, ours = type(ensemble.domain).__name__, type(config.domain).__name__
        raise InputError(f"run: {config.run} is a run of {theirs}; domain is {ours}")
    return ensemble


def plan(domain: Domain, task: Task, predictor: Predictor, planner: Planner, length: int, seed: int = 0) -> Choice:
    """The plan of highest expected value that a planner finds among those of the domain's objects.

    Args:
        domain: Brings the objects of the experiment, of which plans are made.
        task: Says what a plan is worth.
        predictor: Says how likely a plan succeeds.
        planner: How to look.
        length: Placements of the plan.
        seed: Of all draws.
    """
    rng = stream(seed, "plan")
    problem = Problem(domain.random_plans(length, planner.candidates, rng), np.random.default_rng(rng.integers(2**63)))
    (found,) = planner.choose([problem], {"task": task}, predictor, domain)
    return found["task"]
