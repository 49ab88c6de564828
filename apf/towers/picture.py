"""Pictures of one tower: in perspective, from two sides and from above, with its centres of mass."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle
from matplotlib.patheffects import withStroke

from apf.errors import InputError
from apf.towers.towers import Towers

COLOURS = ("#4477aa", "#ccbb44", "#228833", "#ee6677", "#66ccee", "#aa3377", "#bbbbbb")
"""Paul Tol's bright palette, which colour-blind readers tell apart."""
FELL = "#cc3311"
CM = 100
SPACE = " " * 8
LEGEND = SPACE.join(
    (
        "\u25cf centre of mass of a block",
        "\u00d7 of all blocks above it together: a tower falls if one is outside the block below (red)",
        "hatched: the contact that is nearest to that",
    )
)
"""What the marks are; the first one alone for a single block."""
RIGHT, AHEAD, UP = np.array([0.87, -0.25]), np.array([0.50, 0.43]), np.array([0.0, 1.0])
"""[2] where a unit along x, y and z is drawn in the view in perspective (a parallel projection)."""
EDGE = 0.8
"""Width of the edges of blocks [points]."""


def draw_tower(tower: Towers, title: str = "") -> Figure:
    """One tower (N = 1): in perspective, from the front, from the right, and from above.

    A dot marks each block's centre of mass, a cross the joint centre of mass of the blocks above a block. The hatched
    area, seen from above, is the contact patch that is nearest to being left.

    Args:
        tower: A batch of one.
        title: Of the figure.
    """
    if len(tower) != 1:
        raise ValueError(f"a picture shows one tower, not {len(tower)}")
    figure = Figure(figsize=(9.6, 3.1), layout="constrained")
    axes = figure.subplots(1, 4)
    draw_in_perspective(axes[0], tower)
    for ax, (across, up), name in zip(axes[1:], ((0, 2), (1, 2), (0, 1)), ("front", "right", "above"), strict=True):
        _draw_flat(ax, tower, across, up)
        ax.set_title(f"from {'the ' if name != 'above' else ''}{name}", fontsize=9)
        ax.set_xlabel(f"{'xyz'[across]} [cm]", fontsize=8)
        ax.set_ylabel(f"{'xyz'[up]} [cm]", fontsize=8)
        ax.tick_params(labelsize=7, length=2)
        ax.spines[["top", "right"]].set_visible(False)
    figure.suptitle(title, fontsize=10)
    figure.supxlabel(LEGEND if tower.length > 1 else LEGEND.partition(SPACE)[0], fontsize=7, color="0.3")
    return figure


def save_picture(tower: Towers, path: Path, title: str = "") -> None:
    """Write the picture of one tower.

    Args:
        tower: A batch of one.
        path: Of the file: .png, .svg or .pdf.
        title: Of the figure.

    Raises:
        InputError: The file cannot be written.
    """
    try:
        draw_tower(tower, title).savefig(path, dpi=200)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be written: {error}") from None


def draw_in_perspective(ax: Axes, tower: Towers, stood: int | None = None, names: bool = True) -> None:
    """One tower (N = 1) as a solid, from the front and above.

    Args:
        ax: Where to draw; its frame is taken away.
        tower: A batch of one.
        stood: How many placements stood; the blocks after these are drawn as outlines. None: all are solid.
        names: Write the name of each block on it?
    """
    stood = tower.length if stood is None else stood
    for i in range(tower.length):  # no block hides one above it
        half, middle = tower.dims[0, i] / 2, np.append(tower.xy[0, i], tower.z[0, i])
        for axis, sign, shade in ((2, 1, 1.0), (1, -1, 0.88), (0, 1, 0.72)):
            _face(ax, middle, half, axis, sign, _shaded(COLOURS[i % len(COLOURS)], shade), i < stood)
        if names:
            front = (middle - (0, half[1], 0)) * CM
            _text(ax, _projected(front), tower.blocks.name[tower.block[0, i]])
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.axis("off")


