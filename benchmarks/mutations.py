"""python -m benchmarks.mutations [--sample N] [--seed S] [--only FILE ...]: do the quick tests notice small mistakes?

Each mutant of a source file is one small change of it. The quick tests that concern the file run against each, in a
process that is forked with the libraries imported, and stop at the first failure. Mutants that change nothing that
anyone could see are listed with the reason in equivalent_mutants.yaml, and do not count. Prints those that no test
noticed, and a table; the exit code says if enough were noticed in every part.
"""

import argparse
import ast
import importlib.abc
import importlib.machinery
import importlib.util
import math
import os
import random
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import CodeType, ModuleType

import yaml
from rich.console import Console
from rich.table import Table

from benchmarks.mutants import mutants

ROOT = Path(__file__).parents[1]
EQUIVALENT = Path(__file__).with_name("equivalent_mutants.yaml")
ENOUGH = 0.95
"""Share of the mutants of a part that the quick tests shall notice."""
PATIENCE = 10
"""How many times as long as the tests take a mutant may take; one that takes longer is noticed: it never ends."""
LEAST = 60.0
"""Seconds that any mutant may take: other work may hold the processor."""
MEMORY, DISK = 16 << 30, 1 << 30
"""Bytes that a mutant may map, and may write to one file."""
TESTS = {
    "apf/acquisition/bald.py": ("test_bald", "test_samplers"),
    "apf/acquisition/candidates.py": ("test_samplers",),
    "apf/acquisition/sampler.py": ("test_samplers",),
    "apf/acquisition/scores.py": ("test_scores", "test_samplers"),
    "apf/planning/evaluation.py": ("test_evaluation",),
    "apf/planning/monte_carlo.py": ("test_planner", "test_evaluation"),
    "apf/planning/search.py": ("test_search", "test_evaluation"),
    "apf/towers/predictors.py": ("test_predictors",),
    "apf/towers/stability.py": ("test_stability",),
    "apf/models/training.py": ("test_training",),
    "apf/rundir/store.py": ("test_store",),
    "apf/rundir/journal.py": ("test_journal", "test_records", "test_durability", "test_store"),
    "apf/rundir/files.py": ("test_durability", "test_records", "test_tower_files", "test_store"),
}
"""The quick tests that concern each source file, those that most likely notice first."""


@dataclass
class Part:
    """What became of the mutants of one source file."""

    path: str
    tried: int = 0
    noticed: int = 0
    equivalent: int = 0
    survived: int = 0

    @property
    def share(self) -> float:
        """Of those that change something, how many were noticed."""
        return self.noticed / max(1, self.tried - self.equivalent)


