"""Words in the pictures of a film, and chances from the file of the tower."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from apf.panda.accounting import BUILD, INTERVENTION, TIDY, Account, Entry
from apf.panda.builder import Built
from apf.panda.caption import FRAME, PAPER, Caption, captioned, with_inset
from apf.panda.commands.show import chances_of
from apf.towers import BlockSet, Towers, write_towers


@pytest.fixture
def tower(graspable: BlockSet) -> Towers:
    return Towers(graspable, np.array([[2, 0, 3]]), np.zeros((1, 3), int), np.zeros((1, 3, 2)))


def test_what_the_robot_is_at(tower: Towers) -> None:
    account = Account()
    caption = Caption(tower, SimpleNamespace(account=account), [0.91, 0.5, 0.25])  # type: ignore[arg-type]
    assert caption.lines() == ("look", "1: - (p = 0.91)   2: - (p = 0.50)   3: - (p = 0.25)")
    caption.chances = None
    names = tower.blocks.name
    account.entries.append(Entry(BUILD, names[0]))
    caption.judged(Built(np.array([1, -1, -1]), "stood"))
    assert caption.lines() == (f"place 2 of 3: {names[0]}", "1: stood   2: -   3: -")
    caption.judged(Built(np.array([1, 0, -1]), "fell"))
    account.entries.append(Entry(INTERVENTION, names[1], "jammed"))
    assert caption.lines() == (f"a person helps with {names[1]}: jammed", "1: stood   2: fell   3: -")
    account.entries.append(Entry(TIDY, names[2]))
    assert caption.lines()[0] == f"clear up: {names[2]}"
    account.entries[-1].wall = 1.0
    assert caption.lines()[0] == f"clear up: {names[2]} is home"


@pytest.mark.parametrize("width", [48, 960])
def test_words_and_inset_have_corners_of_their_own(width: int) -> None:
    """The rest of the picture, and the picture that was given, stay as they are."""
    picture = np.full((width * 2 // 3, width, 3), 100, np.uint8)
    worded = captioned(picture, ("place 1 of 2: a", "1: -"))
    assert (worded[0, 0] == PAPER).all()
    assert (worded[width // 3 :] == 100).all()
    framed = with_inset(picture, np.full((480, 640), 7, np.uint8))
    assert (framed == 7).all(-1).any()
    assert (framed == FRAME).all(-1).any()
    assert (framed[:, : width // 2] == 100).all()
    assert (framed[: width // 3] == 100).all()
    assert (picture == 100).all()


def test_chances_come_from_the_file(tower: Towers, tmp_path: Path) -> None:
    """Its rows may be in any order."""
    write_towers(tower[np.array([0, 0])], tmp_path / "a.csv")
    assert chances_of(tmp_path / "a.csv", 1) is None
    table = pd.read_csv(tmp_path / "a.csv")
    table["chance"] = [0.9, 0.8, 0.7, 0.6, 0.5, 0.4]
    table.iloc[[0, 5, 1, 4, 2, 3]].to_csv(tmp_path / "b.csv", index=False)
    assert chances_of(tmp_path / "b.csv", 0) == [0.9, 0.8, 0.7]
    assert chances_of(tmp_path / "b.csv", 1) == [0.6, 0.5, 0.4]