def _projected(points: np.ndarray) -> np.ndarray:
    """[..., 2] where points [..., 3] are drawn."""
    return points[..., :1] * RIGHT + points[..., 1:2] * AHEAD + points[..., 2:] * UP


def _face(
    ax: Axes, middle: np.ndarray, half: np.ndarray, axis: int, sign: int, colour: tuple[float, ...], solid: bool
) -> None:
    first, second = (other for other in range(3) if other != axis)
    corners = np.tile(middle + sign * half * np.eye(3)[axis], (4, 1))
    corners[:, first] += np.array([-1, 1, 1, -1]) * half[first]
    corners[:, second] += np.array([-1, -1, 1, 1]) * half[second]
    look = (
        {"facecolor": colour, "edgecolor": "black"}
        if solid
        else {"facecolor": "none", "edgecolor": FELL, "linestyle": "--"}
    )
    ax.add_patch(Polygon(_projected(corners * CM), linewidth=EDGE, joinstyle="round", **look))


def _shaded(colour: str, share: float) -> tuple[float, ...]:
    return tuple(share * part for part in to_rgb(colour))


def _draw_flat(ax: Axes, tower: Towers, across: int, up: int) -> None:
    """One view along an axis: the blocks, their centres of mass, and the joint centres of mass of those above."""
    from_above = up == 1
    middle = np.concatenate([tower.xy[0], tower.z[0][:, None]], axis=1) * CM
    for i in range(tower.length):
        sides = tower.dims[0, i, [across, up]] * CM
        corner = middle[i, [across, up]] - sides / 2
        ax.add_patch(
            Rectangle(
                (corner[0], corner[1]),
                *sides,
                facecolor=COLOURS[i % len(COLOURS)],
                edgecolor="black",
                linewidth=EDGE,
                alpha=0.55 if from_above else 0.95,
                zorder=2 + i,
            )
        )
        centre = (middle[i] + tower.com[0, i] * CM)[[across, up]]
        ax.plot(*centre, "o", color="black", markersize=3, zorder=30)
    if tower.length > 1:
        joint, low, high = _balance(tower)
        margins = np.minimum(joint - low, high - joint).min(-1)
        for i in range(tower.length - 1):
            place = joint[i] * CM if from_above else np.array([joint[i, across], _tower_top(tower, i)]) * CM
            ax.plot(*place, "x", color=FELL if margins[i] < 0 else "black", markersize=5, zorder=31)
        if from_above:
            worst = int(margins.argmin())
            corner, sides = low[worst] * CM, (high - low)[worst] * CM
            ax.add_patch(
                Rectangle((corner[0], corner[1]), *sides, fill=False, hatch="////", linewidth=0, alpha=0.7, zorder=29)
            )
    ax.autoscale_view()
    ax.set_aspect("equal")


def _balance(tower: Towers) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """[K - 1, 2] each: the joint centre of mass of the blocks above a block, and two corners of the patch they rest on.

    Both in x and y [m]. The tower stands where the centre lies within the patch (`apf.towers.stability`).
    """
    xy, half = tower.xy[0], tower.dims[0, :, :2] / 2
    mass, centre = tower.mass[0, :, None], tower.xy[0] + tower.com[0, :, :2]
    above = np.cumsum((mass * centre)[::-1], axis=0)[::-1] / np.cumsum(mass[::-1], axis=0)[::-1]
    low, high = xy - half, xy + half
    return above[1:], np.maximum(low[:-1], low[1:]), np.minimum(high[:-1], high[1:])


def _tower_top(tower: Towers, placement: int) -> float:
    """Height of the top of a placement's block [m]."""
    return float(tower.z[0, placement] + tower.dims[0, placement, 2] / 2)


def _text(ax: Axes, place: np.ndarray, text: str) -> None:
    ax.text(
        place[0],
        place[1],
        text,
        fontsize=6.5,
        ha="center",
        va="center",
        zorder=40,
        path_effects=[withStroke(linewidth=1.6, foreground="white")],
    )
