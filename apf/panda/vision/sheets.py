"""Sheets of paper with the faces of blocks at their true size, to be cut out and glued onto real blocks. In mm."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from apf.errors import InputError
from apf.panda.vision.markers import CELLS, FACES, MARGIN, check_number, face_axes, face_sides, marker_image
from apf.towers import BlockSet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPER = (210.0, 297.0)
"""Width and height of A4."""
BORDER = 12.0
"""Printers leave so much of each edge white."""
HEADER = 16.0
"""Above the faces: the ruler, and what to do."""
GAP = 8.0
"""Between two faces; the label of a face stands below it."""
RULER = 100.0
POINT = 25.4 / 72
"""Size of letters is in points."""
LARGEST = (PAPER[0] - 2 * BORDER, PAPER[1] - 2 * BORDER - HEADER - GAP)
"""Width and height of the largest face that a sheet holds."""


@dataclass(frozen=True)
class Piece:
    """A face of a block on a sheet: its lower left corner from that of the paper, its width and height."""

    block: int
    face: int
    x: float
    y: float
    width: float
    height: float


def face_name(face: int) -> str:
    """Where a face looks in the block's frame: +x, -x, +y, ..."""
    return _direction(face_axes(face)[2])


def arranged(blocks: BlockSet) -> list[list[Piece]]:
    """All faces of all blocks in their order, sheet by sheet, in rows from the upper left.

    Raises:
        InputError: A face is larger than a sheet, or there are more blocks than markers.
    """
    check_number(len(blocks))
    sheets: list[list[Piece]] = []
    x, top, lowest = np.inf, -np.inf, -np.inf
    for block, face in np.ndindex(len(blocks), FACES):
        width, height = (1000 * side for side in face_sides(blocks.dims[block], face))
        if width > LARGEST[0] or height > LARGEST[1]:
            raise InputError(
                f"block {blocks.name[block]}: its face {face_name(face)} is {width:g} x {height:g} mm; "
                f"a sheet holds {LARGEST[0]:g} x {LARGEST[1]:g} mm"
            )
        if x + width > PAPER[0] - BORDER:
            x, top = BORDER, lowest - GAP
        if top - height - GAP < BORDER:
            sheets.append([])
            x, top = BORDER, PAPER[1] - BORDER - HEADER
            lowest = top
        sheets[-1].append(Piece(block, face, x, top - height, width, height))
        x, lowest = x + width + GAP, min(lowest, top - height)
    return sheets


def drawn_sheets(blocks: BlockSet) -> Iterator["Figure"]:
    """A figure of the size of the paper for each sheet; the coordinates of its one axes are mm.

    Raises:
        InputError: A face is larger than a sheet, or there are more blocks than markers.
    """
    from matplotlib.figure import Figure

    sheets = arranged(blocks)
    for number, pieces in enumerate(sheets, 1):
        figure = Figure(figsize=(PAPER[0] / 25.4, PAPER[1] / 25.4))
        axes = figure.add_axes((0, 0, 1, 1), xlim=(0, PAPER[0]), ylim=(0, PAPER[1]))
        axes.set_axis_off()
        _draw_header(axes, f"Sheet {number} of {len(sheets)}")
        for piece in pieces:
            _draw_piece(axes, piece, blocks.name[piece.block])
        yield figure


def _draw_header(axes: "Axes", title: str) -> None:
    top = PAPER[1] - BORDER
    axes.plot((BORDER, BORDER + RULER), (top, top), color="black", linewidth=0.5, marker="|", markersize=8)
    axes.text(BORDER + RULER + 4, top, f"{RULER:g} mm: print at 100 %", size=9, va="center")
    axes.text(PAPER[0] - BORDER, top, title, size=9, va="center", ha="right")
    said = "Cut along the lines. Below each face: block, where the face looks, and which axis points up on it."
    axes.text(BORDER, top - 6, said, size=7, va="center")


def _draw_piece(axes: "Axes", piece: Piece, name: str) -> None:
    """The outline of a face, its marker in the middle, and its label, as large as the width allows."""
    x, y = piece.x + piece.width / 2, piece.y + piece.height / 2
    half = min(piece.width, piece.height) / 2 * CELLS / (CELLS + 2 * MARGIN)
    image = marker_image(FACES * piece.block + piece.face, 32)[32 * MARGIN : -32 * MARGIN, 32 * MARGIN : -32 * MARGIN]
    axes.imshow(
        image,
        cmap="gray",
        vmin=0,
        vmax=255,
        extent=(x - half, x + half, y - half, y + half),
        interpolation="none",
        aspect="auto",
    )
    xs, ys = (piece.x, piece.x + piece.width), (piece.y, piece.y + piece.height)
    axes.plot([*xs, *xs[::-1], xs[0]], np.repeat([*ys, ys[0]], 2)[:5], color="0.6", linewidth=0.3)
    axes.set(xlim=(0, PAPER[0]), ylim=(0, PAPER[1]))
    label = f"{name}  {face_name(piece.face)}  up {_direction(face_axes(piece.face)[1])}"
    size = min(7.0, (piece.width + GAP) / (0.7 * len(label) * POINT))
    axes.text(piece.x, piece.y - 1, label, size=size, va="top", parse_math=False)


def _direction(axis: np.ndarray) -> str:
    """A unit vector [3] along an axis, in words."""
    which = int(np.abs(axis).argmax())
    return f"{'+' if axis[which] > 0 else '-'}{'xyz'[which]}"
