"""Where box sets come from: files, or random boxes."""

from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field

from apf.packing.boxes import SIDES, VALUES, BoxSet
from apf.packing.files import read_boxes
from apf.rng import stream
from apf.settings import Name, Number, Seed, Whole, from_low_to_high, settings

Side = Annotated[Number, Field(ge=SIDES[0], le=SIDES[1])]
Value = Annotated[Number, Field(ge=VALUES[0], le=VALUES[1])]


@settings
class BoxSource:
    """Where a box set comes from: a file, or uniform distributions, fixed by a seed of their own."""

    boxes: Annotated[Whole, Field(ge=1, le=10000)] = 20
    """How many to draw."""
    seed: Seed = 0
    prefix: Name = "box"
    """Boxes are named prefix_00, prefix_01, ..."""
    side: Annotated[tuple[Side, Side], AfterValidator(from_low_to_high)] = (0.05, 0.12)
    """Range of each side [m]."""
    value: Annotated[tuple[Value, Value], AfterValidator(from_low_to_high)] = (1.0, 10.0)
    """Range of the value."""
    file: Path | None = None
    """A box file (CSV or parquet) to use instead of random boxes."""

    def load(self) -> BoxSet:
        """The boxes of the file, or random ones. Raises InputError if the file is wrong."""
        if self.file is not None:
            return read_boxes(self.file)
        rng = stream(self.seed, "boxes")
        dims = rng.uniform(*self.side, (self.boxes, 3))
        value = rng.uniform(*self.value, self.boxes)
        return BoxSet(tuple(f"{self.prefix}_{i:02d}" for i in range(self.boxes)), dims, value)
