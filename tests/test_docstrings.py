"""What public functions say of their arguments."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
FILES = sorted(path for room in ("apf", "analysis", "hydra_plugins") for path in (REPOSITORY / room).rglob("*.py"))
OVERRIDE = re.compile(r"As `\w+\.\w+`")
"""How the docstring of an override begins, whose base explains the arguments: As `Base.method`."""


def public_functions(node: ast.AST) -> Iterator[ast.FunctionDef]:
    """Functions and methods whose names have no underscore, none that stand in a function."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ClassDef):
            yield from public_functions(child)
        elif isinstance(child, ast.FunctionDef) and not child.name.startswith("_"):
            yield child


def arguments(function: ast.FunctionDef) -> list[str]:
    spec = function.args
    names = [argument.arg for argument in [*spec.posonlyargs, *spec.args, *spec.kwonlyargs]]
    return [name for name in names if name not in ("self", "cls")]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(REPOSITORY)))
def test_more_than_two_arguments_are_explained(path: Path) -> None:
    """Each in a line of `Args:`, unless the function is an override `As` the method it names."""
    for function in public_functions(ast.parse(path.read_text())):
        said, names = ast.get_docstring(function) or "", arguments(function)
        if len(names) < 3 or OVERRIDE.match(said):
            continue
        lines = said.partition("Args:\n")[2].partition("\n\n")[0].splitlines()
        explained = {line.strip().partition(":")[0] for line in lines}
        assert set(names) <= explained, f"{path.name}: {function.name}: {set(names) - explained}"
