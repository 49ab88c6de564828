"""What an ensemble believes of the top block of a tower, wherever it lies, beside what is true (towers only)."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import SubFigure
from matplotlib.image import AxesImage

from apf.acquisition.bald import bald
from apf.models import Ensemble
from apf.towers import BlockSet, Towers, stands

GRID = 61
"""Offsets along each axis; odd, so that one of them is 0."""
CM = 100
LIKELY, BALD = "RdBu", "magma_r"
"""Colours of chances, blue for success, and of BALD."""
FLAT = (0.85, 0.15)
"""What is true is shown in the colours of these chances: large areas in the darkest ones are hard to look at."""


@dataclass(frozen=True)
class Belief:
    """Maps over the offset of the top block's centre from the centre of the block below.

    blocks: of the tower. x, y: [G] offsets [m]. stands: [G, G] bool, the rule without noise. chance: [G, G] predicted
    for the whole tower. bald: [G, G] what the outcome of the last placement would tell [nats]. The first axis is y.
    """

    blocks: int
    x: np.ndarray
    y: np.ndarray
    stands: np.ndarray
    chance: np.ndarray
    bald: np.ndarray


def towers_over_offsets(blocks: BlockSet, length: int, grid: int = GRID) -> tuple[Towers, np.ndarray, np.ndarray]:
    """Towers of the first blocks of a set, none of them turned, that differ by where the top block lies.

    Each block below the top has its centre of mass above the centre of the block below it, so that it stands. The
    offset of the top block goes as far as the two blocks touch, on both axes.

    Args:
        blocks: A set of at least `length` blocks.
        length: Blocks of each tower.
        grid: G, offsets along each axis.

    Returns:
        The towers [G x G], those of one y after another, and the offsets x [G] and y [G] of the top block [m].
    """
    sides = blocks.dims[:length, :2]
    below = np.vstack([np.zeros((1, 2)), -blocks.com[1 : length - 1, :2].cumsum(0)])
    reach = (sides[-1] + sides[-2]) / 2
    x, y = (np.linspace(-r, r, grid) for r in reach)
    n = grid * grid
    xy = np.empty((n, length, 2))
    xy[:, :-1] = below
    xy[:, -1] = below[-1] + np.stack(np.meshgrid(x, y), -1).reshape(n, 2)
    block = np.tile(np.arange(length, dtype=np.int16), (n, 1))
    return Towers(blocks, block, np.zeros((n, length), np.int8), xy), x, y


def belief(ensemble: Ensemble, blocks: BlockSet, length: int, grid: int = GRID) -> Belief:
    """What the ensemble believes of the top block of a tower, and what is true.

    Args:
        ensemble: A trained one.
        blocks: Whose first blocks the tower is made of.
        length: Blocks of the tower.
        grid: Offsets along each axis.
    """
    towers, x, y = towers_over_offsets(blocks, length, grid)
    told = bald(ensemble.predict(towers)[..., -1])
    values = (each.reshape(grid, grid) for each in (stands(towers), ensemble.feasibility(towers), told))
    return Belief(length, x, y, *values)


def draw_beliefs(figure: SubFigure, beliefs: list[Belief]) -> None:
    """A row for each belief: what is true, the predicted chance, BALD. A line surrounds where the tower stands."""
    grid = figure.subplots(len(beliefs), 3, squeeze=False)
    most = max(float(each.bald.max()) for each in beliefs)
    for row, each in zip(grid, beliefs, strict=True):
        titles = ("Stands (analytic rule)", "Predicted chance", "BALD")
        maps = ((np.where(each.stands, *FLAT), LIKELY, 1.0), (each.chance, LIKELY, 1.0), (each.bald, BALD, most))
        for ax, title, (values, colours, top) in zip(row, titles, maps, strict=True):
            image = draw_map(ax, each, values, colours, top)
            if each is beliefs[0]:
                ax.set_title(title)
            if each is beliefs[-1]:
                ax.set_xlabel("Offset in x [cm]")
            if title != titles[0]:
                ax.tick_params(labelleft=False)
                bar = figure.colorbar(image, ax=ax, fraction=0.05, pad=0.03)
                bar.ax.tick_params(labelsize=6.5, length=2)
                if title == titles[-1]:
                    bar.set_label("nats", fontsize=7)
        row[0].set_ylabel(f"Top of {each.blocks} blocks\nOffset in y [cm]")


def draw_map(ax: Axes, each: Belief, values: np.ndarray, colours: str, top: float) -> AxesImage:
    """Draw one map with the border of where the tower stands.

    Args:
        ax: Where.
        each: Whose border is drawn.
        values: [G, G] what the map shows.
        colours: Name of a colour map.
        top: The value of its last colour; the first one is that of 0.

    Returns:
        The image.
    """
    (left, right), (low, high) = _edges(each.x * CM), _edges(each.y * CM)
    image = ax.imshow(
        values, origin="lower", extent=(left, right, low, high), cmap=colours, vmin=0, vmax=top, interpolation="nearest"
    )
    if each.stands.any():
        ax.contour(each.x * CM, each.y * CM, each.stands.astype(float), levels=[0.5], colors="black", linewidths=1.0)
    ax.set_aspect("equal")
    return image


def _edges(axis: np.ndarray) -> tuple[float, float]:
    """The outer edges of the cells of a map, whose centres these are."""
    half = (axis[1] - axis[0]) / 2
    return axis[0] - half, axis[-1] + half
