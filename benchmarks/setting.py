"""What the benchmarks work on: the default config, a set of labelled towers, a trained ensemble; full size or quick."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig

from apf.commands.run import make_model
from apf.config.values import config_dir
from apf.domain import Labelled, World
from apf.models import Ensemble
from apf.models.examples import Examples, examples
from apf.planning import Planner
from apf.rng import stream
from apf.schema import Config, validate
from apf.towers import TowerDomain, Towers

SEED = 0


@dataclass(frozen=True)
class Sizes:
    """How much is done. *_reference: how much of it by the reference, whose time is then scaled up."""

    repetitions: int
    enough: float
    """Seconds of what is timed in each of these rounds."""
    towers: int
    """Random towers drawn, labelled, turned."""
    towers_reference: int
    labelled: int
    """Labelled towers to learn from."""
    members_reference: int
    epochs_reference: int
    updates: int
    """Of a training from scratch."""
    candidates: int
    """Of an acquisition."""
    candidates_reference: int
    plan_candidates: int
    acquisitions: int
    """How often a whole acquisition is timed."""


FULL = Sizes(
    repetitions=5,
    enough=2,
    towers=100_000,
    towers_reference=500,
    labelled=400,
    members_reference=2,
    epochs_reference=2,
    updates=1000,
    candidates=10_000,
    candidates_reference=640,
    plan_candidates=100_000,
    acquisitions=3,
)
QUICK = Sizes(
    repetitions=3,
    enough=0.3,
    towers=20_000,
    towers_reference=100,
    labelled=100,
    members_reference=1,
    epochs_reference=1,
    updates=250,
    candidates=2_000,
    candidates_reference=128,
    plan_candidates=20_000,
    acquisitions=1,
)


class Setting:
    """The default config in these sizes, and what is made from it, once each."""

    def __init__(self, sizes: Sizes, device: str = "cpu") -> None:
        self.sizes = sizes
        self.device = device

    def on(self, device: str) -> "Setting":
        """The same on another device."""
        return Setting(self.sizes, device)

    def config(self, *overrides: str) -> tuple[DictConfig, Config]:
        """The config composed and checked."""
        sizes = [
            f"training.updates={self.sizes.updates}",
            "domain.mirror=false",  # the reference has the four sides alone,
            "domain.mass_scales=0",  # with their own masses
            "predictor.odds=1",  # and what the members say, as it is
            f"sampler.candidates.n={self.sizes.candidates}",
            f"planner.candidates={self.sizes.plan_candidates}",
            "tracker=none",
            f"device={self.device}",
        ]
        with initialize_config_dir(config_dir(), version_base="1.3"):
            cfg = compose("config", [*sizes, *overrides])
        return cfg, validate(cfg)

    @cached_property
    def default(self) -> Config:
        """TGN, sequential sampler, noisy world."""
        return self.config()[1]

    def planner(self, name: str, *overrides: str) -> Planner:
        """The planner of that name, with its own config."""
        return self.config(f"planner={name}", *overrides)[1].planner

    @cached_property
    def labelled(self) -> list[Labelled]:
        """As many labelled towers as an acquisition at full size begins with."""
        return labelled_towers(self.default.domain, self.default.world, self.sizes.labelled)

    @cached_property
    def split(self) -> tuple[list[Labelled], list[Labelled]]:
        """The labelled towers as training and validation set, divided as in a run of that many towers."""
        share = validation_share(self.default, self.sizes.labelled)
        train, validation = [], []
        for group in self.labelled:
            cut = round(len(group.plans) * share)
            validation.append(Labelled(group.plans[:cut], group.labels[:cut]))
            train.append(Labelled(group.plans[cut:], group.labels[cut:]))
        return train, validation

    @cached_property
    def trained(self) -> Ensemble:
        """The default ensemble, trained on the labelled towers."""
        ensemble = make_model(*self.config())
        ensemble.fit(*self.split, stream(SEED, "train"))
        return ensemble

    def ensemble(self, *overrides: str) -> Ensemble:
        """A new ensemble of the default size, with random weights."""
        ensemble = make_model(*self.config(*overrides))
        reset(ensemble)
        return ensemble

    def examples(self) -> list[Examples]:
        """All labelled towers, each seen from four sides, as a Theta_ss model learns from them."""
        return examples(self.labelled, self.default.sampler.kind, self.default.domain)

    def random_towers(self, purpose: str, n: int, length: int = 5) -> Towers:
        """n random towers of training blocks."""
        return self.default.domain.random_plans(length, n, stream(SEED, purpose))


def reset(ensemble: Ensemble) -> None:
    """Give every member its own random weights."""
    ensemble.network.reset([torch.Generator().manual_seed(e) for e in range(ensemble.members)])


def validation_share(config: Config, towers: int) -> float:
    """The share of the towers labelled so far that a run keeps for validation."""
    first = config.initial.train + config.initial.validation
    of_acquired = config.acquisition.validation / config.acquisition.plans
    return (config.initial.validation + max(towers - first, 0) * of_acquired) / max(towers, first)


def labelled_towers(domain: TowerDomain, world: World, n: int) -> list[Labelled]:
    """n labelled towers such as the sequential sampler has after a while, one batch per length.

    A fifth of them are the random pairs that it starts from. The others are of 3 to 5 blocks, mostly 5, and stand up to
    a height that is uniform among 1 to K - 1 blocks; what follows is random. In a run with the default
    config the counts of labels are much the same.
    """
    result = []
    for length, share in ((2, 0.2), (3, 0.1), (4, 0.25), (5, 0.45)):
        parts = []
        rng = stream(SEED, "labelled towers", length)
        for bases, count in zip(range(1, length), split_evenly(round(n * share), length - 1)):
            towers = standing_towers(domain, bases, count, rng)
            while towers.length < length:
                towers = domain.extend(towers, rng)
            parts.append(towers)
        towers = Towers.concatenate(parts)
        towers = towers[rng.permutation(len(towers))]
        result.append(Labelled(towers, world.execute(towers, rng)))
    return result


def standing_towers(domain: TowerDomain, length: int, n: int, rng: np.random.Generator) -> Towers:
    """n random towers of training blocks, of which every prefix stands without noise."""
    bases = domain.random_plans(1, n, rng)
    for _ in range(length - 1):
        extended = domain.extend(bases[np.repeat(np.arange(len(bases)), 200)], rng)
        standing = np.flatnonzero(domain.feasible(extended))
        bases = extended[rng.choice(standing, n)]
    return bases


def split_evenly(n: int, parts: int) -> list[int]:
    """n as a sum of `parts` integers that differ by at most one."""
    return [len(part) for part in np.array_split(np.arange(n), parts)]
