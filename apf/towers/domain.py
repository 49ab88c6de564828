"""Block towers as a domain of plans: what the rest of the package needs to know of them, and no more.

The four parts that a new domain supplies (appendix, Method Generalizability) are action definitions (here),
experimental infrastructure (`apf.towers.worlds`, `apf.panda`), a feasibility detector (`apf.towers.stability`), and
inductive bias (`apf.towers.features`, the connectivity that `conf/model` chooses, and `apf.towers.contact`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field

from apf.domain import Domain, NamedPlans
from apf.errors import InputError
from apf.settings import Metres, Whole, settings
from apf.towers.balanced import balanced_towers
from apf.towers.blocks import BlockSet
from apf.towers.features import (
    LENGTH,
    N_FEATURES,
    N_POSITION,
    PositionOf,
    features,
    in_unit,
    mirrored,
    stretched,
    weighed,
)
from apf.towers.files import read_blocks, read_towers, tower_table, write_blocks
from apf.towers.sources import BlockSource
from apf.towers.stability import stands
from apf.towers.towers import Offset, Towers, random_extensions, random_towers
from apf.towers.variations import relative_offsets, variations

APART = 0.25
"""From so much on, the offsets of two joints are no variations of each other, in units of half the summed sides."""

STRETCHES = np.array([0.8191725134, 0.6710436067, 0.5497004779])
"""Steps, modulo 1, of a sequence that fills a cube evenly, however long it is (Roberts 2018, The unreasonable
effectiveness of quasirandom sequences): shares of the range of stretches along x, y and z."""


@settings
class TowerDomain(Domain):
    """Block sets for experiments and for evaluation, and the plans that can be made of them."""

    training: BlockSource = Field(default_factory=BlockSource)
    """Blocks that the robot experiments with."""
    evaluation: BlockSource = Field(default_factory=BlockSource)
    """Other blocks, for every evaluation."""
    offset: Offset = Field(default_factory=Offset)
    mirror: bool = True
    """Train on mirror images too? What stands, stands in a mirror."""
    mass_scales: Annotated[Whole, Field(ge=0, le=100)] = 4
    """Train on each tower with its masses scaled so many ways, instead of its own? What stands, stands if every block
    weighs twice as much. 0: its own masses."""
    stretch: bool = True
    """Train on towers that are stretched along each axis, too? What stands, stands if all lengths along one axis are
    twice as long."""
    position_of: PositionOf = PositionOf.BOTTOM
    """Where the positions that a network sees count from."""
    length_unit: Metres = LENGTH
    """Unit of the lengths that a network sees [m]."""

    n_features = N_FEATURES
    plan_word = "tower"
    object_word = "block"
    object_files = ("training_blocks.csv", "evaluation_blocks.csv")

    @cached_property
    def training_blocks(self) -> BlockSet:
        """The set that the robot experiments with."""
        return _loaded("domain.training.file", self.training)

    @cached_property
    def evaluation_blocks(self) -> BlockSet:
        """The novel set."""
        return _loaded("domain.evaluation.file", self.evaluation)

    @property
    def n_position(self) -> int:
        """As `Domain.n_position`: 0 unless positions count from the bottom block."""
        return N_POSITION if self.position_of is PositionOf.BOTTOM else 0

    def kept_in(self, directory: Path) -> "TowerDomain":
        """This domain with the block sets that `keep` wrote into a directory, wherever they came from at first."""
        files = zip((self.training, self.evaluation), self.object_files, strict=True)
        training, evaluation = (replace(source, file=directory / name) for source, name in files)
        return replace(self, training=training, evaluation=evaluation)

    @cached_property
    def objects(self) -> dict[str, BlockSet]:
        """Both block sets."""
        return dict(zip(self.object_files, (self.training_blocks, self.evaluation_blocks), strict=True))

    def read_objects(self, path: Path) -> BlockSet:
        """A block set of a run directory."""
        return read_blocks(path)

    def write_objects(self, objects: BlockSet, path: Path) -> None:
        """A block file with its units in the header."""
        write_blocks(objects, path, units=True)

    def check_length(self, length: int, key: str, evaluation: bool = False) -> None:
        """As `Domain.check_length`: there must be as many blocks."""
        which = "evaluation" if evaluation else "training"
        n = len(self.evaluation_blocks if evaluation else self.training_blocks)
        if length > n:
            raise InputError(f"{key}: towers of {length} blocks need {length} blocks; domain.{which} has {n}")

    def random_plans(self, length: int, n: int, rng: np.random.Generator) -> Towers:
        """As `Domain.random_plans`: towers of training blocks."""
        return random_towers(self.training_blocks, length, n, rng, self.offset)

    def extend(self, plans: Towers, rng: np.random.Generator) -> Towers:
        """Each plan with one more random placement."""
        return random_extensions(plans, rng, self.offset)

    def vary(self, plans: Towers, rng: np.random.Generator) -> Towers:
        """As `Domain.vary`. Offsets are relative: what lies above a block that moves, moves along."""
        return variations(plans, rng, self.offset.limit)

    def concatenate(self, parts: Sequence[Towers]) -> Towers:
        """All plans of the parts, which have one length."""
        return Towers.concatenate(parts)

    def differ(self, plans: Towers, plan: Towers) -> np.ndarray:
        """As `Domain.differ`: other blocks, another order, a block on another side, or another joint.

        A joint is another one if the upper block lies elsewhere by more than `APART`. A tower that is turned as a
        whole, about the vertical, is the same tower.
        """
        same = np.zeros(len(plans), bool)
        for quarters in range(4):
            other = plan.turned(quarters)
            joints = np.abs(relative_offsets(plans) - relative_offsets(other)).max((1, 2), initial=0)
            same |= (plans.dims == other.dims).all((1, 2)) & (joints <= APART)
        return ~(same & (plans.block == plan.block).all(1))

    def features(self, plans: Towers) -> np.ndarray:
        """[N, K, n_features] float32: what a network sees."""
        return in_unit(features(plans, self.position_of), self.length_unit)

    def views(self, plans: Towers) -> Iterator[np.ndarray]:
        """Features of plans whose labels are the same as these have.

        They are turned by 0, 90, 180, 270 degrees (Section Learning), each of these is mirrored if `mirror`, the masses
        of each are scaled in `mass_scales` ways, and each of these is stretched in a way of its own if `stretch`. The
        first are the plans' own if there are neither.
        """
        masses, shares = list(self._masses(plans)), np.zeros(3)
        for quarters in range(4):
            turned = plans.turned(quarters)
            x = features(turned, self.position_of)
            for view in (x, mirrored(x)) if self.mirror else (x,):
                for weighed_view in (weighed(view, mass) for mass in masses) if masses else (view,):
                    shares = (shares + STRETCHES) % 1
                    factors = self._stretch(turned, shares)
                    yield in_unit(stretched(weighed_view, factors) if self.stretch else weighed_view, self.length_unit)

    def _stretch(self, plans: Towers, shares: np.ndarray) -> np.ndarray:
        """[N, 3] factors along each axis: shares of the way from the smallest to the largest that is allowed.

        The sides of stretched towers are to be in the range of those of the set.
        """
        shortest, longest = plans.blocks.dims.min(), plans.blocks.dims.max()
        low, high = shortest / plans.dims.min(1), longest / plans.dims.max(1)
        return low ** (1 - shares) * high**shares

    def _masses(self, plans: Towers) -> Iterator[np.ndarray]:
        """[N, K] masses in the same proportions [kg], from the lightest to the heaviest that the set's range allows."""
        lightest, heaviest = plans.blocks.mass.min(), plans.blocks.mass.max()
        low, high = lightest / plans.mass.min(1, keepdims=True), heaviest / plans.mass.max(1, keepdims=True)
        for share in np.linspace(0, 1, self.mass_scales):
            yield plans.mass * low ** (1 - share) * high**share

    def feasible(self, plans: Towers) -> np.ndarray:
        """[N] bool: would the plan succeed in a world without noise?"""
        return stands(plans)

    def problem(self, length: int, candidates: int, rng: np.random.Generator, evaluation: bool = True) -> Towers:
        """As `Domain.problem`: all candidates use all of `length` blocks."""
        blocks = self._set(evaluation)
        chosen = rng.choice(len(blocks), length, replace=False)
        return random_towers(blocks.subset(chosen), length, candidates, rng, self.offset)

    def balanced(self, length: int, n: int, rng: np.random.Generator) -> tuple[Towers, np.ndarray]:
        """As `Domain.balanced`: towers of evaluation blocks."""
        return balanced_towers(self.evaluation_blocks, length, n, rng, self.offset)

    def encode(self, plans: Towers, evaluation: bool = False) -> list[dict[str, Any]]:
        """As `Domain.encode`: blocks by their numbers in the whole set."""
        number = {name: i for i, name in enumerate(self._set(evaluation).name)}
        block = np.array([number[name] for name in plans.blocks.name])[plans.block]
        return [
            {"block": b, "rotation": r, "xy": xy}
            for b, r, xy in zip(block.tolist(), plans.rotation.tolist(), plans.xy.tolist(), strict=True)
        ]

    def encoded_length(self, plan: dict[str, Any], evaluation: bool = False) -> int:
        """As `Domain.encoded_length`."""
        n = len(self._set(evaluation))
        match plan:
            case {"block": [*block], "rotation": [*rotation], "xy": [*xy]} if len(block) == len(rotation) == len(xy):
                if block and all(type(b) is int and 0 <= b < n for b in block):
                    return len(block)
        raise ValueError(f"a plan is not block (0 to {n - 1}), rotation and xy of some placements")

    def decode(self, plans: Sequence[dict[str, Any]], evaluation: bool = False) -> Towers:
        """As `Domain.decode`."""
        block, rotation = (
            np.array([p[key] for p in plans], dtype) for key, dtype in (("block", np.int16), ("rotation", np.int8))
        )
        return Towers(self._set(evaluation), block, rotation, np.array([p["xy"] for p in plans], float))

    def _set(self, evaluation: bool) -> BlockSet:
        return self.evaluation_blocks if evaluation else self.training_blocks

    def table(self, plans: Towers) -> pd.DataFrame:
        """One row per placement, in the columns of a tower file."""
        return tower_table(plans)

    def save_picture(self, plan: Towers, path: Path, title: str = "") -> bool:
        """As `Domain.save_picture`."""
        from apf.towers.picture import save_picture

        save_picture(plan, path, title)
        return True

    def read_plans(self, path: Path, objects: BlockSet | None = None) -> list[NamedPlans]:
        """The towers of a tower file."""
        return read_towers(path, objects)


def _loaded(key: str, source: BlockSource) -> BlockSet:
    try:
        return source.load()
    except InputError as error:
        raise InputError(f"{key}: {error}") from None
