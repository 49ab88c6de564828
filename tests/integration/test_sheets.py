"""Sheets of paper with the markers of real blocks."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest

from apf.towers import BlockSet, write_blocks
from integration.command_line import call

pytest.importorskip("pybullet")

from apf.panda.vision.detection import detect
from apf.panda.vision.markers import face_sides, marker_sides
from apf.panda.vision.sheets import BORDER, PAPER, arranged, drawn_sheets

PER_MM = 8
"""Pixels in which sheets are looked at."""


def blocks_of(*dims: tuple[float, float, float]) -> BlockSet:
    n = len(dims)
    return BlockSet(tuple(f"$b_{i}" for i in range(n)), np.array(dims), np.zeros((n, 3)), np.ones(n))


def test_each_face_has_its_place_on_a_sheet(graspable: BlockSet) -> None:
    sheets = arranged(graspable)
    pieces = [piece for sheet in sheets for piece in sheet]
    assert [(piece.block, piece.face) for piece in pieces] == list(np.ndindex(4, 6))
    for piece in pieces:
        sides = face_sides(1000 * graspable.dims[piece.block], piece.face)
        np.testing.assert_allclose((piece.width, piece.height), sides)
        assert BORDER <= piece.x <= PAPER[0] - BORDER - piece.width
        assert BORDER <= piece.y <= PAPER[1] - BORDER - piece.height
    for sheet in sheets:
        for one, other in itertools.combinations(sheet, 2):
            beside = one.x + one.width < other.x or other.x + other.width < one.x
            assert beside or one.y + one.height < other.y or other.y + other.height < one.y


def test_sheets_are_true_to_scale() -> None:
    """As a scanner would see the sheets: every marker is read, is as large as it must be, and in its place."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    blocks = blocks_of((0.04, 0.055, 0.07), (0.03, 0.14, 0.09))
    for figure, pieces in zip(drawn_sheets(blocks), arranged(blocks)):
        figure.set_dpi(25.4 * PER_MM)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        image = np.asarray(canvas.buffer_rgba())[..., 0].copy()
        assert image.shape == (round(PAPER[1] * PER_MM), round(PAPER[0] * PER_MM))
        found = {(each.block, each.face): each.corners / PER_MM for each in detect(image, 2)}
        assert set(found) == {(piece.block, piece.face) for piece in pieces}
        for piece in pieces:
            corners = found[piece.block, piece.face]
            side = 1000 * marker_sides(blocks.dims[piece.block])[piece.face]
            left, upper = piece.x + (piece.width - side) / 2, PAPER[1] - piece.y - (piece.height + side) / 2
            expected = [[left, upper], [left + side, upper], [left + side, upper + side], [left, upper + side]]
            np.testing.assert_allclose(corners, expected, atol=0.3)


def test_the_command_writes_pages_of_a4(here: Path, graspable: BlockSet) -> None:
    write_blocks(graspable, "blocks.csv")
    said = call("blocks=blocks.csv", "out=new/markers.pdf", command="apf.panda.sheets").must_work().out
    pages = len(arranged(graspable))
    assert said == f"new/markers.pdf: markers of 4 blocks on {pages} sheets of A4; print at 100 %\n"
    written = Path("new/markers.pdf").read_bytes()
    boxes = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", written)
    assert len(boxes) == pages
    for width, height in boxes:
        assert float(width) / 72 * 25.4 == pytest.approx(PAPER[0], abs=0.01)
        assert float(height) / 72 * 25.4 == pytest.approx(PAPER[1], abs=0.01)
    call("blocks=blocks.csv", "out=new/again.pdf", command="apf.panda.sheets").must_work()
    assert Path("new/again.pdf").read_bytes() == written
    assert {path.name for path in here.iterdir()} == {"blocks.csv", "new"}


@pytest.mark.parametrize(
    ("blocks", "arguments", "words"),
    [
        (blocks_of((0.05, 0.05, 0.05)), ("out=markers.png",), ("out=markers.png", ".pdf")),
        (blocks_of((0.05, 0.05, 0.05), (0.05, 0.05, 0.4)), (), ("block $b_1", "face +x", "50 x 400 mm", "186 x")),
        (blocks_of(*[(0.05, 0.05, 0.05)] * 42), (), ("42 blocks", "markers for 41")),
        (blocks_of((0.05, 0.05, 0.05)), ("blocks=none.csv",), ("none.csv", "no such file")),
        (blocks_of((0.05, 0.05, 0.05)), ("out=blocks.csv/a.pdf",), ("blocks.csv",)),
        (blocks_of((0.05, 0.05, 0.05)), ("paper=a3",), ("paper",)),
    ],
)
def test_sheets_refuses(blocks: BlockSet, arguments: tuple[str, ...], words: tuple[str, ...], here: Path) -> None:
    write_blocks(blocks, "blocks.csv")
    call("blocks=blocks.csv", *arguments, command="apf.panda.sheets").must_refuse(*words)
    assert {path.name for path in here.iterdir()} == {"blocks.csv"}
