import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apf.errors import InputError
from apf.towers import BlockSet, Towers, random_towers, read_blocks, read_towers, write_blocks, write_towers

BLOCK_COLUMNS = ["block", "dim_x", "dim_y", "dim_z", "com_x", "com_y", "com_z", "mass"]
TOWER_COLUMNS = ["tower", "position", *BLOCK_COLUMNS, "x", "y", "z", "qx", "qy", "qz", "qw"]
ENDINGS = ["csv", "parquet"]
SMALL = settings(max_examples=25)

seeds = st.integers(0, 2**32 - 1)
names = st.lists(st.text("abcXYZ,;'\"#ä漢 _-.", min_size=1).filter(lambda s: s == s.strip()), min_size=1, max_size=5)
unique_names = names.map(lambda several: [f"n{i}{name}" for i, name in enumerate(several)])


@st.composite
def block_sets_and_units(draw):
    """Blocks whose numbers use all bits of a double, and whether headers name units: then they may be implausible."""
    called, units = draw(unique_names), draw(st.booleans())
    side = st.floats(1e-3, 10) if units else st.floats(5e-3, 1)
    share = st.floats(-0.499, 0.499)
    dims = np.array([[draw(side) for _ in range(3)] for _ in called])
    com = dims * np.array([[draw(share) for _ in range(3)] for _ in called])
    mass = [draw(st.floats(1e-6, 1e6) if units else st.floats(0.011, 24_000)) for _ in called]
    mass = np.array(mass) if units else np.maximum(mass * dims.prod(1), 1e-9)
    return BlockSet(tuple(called), dims, com, mass), units


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("files")


def good_blocks():
    """Two blocks, as a table."""
    return pd.DataFrame(
        [["a", 0.1, 0.08, 0.06, 0.01, 0.0, -0.01, 0.5], ["b", 0.06, 0.1, 0.12, 0.0, 0.02, 0.0, 0.25]],
        columns=BLOCK_COLUMNS,
        dtype=object,
    )


def good_towers():
    """A tower of two, named 0, and one of three, named 1, as a table. Row r of it is row r + 2 of a file."""
    a = ["a", 0.1, 0.08, 0.06, 0.01, 0.0, -0.01, 0.5]
    b = ["b", 0.06, 0.1, 0.12, 0.0, 0.02, 0.0, 0.25]
    c = ["c", 0.05, 0.05, 0.05, 0.0, 0.0, 0.0, 0.1]
    upright = [0.0, 0.0, 0.0, 1.0]
    half = np.sqrt(0.5)
    about_x = [half, 0.0, 0.0, half]  # b's height becomes its y side, 0.1
    return pd.DataFrame(
        [
            [0, 0, *a, 0.0, 0.0, 0.03, *upright],
            [0, 1, *b, 0.02, 0.01, 0.12, *upright],  # 0.06 + 0.12 / 2
            [1, 0, *b, 0.5, 0.5, 0.05, *about_x],
            [1, 1, *a, 0.52, 0.5, 0.13, *upright],  # 0.1 + 0.06 / 2
            [1, 2, *c, 0.5, 0.5, 0.185, *upright],  # 0.1 + 0.06 + 0.05 / 2
        ],
        columns=TOWER_COLUMNS,
        dtype=object,
    )


def save(table, path):
    """Write a table as it is; in parquet, a column of numbers with text among them becomes text."""
    if path.suffix == ".csv":
        table.to_csv(path, index=False)
        return path
    text = [c for c in table if table[c].map(lambda v: isinstance(v, str)).any()]
    table.astype(dict.fromkeys(text, "string")).infer_objects().to_parquet(path, index=False)
    return path


def put(row, column, value):
    """An edit: one cell of the table."""

    def edit(table):
        table.loc[row, column] = value
        return table

    return edit


