"""Box files and packing files: lossless, and each mistake is named by file and row. Pictures."""

import numpy as np
import pandas as pd
import pytest

from apf.errors import InputError
from apf.packing import BoxSource, read_boxes, read_packings, write_boxes, write_packings
from apf.packing.files import BOX_COLUMNS, PACKING_COLUMNS
from apf.packing.picture import SAYS, _layers, draw_packing, save_picture
from apf.packing.rule import Failure, failures


@pytest.mark.parametrize("ending", ["csv", "parquet"])
@pytest.mark.parametrize("units", [False, True])
def test_boxes_come_back_bit_for_bit(ending, units, tmp_path):
    boxes = BoxSource(boxes=50, seed=3).load()
    write_boxes(boxes, tmp_path / f"boxes.{ending}", units=units)
    assert read_boxes(tmp_path / f"boxes.{ending}").equals(boxes)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
@pytest.mark.parametrize("units", [False, True])
def test_packings_come_back_bit_for_bit(domain, ending, units, tmp_path):
    plans = domain.random_plans(3, 30, np.random.default_rng(0))
    path = tmp_path / f"packings.{ending}"
    write_packings(plans, path, units=units)
    (batch,) = read_packings(path, domain.cell)
    assert (batch.names, batch.order) == (tuple(range(30)), tuple(range(30)))
    np.testing.assert_array_equal(batch.plans.dims, plans.dims)
    np.testing.assert_array_equal(batch.plans.xy, plans.xy)
    np.testing.assert_array_equal(batch.plans.orientation, plans.orientation)
    np.testing.assert_array_equal(failures(batch.plans), failures(plans))


def by_hand():
    """Two packings, of two boxes and of one, rows out of order, sides in mm."""
    table = pd.DataFrame(
        [
            ["left", 1, "b", 100, 80, 60, "x90", 0.05, 0.0],
            ["007", 0, "a", 50, 50, 90, "z0", 0.0, 0.02],
            ["left", 0, "a", 50, 50, 90, "y0", -0.1, 0.0],
        ],
        columns=PACKING_COLUMNS,
    )
    return table.rename(columns={side: f"{side} [mm]" for side in ("dim_x", "dim_y", "dim_z")})


def test_a_file_by_hand(domain, tmp_path):
    by_hand().to_csv(tmp_path / "mine.csv", index=False)
    two, one = read_packings(tmp_path / "mine.csv", domain.cell)
    assert (two.names, two.order, one.names, one.order) == (("left",), (0,), ("007",), (1,))
    assert two.plans.boxes.name == ("b", "a")
    np.testing.assert_allclose(two.plans.dims[0], [[0.09, 0.05, 0.05], [0.06, 0.08, 0.1]])
    assert two.plans.xy[0].tolist() == [[-0.1, 0.0], [0.05, 0.0]]


@pytest.mark.parametrize(
    ("row", "column", "value", "words"),
    [
        (2, "orientation", "upright", "row 4: orientation = upright; it must be one of z0, z90"),
        (0, "position", 2, "row 2: packing left: position is 2 instead of 1"),
        (0, "box", "a", "row 3: box a has other sides than in an earlier row"),
        (1, "x", 0.2, r"row 3: x, y = 0.2, 0.02 is outside the container: x is -0.17 to 0.17 m"),
        (1, "x", "far", "row 3: x = far; it must be a finite number"),
        (0, "dim_x [mm]", -5, "row 2: box b: dim_x, dim_y, dim_z = -0.005, 0.08, 0.06; sides must be"),
        (0, "dim_x [mm]", 1e6, "row 2: box b"),
    ],
)
def test_mistakes_are_named(domain, tmp_path, row, column, value, words):
    table = by_hand().astype(object)
    table.loc[row, column] = value
    path = tmp_path / "mine.csv"
    table.to_csv(path, index=False)
    with pytest.raises(InputError, match=f"^{path}, {words}"):
        read_packings(path, domain.cell)


def test_a_box_twice_a_missing_column_and_an_empty_file(domain, tmp_path):
    path = tmp_path / "mine.csv"
    table = by_hand()
    table.loc[0, table.columns[2:6]] = table.loc[2, table.columns[2:6]]
    table.to_csv(path, index=False)
    with pytest.raises(InputError, match="row 2: packing left uses box a twice"):
        read_packings(path, domain.cell)
    by_hand().drop(columns="orientation").to_csv(path, index=False)
    with pytest.raises(InputError, match="column orientation is missing"):
        read_packings(path, domain.cell)
    by_hand().head(0).to_csv(path, index=False)
    with pytest.raises(InputError, match="no packings"):
        read_packings(path, domain.cell)


def test_mistakes_in_box_files(tmp_path):
    path = tmp_path / "boxes.csv"
    good = ["a", 0.1, 0.1, 0.1, 3]
    for row, words in (
        (["a", 0.1, 0.1, 0.1, 3], "row 3: box a: the name stands twice"),
        (["b", 0.1, 0.1, 60, 3], r"row 3: box b: .* write a unit in the header"),
        (["b", 0.1, 0.1, 0.1, -3], "row 3: box b: value = -3"),
    ):
        pd.DataFrame([good, row], columns=BOX_COLUMNS).to_csv(path, index=False)
        with pytest.raises(InputError, match=words):
            read_boxes(path)
    pd.DataFrame([], columns=BOX_COLUMNS).to_csv(path, index=False)
    with pytest.raises(InputError, match="0 boxes"):
        read_boxes(path)


def test_a_picture_shows_layers_names_fingers_and_what_went_wrong(pack, tmp_path):
    placements = [("a", "z90", -0.2, 0.0), ("b", "z90", 0.2, 0.0), ("p", "z0", 0.0, 0.0), ("s", "x0", 0.0, 0.0)]
    packing = pack(*placements)
    assert _layers(packing).tolist() == [0, 0, 1, 2]
    figure = draw_packing(packing)
    assert [ax.get_title() for ax in figure.axes] == ["on the floor", "layer 2", "layer 3", "from the side"]
    texts = [[text.get_text() for text in ax.texts] for ax in figure.axes]
    assert texts == [["0\na", "1\nb"], ["2\np"], ["3\ns"], ["0", "1", "2", "3"]]
    dashed = [sum(patch.get_linestyle() not in ("-", "solid") for patch in ax.patches) for ax in figure.axes]
    assert dashed == [0, 0, 2, 2]
    assert figure.get_suptitle() == "Placement 3, s: succeeds"

    failed = draw_packing(pack(*placements[:2], ("c", "z0", 0.4, 0.3), ("d", "z0", 0.0, -0.3)))
    assert failed.get_suptitle() == "Placement 2, c: hits a wall", "what comes after it is left out"
    assert set(SAYS) == set(Failure)
    save_picture(packing, tmp_path / "picture.png")
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InputError, match="cannot be written"):
        save_picture(packing, tmp_path / "nowhere" / "picture.png")
