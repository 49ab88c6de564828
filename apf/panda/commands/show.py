"""python -m apf.panda.show tower=FILE: build a tower, clear it up, and film it."""

from pathlib import Path

import numpy as np
from omegaconf import DictConfig
from pydantic import Field

from apf.config.build import build
from apf.config.values import without
from apf.domain import World
from apf.errors import InputError
from apf.panda.caption import Caption
from apf.panda.film import Camera, filming
from apf.panda.log import ENDING
from apf.panda.world import PandaWorld
from apf.rng import stream
from apf.rundir.tables import read_table
from apf.settings import CountOrNone, Seed, settings
from apf.towers import Towers, read_towers


@settings
class ShowConfig:
    """What the command is given; the comments in `conf/show.yaml` say what for."""

    tower: Path
    number: CountOrNone
    out: Path
    log: Path | None
    seed: Seed
    gui: bool
    world: World
    camera: Camera = Field(default_factory=Camera)


def work(cfg: DictConfig) -> None:
    """Build, judge, clear up; write the film and the strip. Raises InputError for what is wrong with the input."""
    config = build(without(cfg, "domain", "model", "task"), ShowConfig)
    world = config.world
    if not isinstance(world, PandaWorld):
        raise InputError("world: only the robot can be shown; choose world=panda")
    tower = tower_of(config.tower, config.number)
    world.check_plans(tower)
    world.log_to(stem_of(config.log))
    builder = world.builder
    with filming(config.out, config.camera) as film:
        caption = Caption(tower, builder.robot, chances_of(config.tower, config.number))
        film.caption = caption.lines
        world.simulated.on_step.append(film)
        builder.on_judged.append(caption.judged)
        builder.on_judged.append(lambda built: film.still(world.simulated))
        outcome = world.attempt(tower, stream(config.seed, "show"))
        film.still(world.simulated)
        world.close()
    assert outcome.report is not None
    labels = " ".join("-" if label < 0 else str(label) for label in outcome.labels)
    print(f"{config.out}, {config.out.with_suffix('.png').name}: {outcome.report['outcome']}, labels {labels}")


def tower_of(path: Path, number: int) -> Towers:
    """The tower of that place in a tower file, counted from 0. Raises InputError if there is none."""
    places = {order: batch.plans[i : i + 1] for batch in read_towers(path) for i, order in enumerate(batch.order)}
    if number not in places:
        raise InputError(f"number={number}: {path} holds {len(places)} towers, counted from 0")
    return places[number]


def chances_of(path: Path, number: int) -> list[float] | None:
    """The column `chance` of the tower of that place in a tower file, from the bottom up; None: there is none."""
    try:
        table = read_table(path, ["position", "chance"], ["tower"], {})
    except InputError:  # of towers that no model has judged
        return None
    own = table.names["tower"].codes == number
    order = np.argsort(table.numbers["position"][own], kind="stable")
    return table.numbers["chance"][own][order].tolist()


def stem_of(log: Path | None) -> Path | None:
    """The path of a log without its ending. Raises InputError if that is another one."""
    if log is not None and log.suffix != ENDING:
        raise InputError(f"log={log}: the ending must be {ENDING}")
    return log and log.with_suffix("")
