"""What the robot is doing, in words, for the pictures of a film."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from apf.panda.accounting import BUILD, DONE, INTERVENTION
from apf.panda.builder import Built
from apf.panda.hardware import Image
from apf.panda.robot import Robot
from apf.towers import Towers

WORDS = {1: "stood", 0: "fell", -1: "-"}
"""For the label of a prefix."""
INK, PAPER, FRAME = (30, 34, 40), (250, 250, 250), (90, 96, 104)
DESIGNED = 960
"""Width of the picture for which the sizes of letters and margins are given [pixels]."""
SHARE = 0.28
"""Of the picture's width, that of the inset."""


@dataclass
class Caption:
    """Follows one tower (N = 1) and the robot that builds it.

    chances: [K] predicted for each prefix; None: not known. built: what has come of the tower.
    """

    tower: Towers
    robot: Robot
    chances: Sequence[float] | None = None
    built: Built | None = None

    def judged(self, built: Built) -> None:
        """Called when a placement was judged."""
        self.built = built

    def lines(self) -> tuple[str, str]:
        """What the robot is at, and what has come of each prefix."""
        labels = np.full(self.tower.length, -1) if self.built is None else self.built.labels
        chances = [""] * len(labels) if self.chances is None else [f" (p = {chance:.2f})" for chance in self.chances]
        prefixes = "   ".join(f"{i}: {WORDS[int(y)]}{p}" for i, (y, p) in enumerate(zip(labels, chances), 1))
        return self._action(), prefixes

    def _action(self) -> str:
        entries, names = self.robot.account.entries, self.tower.blocks.name
        if not entries:
            return "look"
        entry = entries[-1]
        if entry.purpose == INTERVENTION:
            return f"a person helps with {entry.block}: {entry.outcome}"
        if entry.purpose != BUILD:
            return f"clear up: {entry.block}" + (" is home" if entry.wall and entry.outcome == DONE else "")
        place = [names[block] for block in self.tower.block[0]].index(entry.block) + 1
        return f"place {place} of {self.tower.length}: {entry.block}"


def captioned(picture: np.ndarray, lines: Sequence[str]) -> np.ndarray:
    """A picture [H, W, 3] uint8 with lines of text on paper in its upper left corner."""
    scale = picture.shape[1] / DESIGNED
    step, margin, size, weight = 28 * scale, 14 * scale, 0.62 * scale, max(1, round(scale))
    widths = [cv2.getTextSize(line, cv2.FONT_HERSHEY_DUPLEX, size, weight)[0][0] for line in lines]
    corner = (round(max(widths) + 2 * margin), round(step * len(lines) + margin))
    result = picture.copy()
    cv2.rectangle(result, (0, 0), corner, PAPER, cv2.FILLED)
    for number, line in enumerate(lines, 1):
        place = (round(margin), round(number * step))
        cv2.putText(result, line, place, cv2.FONT_HERSHEY_DUPLEX, size, INK, weight, cv2.LINE_AA)
    return result


def with_inset(picture: np.ndarray, image: Image) -> np.ndarray:
    """A picture [H, W, 3] uint8 with a framed, smaller image in its lower right corner."""
    scale = picture.shape[1] / DESIGNED
    width = round(SHARE * picture.shape[1])
    height = max(1, round(width * image.shape[0] / image.shape[1]))
    small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    line, margin = max(1, round(2 * scale)), round(14 * scale)
    framed = cv2.copyMakeBorder(cv2.cvtColor(small, cv2.COLOR_GRAY2RGB), *(line,) * 4, cv2.BORDER_CONSTANT, value=FRAME)
    result = picture.copy()
    bottom, right = picture.shape[0] - margin, picture.shape[1] - margin
    top, left = max(0, bottom - framed.shape[0]), right - framed.shape[1]
    result[top:bottom, left:right] = framed[: bottom - top]
    return result
