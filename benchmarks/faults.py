"""python -m benchmarks.faults [--kills N]: what breaks runs, and whether they end as if nothing had happened.

Prints counts; the exit code says if all is well.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np
from rich.console import Console
from rich.table import Table

from apf.domain import Scored
from apf.rundir.store import Store
from apf.towers import BlockSource, TowerDomain
from benchmarks.forks import Run
from benchmarks.injections import RESUME, TINY, Suite


def label_cost(root: Path, n: int = 400) -> float:
    """Seconds to make one label durable: the median of n."""
    directory = root / "cost"
    directory.mkdir()
    domain = TowerDomain(training=BlockSource(), evaluation=BlockSource(seed=1))
    rng = np.random.default_rng(0)
    store = Store(directory, domain)
    store.plan(0, [Scored(domain.random_plans(5, 1, rng), 0.5) for _ in range(n)], ["train"] * n)
    times = []
    for number in range(n):
        begun = time.perf_counter()
        store.record(number, np.array([1, 1, 1, 0, -1]))
        times.append(time.perf_counter() - begun)
    store.close()
    return median(times)


def resume_overhead(root: Path) -> tuple[float, float]:
    """Seconds until a run of 400 labelled towers goes on: of the command, and of all but its imports (medians of 3)."""
    folder = root / "overhead"
    folder.mkdir()
    arguments = (*TINY, "plans=410", "initial.train=320", "initial.validation=80", "hydra.run.dir=run")
    run = Run(arguments, folder)
    while run.phases[-1][1] != "training" and run.listen(0.01):
        pass
    run.kill()
    rest = []
    for _ in range(3):
        again = Run(RESUME, folder)
        while again.phases[-1][1] != "training" and again.listen(0.001):
            pass
        rest.append(again.phases[-1][0])
        again.kill()
    totals = []
    for _ in range(3):
        begun = time.monotonic()
        command = [sys.executable, "-m", "apf.main", f"resume={folder / 'run'}"]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
            assert process.stderr is not None
            next(line for line in process.stderr if line.startswith("going on"))
            totals.append(time.monotonic() - begun)
            process.kill()
    return median(totals), median(rest)


def main() -> None:
    """Entry point of the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.faults", description="Injects faults into runs.")
    parser.add_argument("--kills", type=int, default=200, help="how many SIGKILLs, at random instants (200)")
    options = parser.parse_args()
    console, progress = Console(highlight=False), Console(stderr=True, highlight=False)
    with tempfile.TemporaryDirectory() as folder:
        suite = Suite(Path(folder) / "runs")
        injections = (
            suite.kills(options.kills),
            suite.terminations(20),
            suite.torn(12),
            suite.files(),
            suite.full_disk(12),
            suite.small_disk(12),
            suite.worlds(),
            suite.concurrent(5),
        )
        with progress.status("") as status:
            for injection in injections:
                for what in injection:
                    status.update(what)
        cost = label_cost(Path(folder))
        total, rest = resume_overhead(Path(folder))
    report = suite.report
    for title, counts in (("fault", report.faults), ("SIGKILL while", report.phases)):
        table = Table(title, "times", box=None, pad_edge=False)
        for name, times in counts.items():
            table.add_row(name, str(times))
        console.print(table, "")
    console.print(f"faults injected   {report.faults.total()}")
    console.print(f"runs resumed      {report.resumed}")
    console.print(f"refused, clearly  {report.refused}")
    console.print(f"labels lost       {report.labels_lost}")
    console.print(f"tables differing  {report.tables_differing}")
    console.print(f"journal cost      {1000 * cost:.2f} ms per label (median; target < 5 ms)")
    console.print(f"resume overhead   {total:.1f} s from the command until it goes on, at 400 towers (target < 5 s)")
    console.print(f"                  {rest:.2f} s of a process that has imported everything")
    for line in report.unclear:
        console.print(line, markup=False)
    sys.exit(0 if report.good else 1)


if __name__ == "__main__":
    main()
