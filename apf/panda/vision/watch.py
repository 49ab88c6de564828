"""Looking through cameras that may fail: what is wrong with them is said once, in one line that names the camera."""

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from apf.errors import Stopped
from apf.panda.hardware import Hardware, Image
from apf.panda.settings import Sight
from apf.panda.vision.cameras import STATIC
from apf.panda.vision.eyes import Doubled, Eyes, Sighting
from apf.panda.vision.markers import FACES

ONCE_MORE = 3
"""A marker that is there twice in so many looks is no misreading."""


class Watch:
    """Asks a robot's cameras for images, and its eyes what they show.

    Args:
        sight: How long a camera is waited for, and how often nothing may be seen.
        say: Is called with one line when a camera fails or answers again, or a marker is there twice.
    """

    def __init__(self, sight: Sight, say: Callable[[str], None]) -> None:
        self.sight, self.say = sight, say
        self.silent: set[str] = set()
        """Cameras that do not answer: nobody waits for them any more."""
        self._blind = 0
        self._doubled: Counter[tuple[str, str]] = Counter()

    def look(
        self,
        hardware: Hardware,
        eyes: Eyes,
        names: Sequence[str],
        places: Mapping[str, np.ndarray],
        expected: np.ndarray | None = None,
        only: int | None = None,
    ) -> Sighting:
        """What some cameras see now; the last three arguments are those of `Eyes.estimate`.

        Args:
            hardware: Has the cameras.
            eyes: Know them, and the blocks.
            names: Of the cameras.
            places: [4, 4] of their optical frames.
            expected: [B, 4, 4] where blocks are thought to be.
            only: The block that is asked for.

        Raises:
            Stopped: No camera beside the table answers, or they have seen nothing for long.
        """
        seen = eyes.estimate(self._images(hardware, names), places, expected, only)
        if set(names) == set(STATIC):
            self._blind = 0 if seen.seen.any() else self._blind + 1
            if self._blind >= self.sight.blind:
                raise Stopped(
                    f"cameras {', '.join(names)}: no block's marker was seen in {self._blind} looks in a row; "
                    "is there light, and nothing before the lenses?"
                )
        for each in seen.doubled:
            self._warn_of(each, eyes.blocks.name)
        return seen

    def _images(self, hardware: Hardware, names: Sequence[str]) -> dict[str, Image]:
        """Images of the cameras that answer. One that did before is asked again a few times."""
        found = dict(hardware.images(names))
        for _ in range(self.sight.retries):
            missing = [name for name in names if name not in found and name not in self.silent]
            if not missing:
                break
            hardware.wait(self.sight.retry_pause)
            found.update(hardware.images(missing))
        self._compare(names, found)
        return {name: found[name] for name in names if name in found}

    def _compare(self, names: Sequence[str], found: Collection[str]) -> None:
        """Say which cameras have fallen silent, and which answer again. Raises Stopped if too few are left."""
        for name in names:
            if name in found and name in self.silent:
                self.silent.remove(name)
                self.say(f"camera {name} answers again")
            elif name not in found and name not in self.silent:
                self.silent.add(name)
                asked = f"asked {self.sight.retries + 1} times in {self.sight.retries * self.sight.retry_pause:g} s"
                self.say(f"camera {name} does not answer, {asked}; the robot goes on without it")
        if self.silent.issuperset(STATIC):
            raise Stopped(f"no camera beside the table answers ({', '.join(STATIC)}); it takes one to go on")

    def _warn_of(self, each: Doubled, blocks: Sequence[str]) -> None:
        """Say of a marker that is there twice, once it is sure."""
        places = " and ".join("elsewhere" if block is None else f"on block {blocks[block]}" for block in each.on)
        marker = f"marker {FACES * each.block + each.face}, of block {blocks[each.block]}"
        self._doubled[marker, places] += 1
        if self._doubled[marker, places] == ONCE_MORE:
            self.say(
                f"camera {each.camera} sees {marker}, twice: {places}; it is left out. "
                "Each face takes a marker of its own, as python -m apf.panda.sheets makes them"
            )
