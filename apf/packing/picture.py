"""A picture of one packing: its layers from above, and the view from the side."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke

from apf.errors import InputError
from apf.packing.packings import LEVEL, Packings
from apf.packing.rule import Failure, failures

COLOURS = ("#4477aa", "#ccbb44", "#228833", "#ee6677", "#66ccee", "#aa3377", "#bbbbbb")
"""Paul Tol's bright palette, which colour-blind readers tell apart."""
CM = 100
FAILED = "#cc3311"
SAYS = {
    Failure.NONE: "succeeds",
    Failure.WALL: "hits a wall",
    Failure.FINGER_WALL: "a finger hits a wall",
    Failure.FINGER_BOX: "a finger hits a box",
    Failure.TOO_HIGH: "stands above the rim",
    Failure.UNSUPPORTED: "tips",
    Failure.PUSHED: "pushes a box over",
}


def draw_packing(packing: Packings) -> Figure:
    """One packing (N = 1): a panel from above for each layer, and one from the side.

    A layer holds the boxes that lie on the floor, or on boxes of the layer below it; those below are shown pale. The
    last box is drawn bold, its fingers are dashed. Boxes after the first that fails are left out.
    """
    if len(packing) != 1:
        raise ValueError(f"a picture shows one packing, not {len(packing)}")
    found = failures(packing)[0]
    bad = np.flatnonzero(found)
    shown = packing.prefix(int(bad[0]) + 1 if len(bad) else packing.length)
    failure = Failure(found[shown.length - 1])
    layer = _layers(shown)
    container = packing.cell.container
    layers = int(layer.max()) + 1
    length, width, height = (side * CM for side in (container.length, container.width, container.height))
    scale = 2.5 / length  # inches for a cm
    figure = Figure(
        figsize=((layers + 1) * (2.5 + 0.55) + 0.1, max(width, height) * scale + 0.95), layout="constrained"
    )
    axes: Sequence[Axes] = figure.subplots(1, layers + 1, squeeze=False)[0]
    for number, ax in enumerate(axes[:-1]):
        ax.set_title("on the floor" if number == 0 else f"layer {number + 1}", fontsize=9)
        _walls(ax, length, width)
        for i in np.flatnonzero(layer <= number):
            _box(ax, shown, int(i), 1, pale=bool(layer[i] < number), failed=failure is not Failure.NONE)
        if layer[-1] == number:
            _fingers(ax, shown, 1)
    side = axes[-1]
    side.set_title("from the side", fontsize=9)
    for x in (-length / 2, length / 2):
        side.plot([x, x], [0, height], color="black", linewidth=2, solid_capstyle="butt")
    side.plot([-length / 2, length / 2], [0, 0], color="black", linewidth=2)
    for i in np.argsort(-shown.xy[0, :, 1]):  # what is far away first
        _box(side, shown, int(i), 2, pale=False, failed=failure is not Failure.NONE)
    _fingers(side, shown, 2)
    for ax, upper in zip(axes, [width / 2] * layers + [height * 1.12], strict=True):
        lower = -width / 2 if upper == width / 2 else 0
        ax.set_xlim(-length / 2 - 0.8, length / 2 + 0.8)
        ax.set_ylim(lower - 0.8, upper + 0.8)
        ax.set_aspect("equal")
        ax.tick_params(labelsize=7, length=2)
        ax.set_xlabel("x [cm]", fontsize=8)
        ax.spines[:].set_visible(False)
    axes[0].set_ylabel("y [cm]", fontsize=8)
    side.set_ylabel("z [cm]", fontsize=8)
    last = shown.boxes.name[shown.box[0, -1]]
    figure.suptitle(
        f"Placement {shown.length - 1}, {last}: {SAYS[failure]}",
        fontsize=10,
        color="black" if failure is Failure.NONE else FAILED,
    )
    return figure


def save_picture(packing: Packings, path: Path) -> None:
    """Write the picture of one packing, .png, .svg or .pdf. Raises InputError if it cannot be written."""
    try:
        draw_packing(packing).savefig(path, dpi=200)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be written: {error}") from None


def _layers(packing: Packings) -> np.ndarray:
    """[K]: 0 for a box on the floor, else one more than the highest layer that the box lies on."""
    layer = np.zeros(packing.length, int)
    half = packing.dims[0, :, :2] / 2
    top = packing.z[0] + packing.dims[0, :, 2]
    for j in range(packing.length):
        for i in range(j):
            apart = np.abs(packing.xy[0, i] - packing.xy[0, j]) >= half[i] + half[j]
            if not apart.any() and abs(top[i] - packing.z[0, j]) < LEVEL:
                layer[j] = max(layer[j], layer[i] + 1)
    return layer


def _walls(ax: Axes, length: float, width: float) -> None:
    ax.add_patch(
        Rectangle((-length / 2, -width / 2), length, width, fill=False, linewidth=2, edgecolor="black", zorder=1)
    )


def _corner(packing: Packings, i: int, up: int) -> tuple[np.ndarray, np.ndarray]:
    """Lowest corner and sides [2] of a box [cm], along x and `up` (1: y, 2: z)."""
    middle = np.append(packing.xy[0, i], packing.z[0, i] + packing.dims[0, i, 2] / 2)
    sides = packing.dims[0, i]
    return (middle - sides / 2)[[0, up]] * CM, sides[[0, up]] * CM


def _box(ax: Axes, packing: Packings, i: int, up: int, pale: bool, failed: bool) -> None:
    corner, sides = _corner(packing, i, up)
    last = i == packing.length - 1
    colour = COLOURS[i % len(COLOURS)]
    edge = FAILED if last and failed else "black"
    ax.add_patch(
        Rectangle(
            (corner[0], corner[1]),
            sides[0],
            sides[1],
            facecolor=colour,
            edgecolor="#999999" if pale else edge,
            alpha=0.25 if pale else 0.95,
            linewidth=1.8 if last else 0.8,
            zorder=2 if pale else 3,
        )
    )
    if not pale:
        name = packing.boxes.name[packing.box[0, i]]
        above, upright = up == 1, sides[1] > sides[0]
        ax.text(
            corner[0] + sides[0] / 2,
            corner[1] + (sides[1] / 2 if above else sides[1] - 0.9),
            f"{i}\n{name}" if above else str(i),
            fontsize=6.5,
            ha="center",
            va="center",
            zorder=5,
            rotation=90 if above and upright else 0,
            path_effects=[withStroke(linewidth=1.6, foreground="white")],
        )


def _fingers(ax: Axes, packing: Packings, up: int) -> None:
    """The last placement's fingers, dashed."""
    gripper, grip = packing.cell.gripper, int(packing.grip[0, -1])
    x, y = packing.xy[0, -1]
    half = packing.dims[0, -1, grip] / 2 + gripper.thickness / 2
    extent = np.array([gripper.width, gripper.width])
    extent[grip] = gripper.thickness
    bottom = packing.z[0, -1] + gripper.lift
    rise = packing.cell.container.height * 1.12 - bottom
    for sign in (-1, 1) if up == 1 or grip == 0 else (1,):
        middle = np.array([x, y])
        middle[grip] += sign * half
        low = (middle - extent / 2) * CM
        corner, sides = (low, extent * CM) if up == 1 else ((low[0], bottom * CM), (extent[0] * CM, rise * CM))
        ax.add_patch(
            Rectangle(
                (corner[0], corner[1]), sides[0], sides[1], fill=False, linestyle=(0, (3, 2)), linewidth=1.1, zorder=6
            )
        )
