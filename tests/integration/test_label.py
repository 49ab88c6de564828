"""python -m apf.label: somebody's own towers in, one label for each placement out."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from apf.towers import BlockSource, Towers, random_towers, standing_prefixes, write_towers
from apf.towers.files import TOWER_COLUMNS
from integration.command_line import call, spawn

SIDE = 0.1


def placement(tower: object, position: int, block: str, x: float, y: float = 0.0, **changes: object) -> dict:
    """A homogeneous cube of 10 cm, `position` cubes above the table."""
    row = {"tower": tower, "position": position, "block": block, "x": x, "y": y, "z": SIDE * (position + 0.5)}
    row |= dict.fromkeys(["dim_x", "dim_y", "dim_z"], SIDE) | dict.fromkeys(["com_x", "com_y", "com_z"], 0.0)
    row |= {"mass": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 1.0}
    return row | changes


def by_hand() -> pd.DataFrame:
    """Three towers whose fate is plain: overhung by 4 cm it stands, by 6 cm it falls; a stair of 4 cm falls at last."""
    return pd.DataFrame(
        [
            *(placement("stair", i, name, x=0.04 * i) for i, name in enumerate("abc")),
            *(placement("leaning", i, name, x=0.04 * i) for i, name in enumerate("ab")),
            *(placement("fallen", i, name, x=0.06 * i) for i, name in enumerate("abc")),
        ]
    )[TOWER_COLUMNS]


LABELS_BY_HAND = [1, 1, 0, 1, 1, 1, 0, None]


def write(table: pd.DataFrame, path: Path) -> None:
    if path.suffix == ".csv":
        table.to_csv(path, index=False)
    else:
        table.to_parquet(path, index=False)


def read(path: Path) -> pd.DataFrame:
    return pd.read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)


def labels(table: pd.DataFrame) -> list[int | None]:
    return [None if pd.isna(label) else int(label) for label in table["label"]]


@pytest.mark.parametrize("into", [".csv", ".parquet"])
@pytest.mark.parametrize("source", [".csv", ".parquet"])
def test_towers_worked_by_hand(here: Path, source: str, into: str) -> None:
    write(by_hand(), here / f"towers{source}")
    result = call(f"plans=towers{source}", "world=analytic", f"out=labels{into}", command="apf.label").must_work()
    table = read(here / f"labels{into}")
    assert list(table.columns) == ["tower", "position", "label"]
    assert table["tower"].tolist() == by_hand()["tower"].tolist()
    assert table["position"].tolist() == by_hand()["position"].tolist()
    assert labels(table) == LABELS_BY_HAND
    assert f"labels{into}" in result.out
    assert "3 plans labelled, 1 of them succeed" in result.out
    assert sorted(path.name for path in here.iterdir()) == sorted({f"towers{source}", f"labels{into}"})


def test_csv_says_1_0_and_nothing(here: Path) -> None:
    write(by_hand(), here / "towers.csv")
    call("plans=towers.csv", "out=labels.csv", command="apf.label").must_work()
    assert (here / "labels.csv").read_text() == (
        "tower,position,label\nstair,0,1\nstair,1,1\nstair,2,0\nleaning,0,1\nleaning,1,1\n"
        "fallen,0,1\nfallen,1,0\nfallen,2,\n"
    )


def test_towers_keep_the_order_of_the_file(here: Path) -> None:
    """Towers of many lengths, in any order of rows: each comes where the file names it first, bottom up."""
    blocks = BlockSource().load()
    batches = [random_towers(blocks, length, 3, np.random.default_rng(length)) for length in (4, 2, 5, 3)]
    write_towers(batches, here / "written.parquet")
    table = pd.read_parquet(here / "written.parquet")
    table = table.sample(frac=1, random_state=0)
    table["tower"] = "t" + table["tower"].astype(str)
    write(table, here / "towers.csv")
    call("plans=towers.csv", "out=labels.csv", command="apf.label").must_work()
    out = read(here / "labels.csv")
    assert out["tower"].drop_duplicates().tolist() == table["tower"].drop_duplicates().tolist()
    assert out.groupby("tower", sort=False)["position"].apply(lambda p: p.tolist() == list(range(len(p)))).all()
    found = out.set_index(["tower", "position"])["label"]
    number = 0
    for batch in batches:
        for stood in standing_prefixes(batch):
            mine = [found[(f"t{number}", position)] for position in range(batch.length)]
            fell = int(stood.argmin()) if not stood.all() else batch.length
            assert mine[:fell] == [1] * fell
            assert mine[fell : fell + 1] == [0][: batch.length - fell]
            assert np.isnan(mine[fell + 1 :]).all()
            number += 1
    assert number == 12


def test_towers_named_by_numbers_keep_them(here: Path) -> None:
    table = by_hand()
    table["tower"] = table["tower"].map({"stair": 7, "leaning": 3, "fallen": 5})
    write(table, here / "plans.parquet")
    call("plans=plans.parquet", "out=labels.parquet", command="apf.label").must_work()
    out = read(here / "labels.parquet")
    assert out["tower"].tolist() == [7, 7, 7, 3, 3, 5, 5, 5]
    assert labels(out) == LABELS_BY_HAND


def test_headers_may_carry_units(here: Path) -> None:
    units = dict.fromkeys(["dim_x", "dim_y", "dim_z", "com_x", "com_y", "com_z", "x", "y", "z"], "m") | {"mass": "kg"}
    write(by_hand().rename(columns={name: f"{name} [{unit}]" for name, unit in units.items()}), here / "towers.csv")
    call("plans=towers.csv", "out=labels.csv", command="apf.label").must_work()
    assert labels(read(here / "labels.csv")) == LABELS_BY_HAND


AS_PEOPLE_HAVE_THEM = {
    "semicolons and decimal commas": lambda t: "sep=;\r\n" + t.to_csv(sep=";", decimal=",", index=False),
    "tabs, below a comment": lambda t: "# built in May\n" + t.to_csv(sep="\t", index=False),
    "a comma behind each row": lambda t: t.to_csv(index=False).replace("\n", ",\n").replace(",\n", "\n", 1),
    "millimetres and grams": lambda t: (
        t.assign(**{c: t[c] * 1000 for c in t if c[:3] in ("dim", "com") or c in ("x", "y", "z", "mass")})
        .rename(columns={c: f"{c} [mm]" for c in t if c[:3] in ("dim", "com") or c in ("x", "y", "z")})
        .rename(columns={"mass": "mass [g]"})
        .to_csv(index=False)
    ),
}


@pytest.mark.parametrize("kind", AS_PEOPLE_HAVE_THEM)
def test_files_as_people_have_them(here: Path, kind: str) -> None:
    (here / "towers.csv").write_text(AS_PEOPLE_HAVE_THEM[kind](by_hand()), newline="")
    result = call("plans=towers.csv", "out=labels.csv", command="apf.label").must_work()
    assert result.err == ""
    assert labels(read(here / "labels.csv")) == LABELS_BY_HAND


def test_a_parquet_file_with_its_towers_as_the_index(here: Path) -> None:
    by_hand().set_index(["tower", "position"]).to_parquet(here / "plans.parquet")
    call("plans=plans.parquet", "out=labels.csv", command="apf.label").must_work()
    assert labels(read(here / "labels.csv")) == LABELS_BY_HAND


def test_w_first_is_asked_about(here: Path) -> None:
    write(by_hand().assign(qx=1.0, qw=0.0), here / "towers.csv")
    result = call("plans=towers.csv", "out=labels.csv", command="apf.label").must_work()
    (line,) = result.err.splitlines()
    assert "towers.csv" in line
    assert "was w written first?" in line


@pytest.mark.slow
@pytest.mark.parametrize("blocks", [5, 1_000_000], ids=["few blocks", "as many blocks as rows"])
@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_million_rows(tmp_path: Path, ending: str, blocks: int) -> None:
    """They are labelled in a minute and 2 GiB: 200,000 stairs of five cubes, every second one too steep."""
    n, k = 200_000, 5
    block, position = np.arange(n * k) % blocks, np.tile(np.arange(k), n)
    table = pd.DataFrame({"tower": np.repeat(np.arange(n), k), "position": position, "block": block})
    table["block"] = "b" + table["block"].astype(str)
    for column in ("dim_x", "dim_y", "dim_z"):
        table[column] = SIDE
    table[["com_x", "com_y", "com_z", "qx", "qy", "qz"]] = 0.0
    table["mass"] = np.random.default_rng(0).uniform(0.9, 1.1, blocks)[block]
    table["x"] = position * np.where(np.repeat(np.arange(n) % 2, k), 0.06, 0.01)
    table["y"], table["z"], table["qw"] = 0.0, SIDE * (position + 0.5), 1.0
    write(table, tmp_path / f"towers.{ending}")
    measure = (
        "import resource, subprocess, sys, time; start = time.monotonic();"
        "code = subprocess.run([sys.executable, '-m', 'apf.label', *sys.argv[1:]]).returncode;"
        "print(time.monotonic() - start, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, code)"
    )
    result = spawn(["-c", measure, f"plans=towers.{ending}", f"out=labels.{ending}"], cwd=tmp_path).must_work()
    said, measured = result.out.splitlines()
    assert said.endswith("200000 plans labelled, 100000 of them succeed")
    seconds, kibibytes, code = map(float, measured.split())
    assert code == 0
    assert seconds < 60
    assert kibibytes < 2 * 1024**2
    found = read(tmp_path / f"labels.{ending}")
    assert found["label"].iloc[:10].fillna(-1).tolist() == [1, 1, 1, 1, 1, 1, 0, -1, -1, -1]
    assert len(found) == n * k


def many(path: Path, n: int = 200) -> Towers:
    """A file of pairs of random blocks."""
    towers = random_towers(BlockSource().load(), 2, n, np.random.default_rng(0))
    write_towers(towers, path)
    return towers


def test_noise_comes_from_the_seed(here: Path) -> None:
    many(here / "towers.csv")

    def labelled(name: str, *overrides: str) -> list[int | None]:
        arguments = ("plans=towers.csv", f"out={name}.csv", *overrides)
        call(*arguments, command="apf.label").must_work()
        return labels(read(here / f"{name}.csv"))

    still = labelled("still", "world=analytic")
    first = labelled("first", "world=noisy", "world.noise=0.03", "seed=1")
    assert labelled("again", "world=noisy", "world.noise=0.03", "seed=1") == first
    assert labelled("other", "world=noisy", "world.noise=0.03", "seed=2") != first
    assert labelled("none", "world=noisy", "world.noise=0") == still
    assert first != still
    assert still == labelled("default")


def test_an_existing_file_is_replaced(here: Path) -> None:
    write(by_hand(), here / "towers.csv")
    (here / "labels.csv").write_text("old")
    call("plans=towers.csv", "out=labels.csv", command="apf.label").must_work()
    assert labels(read(here / "labels.csv")) == LABELS_BY_HAND


def test_a_folder_for_the_labels_is_made(here: Path) -> None:
    write(by_hand(), here / "towers.csv")
    call("plans=towers.csv", "out=new/folder/labels.csv", command="apf.label").must_work()
    assert labels(read(here / "new" / "folder" / "labels.csv")) == LABELS_BY_HAND


@pytest.mark.slow
def test_in_a_process_of_its_own(tmp_path: Path) -> None:
    write(by_hand(), tmp_path / "towers.csv")
    command = ["-m", "apf.label", "plans=towers.csv", "world=analytic", "out=labels.csv"]
    result = spawn(command, cwd=tmp_path).must_work()
    assert result.err == ""
    assert labels(read(tmp_path / "labels.csv")) == LABELS_BY_HAND


BAD_TOWERS = {
    "NaN": ({"x": "nan"}, ("x", "row 3")),
    "no number": ({"qw": "one"}, ("qw", "one", "row 3")),
    "no position": ({"position": ""}, ("position", "row 3")),
    "no size": ({"dim_z": 0}, ("dim_z",)),
    "negative mass": ({"mass": -1}, ("mass",)),
    "centre of mass outside": ({"com_x": 0.06}, ("com_x", "outside")),
    "floating above": ({"z": 0.17}, ("row 3", "stair", "floats", "z")),
    "floating beside": ({"x": 0.5}, ("row 3", "stair", "floats")),
    "overlapping": ({"z": 0.12}, ("row 3", "stair", "overlaps", "z")),
    "not axis-aligned": ({"qz": 0.3, "qw": 0.954}, ("row 3",)),
    "no rotation": ({"qw": 0}, ("row 3",)),
    "positions from 1": ({"position": 3}, ("stair", "position")),
    "a position twice": ({"position": 0}, ("stair", "position")),
    "a block twice": ({"block": "a"}, ("stair", "a")),
    "no tower": ({"tower": ""}, ("tower", "row 3")),
    "no block": ({"block": ""}, ("block", "row 3")),
}


def refused(here: Path, *overrides: str, words: tuple[str, ...]) -> None:
    """The command is refused with one line, and nothing is left of it."""
    before = sorted(here.iterdir())
    call(*overrides, command="apf.label").must_refuse(*words)
    assert sorted(here.iterdir()) == before, "something was left behind"


@pytest.mark.parametrize("case", BAD_TOWERS)
def test_bad_tower_file(here: Path, case: str) -> None:
    changes, words = BAD_TOWERS[case]
    table = by_hand().iloc[:2].astype(object)
    for column, value in changes.items():
        table.loc[1, column] = value
    write(table, here / "mine.csv")
    refused(here, "plans=mine.csv", "out=labels.csv", words=("mine.csv", *words))


@pytest.mark.parametrize("column", TOWER_COLUMNS)
def test_missing_column(here: Path, column: str) -> None:
    write(by_hand().drop(columns=column), here / "mine.csv")
    refused(here, "plans=mine.csv", "out=labels.csv", words=("mine.csv", f"column {column} is missing"))


def test_one_name_for_two_blocks(here: Path) -> None:
    table = by_hand()
    table.loc[3, "mass"] = 2.0
    write(table, here / "mine.csv")
    refused(here, "plans=mine.csv", "out=labels.csv", words=("mine.csv", "row 5", "block a"))


def test_files_that_are_none(here: Path) -> None:
    write(by_hand(), here / "good.csv")
    write(by_hand().iloc[:0], here / "empty.csv")
    refused(here, "plans=nowhere.csv", "out=labels.csv", words=("nowhere.csv", "no such file"))
    refused(here, "plans=empty.csv", "out=labels.csv", words=("empty.csv", "no towers"))
    refused(here, "plans=good.txt", "out=labels.csv", words=("good.txt", ".csv"))
    refused(here, "plans=good.csv", "out=labels.txt", words=("labels.txt", ".parquet"))
    refused(here, "plans=good.csv", "out=good.csv/labels.csv", words=("good.csv/labels.csv",))
    (here / "folder.csv").mkdir()
    refused(here, "plans=good.csv", "out=folder.csv", words=("folder.csv",))
    assert list((here / "folder.csv").iterdir()) == []


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ((), ("out", "missing")),
        (("out=b.csv",), ("plans", "missing")),
        (("plans=a.csv",), ("out", "missing")),
        (("plans=a.csv", "out=b.csv", "world=nonsense"), ("world", "analytic", "noisy")),
        (("plans=a.csv", "out=b.csv", "world=noisy", "world.noise=-1"), ("world.noise",)),
        (("plans=a.csv", "out=b.csv", "+nonsense=1"), ("nonsense",)),
        (("plans=a.csv", "out=b.csv", "++world.nonsense=1"), ("world.nonsense",)),
        (("plans=a.csv", "out=b.csv", "nonsense=1"), ("nonsense",)),
        (("plans=a.csv", "out=b.csv", "seed=-1"), ("seed",)),
        (("plans=[1,2]", "out=b.csv"), ("plans",)),
    ],
)
def test_bad_options(here: Path, overrides: tuple[str, ...], words: tuple[str, ...]) -> None:
    refused(here, *overrides, words=words)