class Mutated(importlib.abc.MetaPathFinder, importlib.machinery.SourceFileLoader):
    """Imports one module from a syntax tree instead of its file."""

    def __init__(self, path: Path, tree: ast.Module) -> None:
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        super().__init__(name, str(path))
        self.tree = tree

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Of that module alone."""
        if fullname != self.name:
            return None
        return importlib.util.spec_from_file_location(fullname, self.path, loader=self)

    def get_code(self, fullname: str) -> CodeType:
        """Compiled afresh."""
        return compile(self.tree, self.path, "exec")


def import_libraries() -> None:
    """All that the package and its tests import from elsewhere, which takes long and is the same for all mutants."""
    for name in ("apf.main", "hypothesis", "hypothesis.extra.numpy", "pytest"):
        importlib.import_module(name)
    importlib.import_module("torch").set_num_threads(1)
    for name in [name for name in sys.modules if name.split(".")[0] == "apf"]:
        del sys.modules[name]


def in_a_fork(do: Callable[[], int], limit: float) -> int | None:
    """The exit code of `do`, run in a forked process; None if it does not end within so many seconds."""
    child = os.fork()
    if not child:
        code = 70
        try:
            os.setsid()
            cpu = math.ceil(limit)  # which ends it, too, if this process is no more
            for kind, most in ((resource.RLIMIT_AS, MEMORY), (resource.RLIMIT_FSIZE, DISK), (resource.RLIMIT_CPU, cpu)):
                resource.setrlimit(kind, (most, most))
            code = do()
        finally:
            os._exit(code)
    end = time.monotonic() + limit
    while time.monotonic() < end:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


def run_tests(tests: Sequence[Path], finder: Mutated | None, log: Path) -> int:
    """Exit code of pytest for these files, the module imported as the finder has it."""
    import pytest

    with log.open("w") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    if finder:
        sys.meta_path.insert(0, finder)
    os.chdir(ROOT)
    options = ["-x", "-q", "-m", "not slow and not robot", "-p", "no:cacheprovider", "--tb=line"]
    with tempfile.TemporaryDirectory() as folder:
        code = int(pytest.main([*options, f"--basetemp={folder}/t", *map(str, tests)]))
        sys.stdout.flush()
    return code


def try_mutants(
    path: Path,
    tests: Sequence[Path],
    chosen: Callable[[int], Sequence[int]],
    known: Mapping[tuple[str, str], str],
    on_result: Callable[[str], None],
) -> Part:
    """Run the tests against mutants of a file. chosen: which of so many. known: see `equivalents`.

    Raises RuntimeError if the tests fail without any change.
    """
    part = Part(str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else str(path))
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        begun = time.monotonic()
        if in_a_fork(lambda: run_tests(tests, None, log), 600) != 0:
            raise RuntimeError(f"the tests of {part.path} fail as it is\n{log.read_text()}")
        limit = max(LEAST, PATIENCE * (time.monotonic() - begun))
        source = path.read_text()
        for number in chosen(len(mutants(ast.parse(source)))):
            tree = ast.parse(source)
            mutant = mutants(tree)[number]
            mutant.apply()
            code = in_a_fork(lambda tree=tree: run_tests(tests, Mutated(path, tree), log), limit)  # type: ignore[misc]
            part.tried += 1
            if code != 0:
                part.noticed += 1
                continue
            change = f"{part.path}:{mutant.line}\n  - - {mutant.before}\n    - {mutant.after}"
            if why := known.get((mutant.before, mutant.after)):
                part.equivalent += 1
                on_result(f"{change}\n  equivalent: {why}")
            else:
                part.survived += 1
                on_result(change)
    return part


def equivalents(path: str) -> dict[tuple[str, str], str]:
    """Why mutants of the file, each by its line before and after, change nothing, as far as that is known."""
    known = yaml.safe_load(EQUIVALENT.read_text()).get(path, {})
    return {(before, after): why for why, lines in known.items() for before, after in lines}


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutations", description="Do the tests notice?")
    parser.add_argument("--sample", type=int, metavar="N", help="so many mutants of each file (default: all)")
    parser.add_argument("--seed", type=int, default=0, help="which ones (0)")
    parser.add_argument("--only", nargs="+", metavar="FILE", choices=list(TESTS), help="some of the files")
    options = parser.parse_args(arguments)
    import_libraries()
    console = Console(highlight=False, soft_wrap=True)
    table = Table("file", "mutants", "equivalent", "noticed", "survived", "share", box=None, pad_edge=False)
    show = partial(console.print, markup=False)
    parts = []
    for path in options.only or TESTS:
        tests = [ROOT / "tests" / f"{name}.py" for name in TESTS[path]]

        def chosen(n: int) -> Sequence[int]:
            few = n if options.sample is None else min(n, options.sample)
            return sorted(random.Random(options.seed).sample(range(n), few))

        known = equivalents(path)
        there = {(mutant.before, mutant.after) for mutant in mutants(ast.parse((ROOT / path).read_text()))}
        for before, after in known.keys() - there:
            console.print(f"{EQUIVALENT.name}, {path}: no such mutant any more: {before} -> {after}", markup=False)
        part = try_mutants(ROOT / path, tests, chosen, known, show)
        parts.append(part)
        counts = part.tried, part.equivalent, part.noticed, part.survived
        table.add_row(part.path, *map(str, counts), f"{part.share:.1%}")
    console.print(table)
    sys.exit(0 if all(part.share >= ENOUGH for part in parts) else 1)


if __name__ == "__main__":
    main()
