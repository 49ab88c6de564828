"""Mutants: which small mistakes are made, what is left alone, and how one is imported and ended."""

import ast
import importlib
import subprocess
import sys
import time

import pytest
import yaml

import apf.errors
from benchmarks.mutants import mutants
from benchmarks.mutations import EQUIVALENT, ROOT, TESTS, Mutated, in_a_fork, main


def changes(source: str) -> list[tuple[str, str]]:
    return [(mutant.before, mutant.after) for mutant in mutants(ast.parse(source))]


@pytest.mark.parametrize(
    ("line", "others"),
    [
        ("x = a < b", {"x = a <= b", "x = a >= b"}),
        ("x = a in b", {"x = a not in b"}),
        ("x = a + b", {"x = a - b"}),
        ("x = a and b", {"x = a or b", "x = a", "x = b"}),
        ("x = not a", {"x = a"}),
        ("x = 0.5", {"x = 1.5", "x = -0.5"}),
        ("x = 0", {"x = 1", "x = -1"}),
        ("x = True", {"x = False"}),
        ("x = 'a'", {"x = 'a?'"}),
        ("x = min(a)", {"x = max(a)"}),
        ("x = a.mean(b)", {"x = a.sum(b)"}),
        ("x = a[b:c]", {"x = a[:c]", "x = a[b:]"}),
        ("x = a[:, b:]", {"x = a[:, :]"}),
        ("x = f(a, b=c)", {"x = f(a)"}),
        ("x = f(a, strict=True)", set()),
        ("os.fsync(file)", {"pass  # os.fsync(file)"}),
        ("a.b = c", {"pass  # a.b = c"}),
        ("a += b", {"pass  # a += b", "a = b"}),
        ("if a: pass", {"if not a:", "if True:", "if False:"}),
        ("x = [a for a in b if c]", {f"x = [a for a in b if {c}]" for c in ("not c", "True", "False")}),
        ("for a in b: pass", {"for a in []:"}),
        ("with a: pass", {"if True:"}),
        ("def f(a): return b", {"return  # return b"}),
        ("raise ValueError('a')", {"pass  # raise ValueError('a')"}),
        ("while a: pass", {"while not a:"}),
        ("'a docstring'", set()),
        ("import a", set()),
        ("__all__ = ['a']", set()),
        ("def f(a: Literal['b'] = c) -> 'd': pass", set()),
        ("x: int | None = a", set()),
        ("x: Annotated[int, Field(ge=c)] = a", {"x: Annotated[int, Field()] = a"}),
    ],
)
def test_what_becomes_of_a_line(line: str, others: set[str]) -> None:
    assert {after for _, after in changes(line)} == others


def test_a_mutant_is_one_change_and_the_tree_is_left_as_it_was() -> None:
    source = "def f(a):\n    a.b()\n    return a[0] < 1\n"
    tree = ast.parse(source)
    found = mutants(tree)
    assert ast.unparse(tree) == source.strip()
    for number in range(len(found)):
        tree = ast.parse(source)
        mutant = mutants(tree)[number]
        mutant.apply()
        changed = [pair for pair in zip(source.splitlines(), ast.unparse(tree).splitlines()) if pair[0] != pair[1]]
        assert len(changed) == 1
        assert changed[0][0].strip() == mutant.before
        assert mutant.after.startswith(changed[0][1].strip())
        compile(tree, "f", "exec")


def test_a_module_is_imported_from_its_changed_tree(monkeypatch: pytest.MonkeyPatch) -> None:
    path = ROOT / "apf" / "errors.py"
    tree = ast.parse(path.read_text() + "\nchanged = 1\n")
    monkeypatch.setattr(apf, "errors", apf.errors)
    monkeypatch.delitem(sys.modules, "apf.errors")
    monkeypatch.setattr(sys, "meta_path", [Mutated(path, tree), *sys.meta_path])
    module = importlib.import_module("apf.errors")
    assert module.changed == 1
    assert module.__file__ == str(path)
    monkeypatch.undo()
    assert sys.modules["apf.errors"] is apf.errors is not module


def test_what_never_ends_is_ended() -> None:
    assert in_a_fork(lambda: 3, 60) == 3
    begun = time.monotonic()
    assert in_a_fork(lambda: time.sleep(60) or 0, 0.2) is None
    assert time.monotonic() - begun < 30


def test_what_crashes_is_no_success() -> None:
    assert in_a_fork(lambda: 1 // 0, 60) not in (0, None)


def test_equivalent_mutants_are_of_files_that_are_tried() -> None:
    assert set(yaml.safe_load(EQUIVALENT.read_text())) <= set(TESTS)


@pytest.mark.slow
def test_the_command_shows_its_table(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["-m", "benchmarks.mutations", "--only", "apf/acquisition/bald.py", "--sample", "5"]
    done = subprocess.run([sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert "apf/acquisition/bald.py  5 " in done.stdout, done.stderr
    with pytest.raises(SystemExit):
        main(["--only", "apf/main.py"])
