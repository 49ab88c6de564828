"""Pictures of towers: what is drawn, and where."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from apf.errors import InputError
from apf.towers import BlockSet, Towers, stands
from apf.towers.picture import draw_in_perspective, draw_tower, save_picture


def test_a_picture_has_all_blocks_and_centres(cubes: BlockSet, line: Callable[..., Towers]) -> None:
    """Three cubes of 12.5 cm at x = 0, 5 and 10 cm: the upper two balance at 7.5 cm, 1.25 cm outside the first."""
    tower = line(cubes, [0.0, 0.05, 0.10])
    assert not stands(tower).any()
    perspective, front, _, above = draw_tower(tower, "a title").axes
    assert len([patch for patch in perspective.patches if isinstance(patch, Polygon)]) == 9
    boxes = [patch for patch in front.patches if isinstance(patch, Rectangle)]
    np.testing.assert_allclose([box.get_xy() for box in boxes], [(-6.25, 0), (-1.25, 12.5), (3.75, 25)], atol=1e-9)
    dots = [tuple(np.ravel(dot.get_data())) for dot in front.lines if dot.get_marker() == "o"]
    np.testing.assert_allclose(dots, [(0, 6.25), (5, 18.75), (10, 31.25)])
    crosses = {
        tuple(np.ravel(cross.get_data())): cross.get_color() for cross in front.lines if cross.get_marker() == "x"
    }
    np.testing.assert_allclose(list(crosses), [(7.5, 12.5), (10, 25)])
    assert list(crosses.values()) == ["#cc3311", "black"], "the one outside its patch is red"
    patch = above.patches[-1]
    assert isinstance(patch, Rectangle)
    assert (patch.get_x(), patch.get_width(), patch.get_height()) == pytest.approx((-1.25, 7.5, 12.5))


def test_the_marks_are_explained(cubes: BlockSet, line: Callable[..., Towers]) -> None:
    several, one = (draw_tower(line(cubes, xs)).get_supxlabel() for xs in ([0.0, 0.05], [0.0]))
    assert "centre of mass" in one and "hatched" not in one
    assert several.startswith(one) and "hatched" in several


def test_what_fell_is_an_outline(cubes: BlockSet, line: Callable[..., Towers]) -> None:
    ax = Figure().subplots()
    draw_in_perspective(ax, line(cubes, [0.0, 0.05, 0.10]), stood=2)
    assert [patch.get_facecolor()[3] for patch in ax.patches] == [1] * 6 + [0] * 3


def test_one_tower_at_a_time(cubes: BlockSet, line: Callable[..., Towers]) -> None:
    tower = line(cubes, [0.0, 0.05])
    with pytest.raises(ValueError, match="one tower, not 2"):
        draw_tower(Towers.concatenate([tower, tower]))


@pytest.mark.parametrize("name", ["a.png", "a.svg", "a.pdf"])
def test_files(tmp_path: Path, cubes: BlockSet, line: Callable[..., Towers], name: str) -> None:
    save_picture(line(cubes, [0.0]), tmp_path / name)
    assert (tmp_path / name).stat().st_size > 1000


def test_a_file_that_cannot_be_written(tmp_path: Path, cubes: BlockSet, line: Callable[..., Towers]) -> None:
    for path in (tmp_path / "no" / "a.png", tmp_path / "a.nothing"):
        with pytest.raises(InputError, match="cannot be written"):
            save_picture(line(cubes, [0.0]), path)
