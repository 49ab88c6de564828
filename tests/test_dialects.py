"""Files as people have them: CSV as spreadsheets and scripts write it, parquet as pandas and others do."""

import csv
import datetime
import decimal
import io
import warnings

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_tower_files import TOWER_COLUMNS, good_blocks, good_towers, refused

from apf.errors import InputError
from apf.towers import BlockSource, random_towers, read_blocks, read_towers, write_towers
from apf.towers.files import tower_table

SMALL = settings(max_examples=40)


def text_of(table, separator=",", comma=False, newline="\n", quoting=csv.QUOTE_MINIMAL):
    """A table as CSV text; `comma`: with decimal commas."""
    file = io.StringIO()
    writer = csv.writer(file, delimiter=separator, lineterminator=newline, quoting=quoting)
    writer.writerow(table.columns)
    for row in table.itertuples(index=False):
        cells = [repr(float(v)) if isinstance(v, float) else str(v) for v in row]
        writer.writerow([c.replace(".", ",") if comma else c for c in cells])
    return file.getvalue()


def held(batches):
    """All that was read, bit for bit, as something to compare."""
    return [
        (b.names, b.order, b.plans.blocks.name, b.plans.block.tolist(), b.plans.rotation.tolist(),
         *(a.tobytes() for a in (b.plans.xy, b.plans.dims, b.plans.com, b.plans.mass)))
        for b in batches
    ]  # fmt: skip


@pytest.fixture
def written(tmp_path):
    """Writes text or bytes to a CSV file."""

    def write(content, encoding="utf-8"):
        path = tmp_path / "f.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
        return path

    return write


@pytest.fixture
def plain(written):
    """What the towers of `good_towers` are when read from a plain file."""
    return held(read_towers(written(text_of(good_towers()))))


GOOD = text_of(good_towers())
LINES = GOOD.splitlines()


def edited(row, old, new, text=GOOD):
    """The text with one replacement in one of its lines; the header is 1."""
    lines = text.splitlines()
    assert old in lines[row - 1]
    lines[row - 1] = lines[row - 1].replace(old, new, 1)
    return "\n".join(lines) + "\n"