def refused(read, path, *said):
    """`read(path)` raises one line of InputError that names the file and says all of `said`."""
    with pytest.raises(InputError) as error:
        read(path)
    message = str(error.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    for part in said:
        assert part in message


class TestRoundTrip:
    @pytest.mark.parametrize("ending", ENDINGS)
    @SMALL
    @given(blocks_and_units=block_sets_and_units())
    def test_blocks(self, folder, ending, blocks_and_units):
        blocks, units = blocks_and_units
        path = folder / f"blocks.{ending}"
        write_blocks(blocks, path, units=units)
        back = read_blocks(path)
        assert back.name == blocks.name
        for field in ("dims", "com", "mass"):
            assert getattr(back, field).tobytes() == getattr(blocks, field).tobytes()

    @pytest.mark.parametrize("ending", ENDINGS)
    @SMALL
    @given(
        blocks_and_units=block_sets_and_units(),
        seed=seeds,
        lengths=st.lists(st.integers(1, 5), min_size=1, max_size=3, unique=True),
    )
    def test_towers(self, folder, ending, blocks_and_units, seed, lengths):
        blocks, units = blocks_and_units
        rng = np.random.default_rng(seed)
        written = [random_towers(blocks, min(k, len(blocks)), 3, rng) for k in lengths]
        path = folder / f"towers.{ending}"
        write_towers(written, path, units=units)
        read = {order: (batch, n) for batch in read_towers(path) for n, order in enumerate(batch.order)}
        assert sorted(read) == list(range(3 * len(lengths)))
        originals = [(towers, n) for towers in written for n in range(3)]
        for order, (towers, n) in enumerate(originals):
            batch, m = read[order]
            assert str(batch.names[m]) == str(order)
            assert batch.plans.xy[m].tobytes() == towers.xy[n].tobytes()
            np.testing.assert_array_equal(batch.plans.rotation[m], towers.rotation[n])
            for field in ("dims", "com", "mass", "z"):
                np.testing.assert_array_equal(getattr(batch.plans, field)[m], getattr(towers, field)[n])
            held = [batch.plans.blocks.name[b] for b in batch.plans.block[m]]
            assert held == [blocks.name[b] for b in towers.block[n]]

    @pytest.mark.parametrize("ending", ENDINGS)
    def test_a_single_batch_needs_no_list(self, tmp_path, blocks, ending):
        towers = random_towers(blocks, 3, 4, np.random.default_rng(0))
        write_towers(towers, tmp_path / f"t.{ending}")
        (batch,) = read_towers(tmp_path / f"t.{ending}")
        assert batch.order == (0, 1, 2, 3)
        assert [str(name) for name in batch.names] == ["0", "1", "2", "3"]
        assert batch.plans.xy.tobytes() == towers.xy.tobytes()

    @pytest.mark.parametrize("name", ["01", "1.0", "1e3", "007", "NA", "nan", "null", "None", "True", "-", "a b"])
    @pytest.mark.parametrize("ending", ENDINGS)
    def test_names_are_text_even_if_they_look_like_something_else(self, tmp_path, cubes, ending, name):
        path = tmp_path / f"blocks.{ending}"
        write_blocks(BlockSet((name, "1"), cubes.dims[:2], cubes.com[:2], cubes.mass[:2]), path)
        assert read_blocks(path).name == (name, "1")

    def test_block_names_of_digits_stay_apart_in_towers(self, tmp_path, cubes):
        two = BlockSet(("1", "01"), cubes.dims[:2] * [[1], [0.5]], cubes.com[:2], cubes.mass[:2])
        towers = Towers(two, np.array([[0, 1]]), np.array([[0, 0]]), np.zeros((1, 2, 2)))
        write_towers(towers, tmp_path / "towers.csv")
        (batch,) = read_towers(tmp_path / "towers.csv")
        assert batch.plans.blocks.name == ("1", "01")

    def test_units_stand_in_the_header(self, tmp_path, blocks):
        write_blocks(blocks, tmp_path / "b.csv", units=True)
        header = (tmp_path / "b.csv").read_text().splitlines()[0]
        assert header == "block,dim_x [m],dim_y [m],dim_z [m],com_x [m],com_y [m],com_z [m],mass [kg]"

    def test_written_poses_are_of_the_centre_of_geometry(self, tmp_path):
        # the tower of `good_towers` named 1: z of the three centres 0.05, 0.13, 0.185
        save(good_towers().iloc[2:], tmp_path / "in.csv")
        (batch,) = read_towers(tmp_path / "in.csv")
        write_towers(batch.plans, tmp_path / "out.csv")
        out = pd.read_csv(tmp_path / "out.csv")
        assert out.columns.tolist() == TOWER_COLUMNS
        np.testing.assert_allclose(out["z"], [0.05, 0.13, 0.185])
        np.testing.assert_allclose(out["x"], [0.5, 0.52, 0.5])
        np.testing.assert_allclose(out[["qx", "qw"]].iloc[0], [np.sqrt(0.5)] * 2)
        assert out["block"].tolist() == ["b", "a", "c"]


class TestReading:
    @pytest.mark.parametrize("ending", ENDINGS)
    def test_good_files(self, tmp_path, ending):
        blocks = read_blocks(save(good_blocks(), tmp_path / f"blocks.{ending}"))
        assert blocks.name == ("a", "b")
        np.testing.assert_array_equal(blocks.dims[1], [0.06, 0.1, 0.12])
        np.testing.assert_array_equal(blocks.com[0], [0.01, 0.0, -0.01])
        assert blocks.mass.tolist() == [0.5, 0.25]

        two, three = read_towers(save(good_towers(), tmp_path / f"towers.{ending}"))
        assert (str(two.names[0]), two.order, two.plans.length) == ("0", (0,), 2)
        assert (str(three.names[0]), three.order, three.plans.length) == ("1", (1,), 3)
        np.testing.assert_array_equal(two.plans.xy, [[[0, 0], [0.02, 0.01]]])
        np.testing.assert_allclose(three.plans.z, [[0.05, 0.13, 0.185]])
        np.testing.assert_allclose(three.plans.dims[0, 0], [0.06, 0.12, 0.1])

    def test_order_of_columns_and_rows_and_further_columns_do_not_matter(self, tmp_path):
        table = good_towers()
        table["remark"] = "mine"
        table = table[table.columns[::-1]].iloc[[4, 1, 2, 0, 3]]
        by_name = {int(b.names[0]): b for b in read_towers(save(table, tmp_path / "t.csv"))}
        np.testing.assert_array_equal(by_name[0].plans.xy, [[[0, 0], [0.02, 0.01]]])
        np.testing.assert_array_equal(by_name[1].plans.xy, [[[0.5, 0.5], [0.52, 0.5], [0.5, 0.5]]])
        assert by_name[1].order == (0,)
        assert by_name[0].order == (1,)

    def test_names_of_towers_are_kept(self, tmp_path):
        table = good_towers()
        table["tower"] = ["left one"] * 2 + ["right"] * 3
        assert [b.names for b in read_towers(save(table, tmp_path / "t.csv"))] == [("left one",), ("right",)]

    def test_tower_names_of_digits_stay_apart(self, tmp_path):
        table = good_towers()
        table["tower"] = ["1"] * 2 + ["01"] * 3
        assert [b.plans.length for b in read_towers(save(table, tmp_path / "t.csv"))] == [2, 3]

    @pytest.mark.parametrize(
        "header",
        ["dim_x [m]", "dim_x (m)", "dim_x[m]", " dim_x "],
        ids=["square", "round", "tight", "spaces"],
    )
    def test_units_may_stand_in_the_header(self, tmp_path, header):
        table = good_blocks().rename(columns={"dim_x": header, "mass": "mass [kg]"})
        assert read_blocks(save(table, tmp_path / "b.csv")).dims[0, 0] == 0.1

    @pytest.mark.parametrize("ending", ENDINGS)
    def test_other_units_are_converted(self, tmp_path, ending):
        """Lengths in mm, cm and dm, masses in g."""
        written = pd.DataFrame(
            [["a", 100, 8.0, 0.6, 10.0, 0.0, -0.01, 500], ["b", 61, 10.1, 1.2, 0.0, 2.3, 0.0, 253.7]],
            columns=["block", "dim_x [mm]", "dim_y [cm]", "dim_z [dm]", "com_x (mm)", "com_y[cm]", "com_z", "mass [g]"],
        )
        blocks = read_blocks(save(written, tmp_path / f"f.{ending}"))
        np.testing.assert_allclose(blocks.dims, [[0.1, 0.08, 0.06], [0.061, 0.101, 0.12]], rtol=1e-15)
        np.testing.assert_allclose(blocks.com, [[0.01, 0.0, -0.01], [0.0, 0.023, 0.0]], rtol=1e-15)
        np.testing.assert_allclose(blocks.mass, [0.5, 0.2537], rtol=1e-15)

    @pytest.mark.parametrize(
        ("column", "header", "said"),
        [
            ("dim_y", "dim_y [inch]", "dim_y is in inch; it must be in m or dm or cm or mm"),
            ("com_z", "com_z (g)", "com_z is in g; it must be in m or"),
            ("mass", "mass [lb]", "mass is in lb; it must be in kg or g"),
        ],
    )
    @pytest.mark.parametrize("ending", ENDINGS)
    def test_an_unknown_unit_is_refused(self, tmp_path, ending, column, header, said):
        path = tmp_path / f"f.{ending}"
        refused(read_blocks, save(good_blocks().rename(columns={column: header}), path), said)
        refused(read_towers, save(good_towers().rename(columns={column: header}), path), said)

    @pytest.mark.parametrize("digits", [3, 4])
    def test_rounded_files_are_read(self, tmp_path, digits):
        # z within the tolerance of 0.1 mm; quaternion 0.707 or 0.7071 for 0.70711
        table = good_towers()
        table[["qx", "qw"]] = table[["qx", "qw"]].astype(float).round(digits)
        table.loc[4, "z"] = 0.18509
        assert len(read_towers(save(table, tmp_path / "t.csv"))) == 2
        table[["qx", "qw"]] = table[["qx", "qw"]].astype(float).round(2)
        refused(read_towers, save(table, tmp_path / "t.csv"), "row 4", "(0.71, 0.0, 0.0, 0.71)", "its length is 1.004")

    def test_the_tolerance_of_heights_grows_with_the_blocks(self, tmp_path):
        """All eight times as large: heights may be off by a thousandth of the taller block, 0.8 and 0.48 m."""
        table = good_towers().iloc[2:]
        lengths = [*(f"{kind}_{axis}" for kind in ("dim", "com") for axis in "xyz"), "x", "y", "z"]
        table[lengths] = table[lengths].astype(float) * 8
        table["mass"] = table["mass"].astype(float) * 1000
        table = put([3, 4], "z", [1.0407, 1.4807])(table)
        assert len(read_towers(save(table, tmp_path / "t.csv"))) == 1
        refused(read_towers, save(put(3, "z", 1.0409)(table), tmp_path / "t.csv"), "row 3", "floats", "z = 1.0409")


@pytest.mark.parametrize("ending", ENDINGS)
class TestBadFiles:
    @pytest.mark.parametrize("column", BLOCK_COLUMNS)
    def test_missing_block_column(self, tmp_path, ending, column):
        path = save(good_blocks().drop(columns=column), tmp_path / f"f.{ending}")
        refused(read_blocks, path, f"column {column} is missing")

    @pytest.mark.parametrize("column", TOWER_COLUMNS)
    def test_missing_tower_column(self, tmp_path, ending, column):
        path = save(good_towers().drop(columns=column), tmp_path / f"f.{ending}")
        refused(read_towers, path, f"column {column} is missing")

    def test_column_that_stands_twice(self, tmp_path, ending):
        table = good_blocks()
        table["dim_x [m]"] = table["dim_x"]
        refused(read_blocks, save(table, tmp_path / f"f.{ending}"), "dim_x")

    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, "wide", "0,1", ""])
    @pytest.mark.parametrize("column", ["dim_z", "com_y", "mass"])
    def test_block_value_that_is_no_number(self, tmp_path, ending, column, value):
        path = save(put(1, column, value)(good_blocks()), tmp_path / f"f.{ending}")
        refused(read_blocks, path, "row 3", f"{column} = ", "must be a finite number")

    @pytest.mark.parametrize("value", [np.nan, "left"])
    @pytest.mark.parametrize("column", ["position", "dim_x", "mass", "x", "z", "qw"])
    def test_tower_value_that_is_no_number(self, tmp_path, ending, column, value):
        path = save(put(3, column, value)(good_towers()), tmp_path / f"f.{ending}")
        refused(read_towers, path, "row 5", f"{column} = ", "must be a finite number")

    @pytest.mark.parametrize(
        ("column", "value", "said"),
        [
            ("dim_x", 0.0, "sides must be > 0"),
            ("dim_y", -0.1, "sides must be > 0"),
            ("mass", 0.0, "mass = 0"),
            ("mass", -2.0, "mass = -2"),
            ("com_x", 0.031, "outside the block"),
            ("com_z", -0.06, "outside the block"),
        ],
    )
    def test_impossible_block(self, tmp_path, ending, column, value, said):
        path = save(put(1, column, value)(good_blocks()), tmp_path / f"f.{ending}")
        refused(read_blocks, path, "row 3", "block b", column, said)
        # b stands in rows 3 and 4 of the tower file
        table = put([1, 2], column, value)(good_towers())
        refused(read_towers, save(table, tmp_path / f"g.{ending}"), "row 3", "block b", column, said)

    def test_block_name_that_stands_twice(self, tmp_path, ending):
        path = save(put(1, "block", "a")(good_blocks()), tmp_path / f"f.{ending}")
        refused(read_blocks, path, "row 3", "block a", "twice")

    @pytest.mark.parametrize("table", [good_blocks, good_towers])
    def test_block_without_a_name(self, tmp_path, ending, table):
        read = read_blocks if table is good_blocks else read_towers
        path = save(put(1, "block", None)(table()), tmp_path / f"f.{ending}")
        refused(read, path, "row 3", "block is empty")

    def test_tower_without_a_name(self, tmp_path, ending):
        path = save(put(1, "tower", None)(good_towers()), tmp_path / f"f.{ending}")
        refused(read_towers, path, "row 3", "tower is empty")

    @pytest.mark.parametrize(("column", "value"), [("mass", 0.26), ("dim_y", 0.11), ("com_x", 1e-9)])
    def test_one_name_for_two_blocks(self, tmp_path, ending, column, value):
        path = save(put(2, column, value)(good_towers()), tmp_path / f"f.{ending}")
        refused(read_towers, path, "row 4", "block b differs from an earlier row")

    def test_block_twice_in_a_tower(self, tmp_path, ending):
        table = good_towers()
        table.loc[4, BLOCK_COLUMNS] = table.loc[2, BLOCK_COLUMNS]
        refused(read_towers, save(table, tmp_path / f"f.{ending}"), "row 6", "tower 1 uses block b twice")

    @pytest.mark.parametrize("positions", [(1, 2, 3), (0, 1, 3), (0, 1, 1), (0, 0.5, 1), (-1, 0, 1)])
    def test_positions_that_do_not_count_from_zero(self, tmp_path, ending, positions):
        path = save(put([2, 3, 4], "position", positions)(good_towers()), tmp_path / f"f.{ending}")
        refused(read_towers, path, "tower 1", "position", "must count 0, 1, 2")

    @pytest.mark.parametrize(
        ("row", "z", "said"),
        [
            (3, 0.1302, ["floats", "z = 0.1302", "at z = 0.13 "]),
            (3, 0.1298, ["overlaps", "z = 0.1298", "at z = 0.13 "]),
            (4, 0.1848, ["overlaps", "z = 0.1848", "at z = 0.185 "]),
            (2, 0.06, ["floats", "z = 0.06", "at z = 0.05 "]),  # the bottom block, above the table
            (2, 0.0, ["overlaps", "z = 0", "at z = 0.05 "]),  # and in it
        ],
    )
    def test_height_that_leaves_a_gap_or_overlaps(self, tmp_path, ending, row, z, said):
        path = save(put(row, "z", z)(good_towers()), tmp_path / f"f.{ending}")
        refused(read_towers, path, f"row {row + 2}", "tower 1", *said)

    @pytest.mark.parametrize(
        ("column", "inside", "outside"),
        [("x", 0.5949, 0.5951), ("x", 0.4451, 0.4449), ("y", 0.5649, 0.5651), ("y", 0.4351, 0.4349)],
    )
    def test_nothing_under_a_block(self, tmp_path, ending, column, inside, outside):
        # c, 0.05 x 0.05, on a at (0.52, 0.5), 0.1 x 0.08: they meet while |dx| < 0.075 and |dy| < 0.065
        table = good_towers()
        assert len(read_towers(save(put(4, column, inside)(table), tmp_path / f"f.{ending}"))) == 2
        path = save(put(4, column, outside)(table), tmp_path / f"f.{ending}")
        refused(read_towers, path, "row 6", "tower 1, position 2", "nothing of the block below is under it")

    @pytest.mark.parametrize(
        "quaternion", [(0, 0, np.sin(np.pi / 8), np.cos(np.pi / 8)), (0, 0, 0, 0), (0, 0, 0, 2), (0.01, 0, 0, 1)]
    )
    def test_rotation_that_is_not_axis_aligned(self, tmp_path, ending, quaternion):
        table = good_towers()
        table.loc[3, ["qx", "qy", "qz", "qw"]] = quaternion
        refused(read_towers, save(table, tmp_path / f"f.{ending}"), "row 5", "not one of the 24")

    @pytest.mark.parametrize("read", [read_blocks, read_towers])
    def test_file_without_content(self, tmp_path, ending, read):
        path = tmp_path / f"f.{ending}"
        path.touch()
        refused(read, path, "cannot be read as a table")

    @pytest.mark.parametrize("read", [read_blocks, read_towers])
    def test_file_of_something_else(self, tmp_path, ending, read):
        path = tmp_path / f"f.{ending}"
        path.write_bytes(b"\xff\xfe\x00\x01PNG")
        refused(read, path, "cannot be read as a table")

    def test_header_without_rows(self, tmp_path, ending):
        refused(read_blocks, save(good_blocks().iloc[:0], tmp_path / f"f.{ending}"), "at least one row")
        refused(read_towers, save(good_towers().iloc[:0], tmp_path / f"g.{ending}"), "at least one row")

    @pytest.mark.parametrize("read", [read_blocks, read_towers])
    def test_no_such_file(self, tmp_path, ending, read):
        refused(read, tmp_path / f"none.{ending}", "no such file")


