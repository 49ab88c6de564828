"""Where block sets come from: files, or the published distribution."""

from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field

from apf.errors import InputError
from apf.rng import stream
from apf.settings import Name, Number, Seed, Whole, from_low_to_high, settings
from apf.towers.blocks import MOST, BlockSet
from apf.towers.files import read_blocks

Side = Annotated[Number, Field(ge=0.0001, le=10)]
Mass = Annotated[Number, Field(ge=0.000001, le=10_000)]


@settings
class BlockSource:
    """Where a block set comes from: a file, or the published distribution, fixed by a seed of its own."""

    blocks: Annotated[Whole, Field(ge=1, le=10000)] = 10
    """How many to draw."""
    seed: Seed = 0
    prefix: Name = "block"
    """Blocks are named prefix_00, prefix_01, ..."""
    side: Annotated[tuple[Side, Side], AfterValidator(from_low_to_high)] = (0.05, 0.15)
    """Range of each side [m]."""
    mass: Annotated[tuple[Mass, Mass], AfterValidator(from_low_to_high)] = (0.1, 1.0)
    """Range of the mass [kg]."""
    com_share: Annotated[Number, Field(ge=0, lt=1)] = 0.9
    """The centre of mass lies in this middle share of the block, on each axis."""
    file: Path | None = None
    """A block file (CSV or parquet) to use instead of random blocks."""

    def load(self) -> BlockSet:
        """The blocks of the file, or random ones. Raises InputError if the file is wrong."""
        if self.file is not None:
            blocks = read_blocks(self.file)
            if len(blocks) > MOST:
                raise InputError(f"{self.file}: {len(blocks)} blocks; towers are drawn from at most {MOST}")
            return blocks
        rng = stream(self.seed, "blocks")
        dims = rng.uniform(*self.side, (self.blocks, 3))
        mass = rng.uniform(*self.mass, self.blocks)
        com = dims * self.com_share * rng.uniform(-0.5, 0.5, (self.blocks, 3))
        return BlockSet(tuple(f"{self.prefix}_{i:02d}" for i in range(self.blocks)), dims, com, mass)
