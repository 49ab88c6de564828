"""Block towers as a domain of plans: what the rest of the package needs to know of them, and no more.

The four parts that a new domain supplies (appendix, Method Generalizability) are action definitions (here),
experimental infrastructure and a feasibility detector (`apf.worlds`), and inductive bias (the connectivity of
`apf.models`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import pandas as pd
from pydantic import Field

from apf.errors import InputError
from apf.settings import Whole, settings
from apf.towers.balanced import balanced_towers
from apf.towers.blocks import BlockSet, BlockSource
from apf.towers.features import N_FEATURES, N_POSITION, features, mirrored, weighed
from apf.towers.files import read_blocks, tower_table, write_blocks
from apf.towers.stability import stands
from apf.towers.towers import Offset, Towers, random_extensions, random_towers


@settings
class TowerDomain:
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

    _names: ClassVar = ("training_blocks.csv", "evaluation_blocks.csv")
    n_features = N_FEATURES
    n_position = N_POSITION

    @cached_property
    def training_blocks(self) -> BlockSet:
        """The set that the robot experiments with."""
        return _loaded("domain.training.file", self.training)

    @cached_property
    def evaluation_blocks(self) -> BlockSet:
        """The novel set."""
        return _loaded("domain.evaluation.file", self.evaluation)

    @cached_property
    def _kept(self) -> set[tuple[str, bytes]]:
        """Files, by name and content, that were found to hold these sets: the runs of a sweep have the same."""
        return set()

    def keep(self, directory: Path) -> None:
        """Write both block sets into a run directory, unless they are there: what was labelled stays tied to them."""
        for name, blocks in self._sets().items():
            if not self.is_kept(directory / name):
                write_blocks(blocks, directory / name, units=True)

    def is_kept(self, path: Path) -> bool:
        """Is there such a file, and does it hold what `keep` writes there?"""
        try:
            return path.exists() and self._sets()[path.name].equals(read_blocks(path))
        except InputError:
            return False

    def check_kept(self, directory: Path) -> None:
        """Raises InputError if a block set is not the one that `keep` wrote."""
        for name, blocks in self._sets().items():
            path = directory / name
            content = path.read_bytes() if path.is_file() else b""
            if (name, content) in self._kept:
                continue
            if not blocks.equals(read_blocks(path)):
                raise InputError(f"{path} differs from the blocks of now; labels belong to the blocks there")
            self._kept.add((name, content))

    def kept_in(self, directory: Path) -> "TowerDomain":
        """This domain with the block sets that `keep` wrote into a directory, wherever they came from at first."""
        files = zip((self.training, self.evaluation), self._names, strict=True)
        training, evaluation = (replace(source, file=directory / name) for source, name in files)
        return replace(self, training=training, evaluation=evaluation)

    @property
    def digests(self) -> dict[str, str]:
        """By the name of its file, digits that tell a block set from all others."""
        return {name: blocks.digest for name, blocks in self._sets().items()}

    def _sets(self) -> dict[str, BlockSet]:
        return dict(zip(self._names, (self.training_blocks, self.evaluation_blocks), strict=True))

    def check_length(self, length: int, key: str, evaluation: bool = False) -> None:
        """Raises InputError, naming the config key, if no plan of `length` placements can be made."""
        which = "evaluation" if evaluation else "training"
        n = len(self.evaluation_blocks if evaluation else self.training_blocks)
        if length > n:
            raise InputError(f"{key}: towers of {length} blocks need {length} blocks; domain.{which} has {n}")

    def random_plans(self, length: int, n: int, rng: np.random.Generator) -> Towers:
        """n random plans of `length` placements of training blocks."""
        return random_towers(self.training_blocks, length, n, rng, self.offset)

    def extend(self, plans: Towers, rng: np.random.Generator) -> Towers:
        """Each plan with one more random placement."""
        return random_extensions(plans, rng, self.offset)

    def concatenate(self, parts: Sequence[Towers]) -> Towers:
        """All plans of the parts, which have one length."""
        return Towers.concatenate(parts)

    def features(self, plans: Towers) -> np.ndarray:
        """[N, K, n_features] float32: what a network sees."""
        return features(plans)

    def views(self, plans: Towers) -> Iterator[np.ndarray]:
        """Features of plans whose labels are the same as these have.

        They are turned by 0, 90, 180, 270 degrees (Section Learning), each of these is mirrored if `mirror`, and the
        masses of each are scaled in `mass_scales` ways. The first are the plans' own if there are none.
        """
        masses = list(self._masses(plans))
        for quarters in range(4):
            turned = features(plans.turned(quarters))
            for view in (turned, mirrored(turned)) if self.mirror else (turned,):
                yield from (weighed(view, mass) for mass in masses) if masses else (view,)

    def _masses(self, plans: Towers) -> Iterator[np.ndarray]:
        """[N, K] masses in the same proportions [kg], from the lightest to the heaviest that the set's range allows."""
        lightest, heaviest = plans.blocks.mass.min(), plans.blocks.mass.max()
        low, high = lightest / plans.mass.min(1, keepdims=True), heaviest / plans.mass.max(1, keepdims=True)
        for share in np.linspace(0, 1, self.mass_scales):
            yield plans.mass * low ** (1 - share) * high**share

    def feasible(self, plans: Towers) -> np.ndarray:
        """[N] bool: would the plan succeed in a world without noise?"""
        return stands(plans)

    def problem(self, n_blocks: int, candidates: int, rng: np.random.Generator) -> Towers:
        """A planning problem: random plans that use all of `n_blocks` evaluation blocks chosen at random."""
        chosen = rng.choice(len(self.evaluation_blocks), n_blocks, replace=False)
        return random_towers(self.evaluation_blocks.subset(chosen), n_blocks, candidates, rng, self.offset)

    def balanced(self, length: int, n: int, rng: np.random.Generator) -> tuple[Towers, np.ndarray]:
        """n plans with evaluation blocks, and their labels [n] bool: half of them feasible."""
        return balanced_towers(self.evaluation_blocks, length, n, rng, self.offset)

    def encode(self, plans: Towers) -> list[dict[str, Any]]:
        """Each plan as what JSON can hold; `decode` gives the same plan bit for bit."""
        return [
            {"block": b, "rotation": r, "xy": xy}
            for b, r, xy in zip(plans.block.tolist(), plans.rotation.tolist(), plans.xy.tolist(), strict=True)
        ]

    def encoded_length(self, plan: dict[str, Any]) -> int:
        """How many placements a plan has that `encode` wrote. Raises ValueError if it is not one of this domain."""
        n = len(self.training_blocks)
        match plan:
            case {"block": [*block], "rotation": [*rotation], "xy": [*xy]} if len(block) == len(rotation) == len(xy):
                if block and all(type(b) is int and 0 <= b < n for b in block):
                    return len(block)
        raise ValueError(f"a plan is not block (0 to {n - 1}), rotation and xy of some placements")

    def decode(self, plans: Sequence[dict[str, Any]]) -> Towers:
        """The plans, all of one length, that `encode` wrote."""
        block, rotation = (
            np.array([p[key] for p in plans], dtype) for key, dtype in (("block", np.int16), ("rotation", np.int8))
        )
        return Towers(self.training_blocks, block, rotation, np.array([p["xy"] for p in plans], float))

    def table(self, plans: Towers) -> pd.DataFrame:
        """One row per placement, `tower` counting from 0, in the columns of a tower file."""
        return tower_table(plans)


def _loaded(key: str, source: BlockSource) -> BlockSet:
    try:
        return source.load()
    except InputError as error:
        raise InputError(f"{key}: {error}") from None