@pytest.mark.parametrize("name", ["towers.txt", "plans", "towers.csv.gz", "towers.pickle"])
def test_another_ending_is_refused(tmp_path, blocks, name):
    path = tmp_path / name
    path.write_text("block\n")
    towers = random_towers(blocks, 2, 2, np.random.default_rng(0))
    for act in (read_blocks, read_towers, lambda p: write_blocks(blocks, p), lambda p: write_towers(towers, p)):
        refused(act, path, "the ending must be .csv or .parquet")
    assert path.read_text() == "block\n"


def test_rows_are_counted_as_an_editor_counts_them(tmp_path):
    header, a, b = save(put(1, "mass", "heavy")(good_blocks()), tmp_path / "f.csv").read_text().splitlines()
    path = tmp_path / "g.csv"
    path.write_text("\n".join([header, a, "", b, ""]))
    refused(read_blocks, path, "row 4", "mass = heavy")


class TestWriting:
    @pytest.mark.parametrize("ending", ENDINGS)
    def test_a_file_is_replaced_and_its_folder_made(self, tmp_path, blocks, ending):
        path = tmp_path / "new" / "folder" / f"b.{ending}"
        write_blocks(blocks, path)
        write_blocks(blocks.subset(np.array([2])), path)
        assert read_blocks(path).name == (blocks.name[2],)
        assert list(path.parent.iterdir()) == [path]

    @pytest.mark.parametrize("ending", ENDINGS)
    def test_a_write_that_fails_leaves_the_old_file_and_no_other(self, tmp_path, blocks, ending, monkeypatch):
        path = tmp_path / f"b.{ending}"
        write_blocks(blocks, path)
        before = path.read_bytes()

        def full(table, target, **options):
            target.write_bytes(b"half")
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(pd.DataFrame, "to_csv", full)
        monkeypatch.setattr(pd.DataFrame, "to_parquet", full)
        refused(lambda p: write_blocks(blocks, p), path, "cannot be written: No space left on device")
        assert path.read_bytes() == before
        assert list(tmp_path.iterdir()) == [path]

    @pytest.mark.parametrize("ending", ENDINGS)
    def test_a_folder_in_the_way(self, tmp_path, blocks, ending):
        path = tmp_path / f"b.{ending}"
        path.mkdir()
        refused(lambda p: write_blocks(blocks, p), path, "cannot be written")
        assert list(tmp_path.iterdir()) == [path]

    @pytest.mark.parametrize("ending", ENDINGS)
    def test_a_file_where_a_folder_should_be(self, tmp_path, blocks, ending):
        (tmp_path / "file").touch()
        refused(lambda p: write_blocks(blocks, p), tmp_path / "file" / f"b.{ending}", "cannot be written")
