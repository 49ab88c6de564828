"""The rooms of the package: who may know whom, and that no domain is known outside its own folder."""

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "apf"
FLOORS = (
    ("evaluate",),
    ("main", "dashboard", "label", "relabel", "plan", "predict", "panda", "api"),
    ("commands",),
    ("trained",),
    ("launch",),
    ("schema",),
    ("experiment",),
    ("report", "tracking"),
    ("towers", "packing"),
    ("acquisition", "models", "planning"),
    ("rundir",),
    ("config",),
    ("domain",),
    ("errors", "interrupts", "rng", "settings", "source", "terminal"),
)
"""Rooms and files of the package, from the top down: each imports from floors below its own alone."""
DOMAINS = ("towers", "panda", "packing")
WORDS = re.compile(
    r"tower|(?<![a-z])blocks?(?![a-z]|_size)|(?<![a-z])heights?(?![a-z])|packing|BoxSet|boxes", re.IGNORECASE
)
"""What a domain is about."""
FILES = sorted(PACKAGE.rglob("*.py"))


def room(path: Path) -> str:
    """A folder of the package, or a file that lies in none."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def imported(path: Path) -> set[str]:
    """The rooms that a file imports from."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        found |= {name.split(".")[1] for name in names if name.startswith("apf.")}
    return found - {room(path), "__version__"}


def floor(name: str) -> int:
    return next(number for number, rooms in enumerate(FLOORS) if name in rooms)


def test_every_room_has_its_floor() -> None:
    assert {room(path) for path in FILES} - {"__init__"} <= {name for rooms in FLOORS for name in rooms}


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_arrows_run_down(path: Path) -> None:
    here = room(path)
    if here == "__init__":
        return
    up = {other for other in imported(path) if floor(other) <= floor(here)}
    assert not up, f"{path} imports from {up}"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_circle_within_a_room(path: Path) -> None:
    """No file imports a file that imports it, however far the way is."""
    seen, ahead = set(), [path]
    while ahead:
        for other in files_imported(ahead.pop()):
            assert other != path or path.name == "__init__.py", f"{path} imports itself by way of others"
            if other not in seen and other.name != "__init__.py":
                seen.add(other)
                ahead.append(other)


def files_imported(path: Path) -> set[Path]:
    """The files of the package that a file imports from by their own names, wherever in it the import stands."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("apf."):
            inside = PACKAGE.joinpath(*node.module.split(".")[1:])
            candidates = [inside.with_suffix(".py"), *(inside / f"{alias.name}.py" for alias in node.names)]
            found |= {file for file in candidates if file.is_file()}
    return found


@pytest.mark.parametrize(
    "path",
    [path for path in FILES if room(path) not in DOMAINS],
    ids=lambda path: str(path.relative_to(PACKAGE)),
)
def test_no_domain_is_named_outside_its_folder(path: Path) -> None:
    """Neither in names nor in words."""
    before, named = "", []
    for token in tokenize.generate_tokens(io.StringIO(path.read_text()).readline):
        word = token.type in (tokenize.NAME, tokenize.STRING, tokenize.COMMENT) and WORDS.search(token.string)
        if word and (before, token.string) != (".", "height"):  # of a terminal
            named.append(f"line {token.start[0]}: {token.string[:60]}")
        before = token.string
    assert not named, named