DIALECTS = {
    "semicolons": text_of(good_towers(), ";"),
    "semicolons, decimal commas": text_of(good_towers(), ";", comma=True),
    "tabs": text_of(good_towers(), "\t"),
    "tabs, decimal commas": text_of(good_towers(), "\t", comma=True),
    "bars": text_of(good_towers(), "|"),
    "sep=;": "sep=;\r\n" + text_of(good_towers(), ";", comma=True, newline="\r\n"),
    "sep=,": "sep=,\n" + GOOD,
    '"sep=tab"': '"sep=\t"\n' + text_of(good_towers(), "\t"),
    "sep=^": "sep=^\n" + text_of(good_towers(), "^"),
    "sep= that is not so": "sep=;\n" + GOOD,
    "a comment": "# towers, built in May; by hand\n" + GOOD,
    "comments, quoted, and blank lines": '\n"# towers, built in May"\n,,,\n#\n' + GOOD,
    "a header behind #": "# " + GOOD,
    "CRLF": text_of(good_towers(), newline="\r\n"),
    "CR": text_of(good_towers(), newline="\r"),
    "everything quoted": text_of(good_towers(), quoting=csv.QUOTE_ALL),
    "everything quoted, decimal commas": text_of(good_towers(), ";", comma=True, quoting=csv.QUOTE_ALL),
    "a byte order mark": "\ufeff" + GOOD,
    "blanks around values": GOOD.replace(",", " , "),
    "blank lines": "\n\n".join(LINES) + "\n\n\n",
    "lines of blanks": "\n   \n".join(LINES) + "\n \t \n",
    "lines of separators": f"\n{',' * 16}\n".join(LINES) + "\n,,,\n",
    "lines of as many separators": f"\n{',' * 16}\n".join(LINES) + f"\n{', ' * 16}\n",
    "no line end at the end": GOOD.rstrip("\n"),
    "a comma behind each row": "\n".join([LINES[0], *(f"{line}," for line in LINES[1:])]),
    "a comma behind all lines": "".join(f"{line},\n" for line in LINES),
    "a comma behind the header": "\n".join([f"{LINES[0]},", *LINES[1:]]),
    "commas behind some rows": "\n".join([*LINES[:3], f"{LINES[3]},", f"{LINES[4]},,", *LINES[5:]]),
    "an index without a name": "\n".join(f"{'' if not i else i - 1},{line}" for i, line in enumerate(LINES)),
    "a remark of two lines": "\n".join([f"{LINES[0]},remark", *(f'{line},"one\ntwo"' for line in LINES[1:])]),
    "headers in two lines": GOOD.replace("dim_x", '"dim_x\n[m]"'),
    "other columns twice, or without a name": "\n".join([f"{LINES[0]},a,a,,b", *(f"{r},1,2,3,4" for r in LINES[1:])]),
    "plus signs": GOOD.replace(",0.01,", ",+0.01,"),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_dialects(written, plain, dialect):
    assert held(read_towers(written(DIALECTS[dialect]))) == plain


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-be"])
@pytest.mark.parametrize("separator", [",", "\t"])
def test_encodings(written, encoding, separator):
    table = good_towers().replace({"block": {"a": "Würfel", "b": "積み木"}})
    text = text_of(table, separator, newline="\r\n")
    path = written("\ufeff" + text if encoding == "utf-16-be" else text, encoding)
    assert read_towers(path)[1].plans.blocks.name == ("Würfel", "積み木", "c")


BAD = {
    "one field more": (edited(4, "0.5,", "0.5,0,"), "row 4: 18 fields, where the header has 17", "decimal commas?"),
    "one field less": (edited(4, "0.5,", ""), "row 4: 16 fields, where the header has 17", "missing"),
    "one field more, behind": (edited(5, "1.0", "1.0,7"), "row 5: 18 fields", "17"),
    "one field more in all rows": ("\n".join([LINES[0], *(f"{r},7" for r in LINES[1:])]), "row 2: 18 fields"),
    "decimal commas between commas": (edited(2, "0.08", "0,08"), "row 2: 18 fields", "Write 0.1, or separate", ";"),
    "one field": (edited(4, LINES[3], "later"), "row 4: 1 field,"),
    "quoted decimal comma": (edited(3, "0.02", '"0,02"'), "row 3: com_y = 0,02;", "decimal comma?", ";"),
    "decimal commas, quoted, between commas": (text_of(good_towers(), comma=True), "row 2: dim_x = 0,1", "comma?", ";"),
    "a quote that takes the next row with it": (
        "\n".join(["remark," + LINES[0], '"oops,' + LINES[1], *(f'"ok",{r}' for r in LINES[2:])]),
        "row 2", "quotation mark",
    ),
    "commas and points": (edited(4, "0,5", "0.5", DIALECTS["semicolons, decimal commas"]), "row 4", "x = 0.5"),
    "thousands, German": (
        edited(4, ";0,5;", ";1.000,5;", DIALECTS["semicolons, decimal commas"]),
        "row 4", "x = 1.000,5", "without thousands separators",
    ),
    "thousands, English": (edited(4, ",0.5,", ',"1,000.5",'), "row 4", "x = 1,000.5", "without thousands separators"),
    "thousands, Swiss": (edited(4, ",0.5,", ",1'000.5,"), "row 4", "x = 1'000.5", "without thousands separators"),
    "a unit in a cell": (edited(3, "0.06", "6 cm"), "row 3: dim_x = 6 cm;", "in the header, as in dim_x [cm]"),
    "a quote that never closes": (edited(5, ",a,", ',"a,'), "row 5", "quotation mark"),
    "a quote in a remark": (
        "\n".join(['remark,' + LINES[0], *(f"ok,{r}" for r in LINES[1:3]), '"oops,' + LINES[3], *LINES[4:]]),
        "row 4", "quotation mark",
    ),
    "a name of two lines": (edited(3, ",b,", ',"b\nc",'), "row 3: block = 'b\\nc'", "line breaks"),
    "a tower of two lines": (edited(3, "0,1,b", '"0\r\n0",1,b'), "row 3: tower = '0\\r\\n0'", "line breaks"),
    "no header": ("\n".join(LINES[1:]), "row 1: no column names", "first row must name the columns tower, block"),
    "a title": ("My towers\n" + GOOD, "row 1: no column names", "comments begin with #"),
    "blanks between columns": (GOOD.replace(",", " "), "no column names", "separated by commas"),
    "another spelling": (GOOD.replace("dim_x", "Dim X"), "column dim_x is missing; did you mean it by Dim X?"),
    "the unit in the name": (GOOD.replace("dim_x", "dim_x_mm"), "column dim_x is missing; did you mean", "dim_x [mm]"),
    "a header twice": (GOOD.replace("dim_y", "dim_x"), "column dim_x stands twice"),
    "no rows": (LINES[0], "no towers", "at least one row"),
    "nothing but blank lines": ("\n\n ,,\n", "cannot be read as a table", "empty"),
    "nothing but a comment": ("# towers\n", "cannot be read as a table", "empty"),
    "Latin-1": (GOOD.replace(",b,", ",ü,").encode("latin-1"), "not UTF-8 text in row 3", "save it as CSV UTF-8"),
    "UTF-16, cut": (GOOD.encode("utf-16")[:-3], "not UTF-16 text", "save it as CSV UTF-8"),
    "UTF-16 without a mark": (GOOD.encode("utf-16-le"), "no text", "save it as CSV (UTF-8)"),
    "a workbook": (b"PK\x03\x04\x00\x00\x08\x00", "no text"),
    "a number too large": (edited(4, "0.5", "1e400"), "row 4: x = 1e400; it must be a finite number"),
    "a position too far": (edited(4, "0.5,0.05", "1e150,0.05"), "row 4: x, y = 0.5, 1e+150; they must be within 1e+06"),
    "a hexadecimal number": (edited(4, "0.5", "0x1"), "row 4: x = 0x1; it must be a finite number"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_csv_files_get_one_line(written, case):
    text, *said = BAD[case]
    path = written(text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        refused(read_towers, path, *said)


@pytest.mark.parametrize("above", ["", "sep=,\n", "# a\n\n# b\n", '"# a\n'])
@pytest.mark.parametrize("between", ["", "\n", "   \n", ",,\n"])
def test_rows_are_lines_of_the_file(written, above, between):
    """Whatever stands above the header and between the rows, and with line breaks in values."""
    table = good_towers()
    table.insert(0, "remark", ["x", "two\nlines", "x", "x", "x"])
    table.loc[3, "mass"] = "heavy"
    lines = text_of(table).splitlines(keepends=True)
    text = above + between.join(lines)
    line = 1 + text[: text.index("heavy")].count("\n")
    refused(read_towers, written(text), f"row {line}: mass = heavy")


def test_a_separator_of_one_known_column_is_no_separator(written):
    """The separator is the one that finds most columns, also if a header holds another."""
    header = LINES[0].replace("x,y,z", '"x;y",x,y,z')
    rows = [",".join([*r.split(",")[:10], "", *r.split(",")[10:]]) for r in LINES[1:]]
    assert len(read_towers(written("\n".join([header, *rows])))) == 2


class TestImplausible:
    """Numbers that nobody means in m and kg are refused unless the header says m and kg."""

    @pytest.mark.parametrize(
        ("lengths", "masses", "said", "remedy"),
        [
            (1000, 1, "has a side above 1 m", "dim_x [mm] if they are in mm"),
            (1000, 1000, "has a side above 1 m", "dim_x [mm] if they are in mm"),
            (100, 1, "has a side above 1 m", "dim_x [cm] if they are in cm"),
            (0.02, 1e-5, "has a side below 5 mm", "dim_x [m] and mass [kg] if they are meant"),
            (1, 1000, "heavier than any material", "dim_x [mm] and mass [g]"),
            (8, 8e-5, "a hundred times lighter than air", "dim_x [mm] and mass [g]"),
        ],
    )
    def test_blocks(self, tmp_path, lengths, masses, said, remedy):
        table = good_blocks()
        for column in table.columns[1:]:
            table[column] = table[column].astype(float) * (masses if column == "mass" else lengths)
        table.to_csv(tmp_path / "b.csv", index=False)
        refused(read_blocks, tmp_path / "b.csv", "row 2: block a", said, remedy, "mass [g]", "dim_x [m]")
        table.columns = ["block", *(f"{c} [m]" for c in table.columns[1:7]), "mass [kg]"]
        table.to_csv(tmp_path / "b.csv", index=False)
        assert read_blocks(tmp_path / "b.csv").dims[0, 0] == 0.1 * lengths

    def test_units_of_the_sides_come_before_a_centre_of_mass_that_is_outside(self, tmp_path):
        """Sides in cm, centres of mass in mm: what is told first is what is at fault."""
        table = pd.DataFrame([["a", 10, 8, 6, 12, 0, 0, 0.4]], columns=good_blocks().columns)
        table.to_csv(tmp_path / "b.csv", index=False)
        refused(read_blocks, tmp_path / "b.csv", "row 2: block a", "has a side above 1 m", "dim_x [cm]")
        table = table.rename(columns={f"dim_{axis}": f"dim_{axis} [cm]" for axis in "xyz"})
        table.to_csv(tmp_path / "b.csv", index=False)
        refused(read_blocks, tmp_path / "b.csv", "row 2: block a", "com_x, com_y, com_z = 12, 0, 0", "0.05, 0.04, 0.03")

    @pytest.mark.parametrize(("side", "mass"), [(1.0, 1.0), (1.0, 20_000.0), (0.05, 1.0), (0.005, 1e-4)])
    def test_large_light_and_heavy_blocks_are_possible(self, tmp_path, side, mass):
        table = pd.DataFrame([["a", side, side, side, 0, 0, 0, mass]], columns=good_blocks().columns)
        table.to_csv(tmp_path / "b.csv", index=False)
        assert read_blocks(tmp_path / "b.csv").mass[0] == mass

    @pytest.mark.parametrize(("column", "value"), [("dim_x [m]", 1e150), ("mass [kg]", 1e150), ("dim_z [m]", 1e-150)])
    def test_what_cannot_be_computed_with_is_refused_in_any_unit(self, tmp_path, column, value):
        table = good_blocks()
        table.columns = ["block", *(f"{c} [m]" for c in table.columns[1:7]), "mass [kg]"]
        table[[c for c in table if c.startswith("com")]] = 0.0
        table.loc[1, column] = value
        table.to_csv(tmp_path / "b.csv", index=False)
        refused(read_blocks, tmp_path / "b.csv", "row 3: block b", column.split(" ")[0], "must be 1e-0")

    @pytest.mark.parametrize(("unit", "n"), [("mm", 1000), ("cm", 100)])
    def test_heights_alone_in_another_unit(self, tmp_path, unit, n):
        table = good_towers()
        table["z"] = table["z"].astype(float) * n
        table.to_csv(tmp_path / "t.csv", index=False)
        refused(read_towers, tmp_path / "t.csv", "row 2", f"if z is in {unit}, its header must be z [{unit}]")
        table.rename(columns={"z": f"z [{unit}]"}).to_csv(tmp_path / "t.csv", index=False)
        assert len(read_towers(tmp_path / "t.csv")) == 2


def test_all_turned_by_half_about_x_is_asked_about(tmp_path, capfd):
    table = good_towers().iloc[:2]
    table[["qx", "qy", "qz", "qw"]] = [1, 0, 0, 0]
    table.to_csv(tmp_path / "t.csv", index=False)
    assert len(read_towers(tmp_path / "t.csv")) == 1
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(f"{tmp_path / 't.csv'}: all blocks have qx, qy, qz, qw = 1, 0, 0, 0")
    assert "was w written first?" in line
    table.loc[1, ["qx", "qw"]] = [0, 1]
    table.to_csv(tmp_path / "t.csv", index=False)
    read_towers(tmp_path / "t.csv")
    assert capfd.readouterr().err == ""


def typed():
    """The good towers with a proper type for each column, not objects."""
    return good_towers().infer_objects()


INDICES = {
    "of text": lambda t: t.set_axis([f"row {i}" for i in t.index]),
    "of dates": lambda t: t.set_axis(pd.date_range("2024-05-01", periods=len(t))),
    "tower": lambda t: t.set_index("tower"),
    "tower and position": lambda t: t.set_index(["tower", "position"]),
    "block": lambda t: t.set_index("block"),
    "unnamed, of two levels": lambda t: t.set_axis(pd.MultiIndex.from_product([["a"], t.index])),
    "filtered": lambda t: pd.concat([t.assign(tower=9), t]).reset_index(drop=True).query("tower != 9"),
    "tower as a category": lambda t: t.astype({"tower": "string", "block": "string"}).astype(
        {"tower": "category", "block": "category"}
    ),
    "numbers as text": lambda t: t.astype(dict.fromkeys(TOWER_COLUMNS, "string")),
    "numbers as text with decimal commas": lambda t: t.astype(
        dict.fromkeys([c for c in TOWER_COLUMNS if c != "block"], "string")
    ).apply(lambda c: c.str.replace(".", ",") if c.name != "block" else c),
    "nullable": lambda t: t.convert_dtypes(),
    "headers with units": lambda t: t.rename(columns={"dim_x": "dim_x [m]", "mass": "mass (kg)"}),
}


@pytest.mark.parametrize("index", INDICES)
def test_parquet_with_any_index(tmp_path, plain, index):
    path = tmp_path / "t.parquet"
    INDICES[index](typed()).to_parquet(path)
    assert held(read_towers(path)) == plain


def test_parquet_with_an_index_that_counts(tmp_path):
    """pandas keeps such an index as its name, start and step; here it names towers of one block each."""
    table = typed().iloc[[0, 2]].drop(columns="tower")
    table.index = pd.RangeIndex(7, 11, 2, name="tower")
    table.to_parquet(tmp_path / "t.parquet")
    assert [batch.names for batch in read_towers(tmp_path / "t.parquet")] == [(7, 9)]


def test_rows_of_a_filtered_frame_are_counted_from_its_top(tmp_path):
    table = pd.concat([typed().assign(tower=9), typed()]).reset_index(drop=True).query("tower != 9")
    table.iloc[3, table.columns.get_loc("mass")] = -1.0
    table.to_parquet(tmp_path / "t.parquet")
    refused(read_towers, tmp_path / "t.parquet", "row 5: block a differs from an earlier row")


@pytest.mark.parametrize("metadata", [b"", b"{", b"[]", b"null", b"\xff", b'{"index_columns": ["no"], "columns": 3}'])
def test_parquet_with_broken_pandas_metadata(tmp_path, plain, metadata):
    path = tmp_path / "t.parquet"
    pq.write_table(pa.Table.from_pandas(typed()).replace_schema_metadata({b"pandas": metadata}), path)
    assert held(read_towers(path)) == plain


def column_of(values, kind=None):
    return pa.array(values, kind)


ODD = {
    "struct": column_of([{"m": 0.1}] * 5),
    "list": column_of([[0.1]] * 5),
    "date": column_of([datetime.date(2024, 5, 1)] * 5),
    "timestamp": column_of([datetime.datetime(2024, 5, 1)] * 5),
    "duration": column_of([datetime.timedelta(1)] * 5),
    "bool": column_of([True] * 5),
    "binary": column_of([b"0.1"] * 5),
    "map": column_of([[("a", 1)]] * 5, pa.map_(pa.string(), pa.int32())),
    "category of dates": column_of([datetime.date(2024, 5, 1)] * 5).dictionary_encode(),
}


@pytest.mark.parametrize("kind", ODD)
@pytest.mark.parametrize("column", ["tower", "block", "position", "dim_x", "qw"])
def test_parquet_columns_of_odd_types_get_one_line(tmp_path, kind, column):
    table = pa.Table.from_pandas(typed())
    table = table.set_column(table.schema.get_field_index(column), column, ODD[kind])
    pq.write_table(table, tmp_path / "t.parquet")
    refused(
        read_towers, tmp_path / "t.parquet", f"column {column} holds values of type", "it must hold numbers or text"
    )


@pytest.mark.parametrize("kind", [pa.decimal128(30, 15), pa.float32(), pa.large_string(), pa.null(), pa.float16()])
def test_parquet_columns_of_other_types(tmp_path, kind):
    """Decimals give the doubles nearest to them; a column of nothing is empty."""
    values = {pa.decimal128(30, 15): decimal.Decimal("0.103000000000123"), pa.large_string(): "0.061", pa.null(): None}
    table = pa.Table.from_pandas(good_blocks().iloc[:1].infer_objects())
    value = values.get(kind, 0.0625)
    table = table.set_column(1, "dim_x", column_of([np.float16(value) if kind == pa.float16() else value], kind))
    pq.write_table(table, tmp_path / "b.parquet")
    if value is None:
        refused(read_blocks, tmp_path / "b.parquet", "row 2: dim_x = (empty); it must be a finite number")
    else:
        assert read_blocks(tmp_path / "b.parquet").dims[0, 0] == float(value)


def test_parquet_columns_that_stand_twice(tmp_path):
    table = pa.Table.from_pandas(typed())
    pq.write_table(table.append_column("mass", table["mass"]), tmp_path / "t.parquet")
    refused(read_towers, tmp_path / "t.parquet", "column mass stands twice")


def test_what_a_library_says_of_bytes_is_told_in_one_line(tmp_path, monkeypatch):
    def broken(path):
        raise OSError("Couldn't deserialize thrift: don't know what type: \x0e\nmore")

    monkeypatch.setattr("apf.rundir.tables.ParquetFile", broken)
    refused(read_towers, tmp_path / "t.parquet", "cannot be read as a table: ", "what type: \\x0e")


def test_a_folder_is_no_file(tmp_path):
    for ending in (".csv", ".parquet"):
        path = tmp_path / f"folder{ending}"
        path.mkdir()
        refused(read_towers, path, "cannot be read as a table")


@SMALL
@given(
    seed=st.integers(0, 2**32 - 1),
    separator=st.sampled_from(",;\t|"),
    comma=st.booleans(),
    newline=st.sampled_from(["\n", "\r\n", "\r"]),
    quoting=st.sampled_from([csv.QUOTE_ALL, csv.QUOTE_MINIMAL]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]),
    above=st.sampled_from(["", "# mine; all, of\tit\n", "sep={}\n", "\n\n"]),
    behind=st.sampled_from(["", "{}", "{0}{0}"]),
)
def test_any_dialect_gives_the_same_towers(
    tmp_path_factory, seed, separator, comma, newline, quoting, encoding, above, behind
):
    """Written in one dialect or another, the same towers come back, bit for bit."""
    path = tmp_path_factory.getbasetemp() / "dialect.csv"
    rng = np.random.default_rng(seed)
    towers = [random_towers(BlockSource(blocks=4, seed=seed % 99).load(), k, 3, rng) for k in (1, 4)]
    write_towers(towers, path)
    table = pd.concat([tower_table(towers[0]), tower_table(towers[1], first=3)])
    expected = held(read_towers(path))
    text = text_of(table, separator, comma and separator != ",", newline, quoting)
    text = text.replace(newline, behind.format(separator) + newline)
    path.write_bytes((above.format(separator).replace("\n", newline) + text).encode(encoding))
    assert held(read_towers(path)) == expected


CORRUPT = {
    "utf-8": GOOD.encode(),
    "utf-16": DIALECTS["tabs"].encode("utf-16"),
    "quoted": DIALECTS["everything quoted, decimal commas"].encode(),
}


@settings(max_examples=150)
@given(
    start=st.sampled_from(sorted(CORRUPT)),
    edits=st.lists(
        st.tuples(st.floats(0, 1), st.integers(0, 4), st.sampled_from([*b'",;\n\r\t #=-e.9\x00\xff', 0x85])), max_size=3
    ),
)
def test_a_damaged_file_is_read_or_refused_in_one_line(tmp_path_factory, start, edits):
    """Bytes put in, taken out or cut off: the file is read, or there is one line; no other exception, no warning."""
    content = CORRUPT[start]
    for where, taken, byte in edits:
        at = int(where * len(content))
        content = content[:at] if taken == 4 else content[:at] + bytes([byte]) + content[at + taken :]
    check_damaged(tmp_path_factory.getbasetemp() / "damaged.csv", content)


@settings(max_examples=150)
@given(edits=st.lists(st.tuples(st.floats(0, 1), st.booleans(), st.integers(0, 255)), min_size=1, max_size=3))
def test_a_damaged_parquet_file_is_read_or_refused_in_one_line(tmp_path_factory, edits):
    file = io.BytesIO()
    typed().to_parquet(file)
    content = file.getvalue()
    for where, cut, byte in edits:
        at = int(where * len(content))
        content = content[:at] if cut and where > 0.5 else content[:at] + bytes([byte]) + content[at + 1 :]
    check_damaged(tmp_path_factory.getbasetemp() / "damaged.parquet", content)


def check_damaged(path, content):
    """Fails unless the content is read, or refused in one line that names the file."""
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            for batch in read_towers(path):
                assert np.isfinite(batch.plans.xy).all()
                assert (batch.plans.mass > 0).all()
        except InputError as error:
            assert str(error).startswith(str(path))
            assert str(error).isprintable()
