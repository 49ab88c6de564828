"""What breaks runs: faults injected into a tiny run, each of which is then resumed and compared.

Its tables and weights must be, bit for bit, those of a run that was never stopped. Seeds are fixed.
"""

import json
import os
import random
import resource
import shutil
import signal
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import apf.commands.run
from apf.errors import InputError
from apf.rundir.journal import parse
from apf.rundir.store import Store
from apf.towers import NoisyWorld, TowerDomain
from benchmarks.forks import PHASES, Run

TINY = (
    *("tracker=none", "device=cpu", "plans=12", "initial.train=4", "initial.validation=4"),
    *("acquisition.plans=2", "acquisition.validation=1", "training.updates=3"),
    *("model.members=2", "model.network.hidden=8", "sampler.candidates.n=50", "planner.candidates=64"),
    *("evaluation.every=1", "evaluation.problems=1", "evaluation.length=2"),
    *("evaluation.lengths=[2]", "evaluation.test_plans=4"),
)
START = (*TINY, "hydra.run.dir=run")
RESUME = ("resume=run",)
KEPT = ("plans.parquet", "regret.parquet", "accuracy.parquet", "evaluation_plans.parquet")


@dataclass
class Report:
    """What was injected, and what came of it."""

    faults: Counter[str] = field(default_factory=Counter)
    phases: Counter[str] = field(default_factory=Counter)
    resumed: int = 0
    refused: int = 0
    """Stopped with one clear line where going on would have been wrong."""
    labels_lost: int = 0
    tables_differing: int = 0
    unclear: list[str] = field(default_factory=list)
    """What ended in a traceback, or otherwise than it should."""

    @property
    def good(self) -> bool:
        """Is all as it should be?"""
        return not (self.labels_lost or self.tables_differing or self.unclear)


class Suite:
    """Injects faults, one after the other, in folders below `root`."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.report = Report()
        self._folders = 0
        self.reference = self.folder()
        begun = Run(START, self.reference)
        if begun.wait() != 0:
            raise RuntimeError(f"a run without any fault fails: {begun.said}")
        self.timeline = begun.phases
        self.seconds = begun.heard[-1][0]
        self.expected = contents(self.reference / "run")
        self.other = self.folder()
        if Run((*START, "seed=1"), self.other).wait() != 0:
            raise RuntimeError("a run of another seed fails")

    def folder(self) -> Path:
        """A new empty folder."""
        self._folders += 1
        folder = self.root / f"{self._folders:04d}"
        folder.mkdir(parents=True)
        return folder

    # -- what every fault ends with ------------------------------------------------------------------------------

    def resume(self, fault: str, folder: Path, acknowledged: int) -> None:
        """Go on, and compare. acknowledged: labels that the run said were on the disk."""
        self.report.faults[fault] += 1
        before = labels(folder / "run")
        self.report.labels_lost += max(0, acknowledged - len(before))
        # what was killed before it had a directory of its own is started again
        again = Run(RESUME if (folder / "run" / "run.yaml").exists() else START, folder)
        if again.wait() != 0:
            self.report.unclear.append(f"{fault}: {again.said.strip()[-500:]}")
            return
        self.report.resumed += 1
        after = labels(folder / "run")
        self.report.labels_lost += sum(after.get(tower) != label for tower, label in before.items())
        self.compare(fault, folder)
        shutil.rmtree(folder)

    def compare(self, fault: str, folder: Path) -> None:
        """Count the tables and weights that are not those of the run that was never stopped."""
        found = contents(folder / "run")
        differing = [name for name in self.expected | found if self.expected.get(name) != found.get(name)]
        self.report.tables_differing += len(differing)
        if differing:
            self.report.unclear.append(f"{fault}: differing: {', '.join(differing)}")

    def stopped(self, fault: str, run: Run, *words: str) -> None:
        """The run must have ended by itself, with one line that holds the words, and no traceback."""
        last = run.said.strip().splitlines()[-1]
        if run.code == 0 or "Traceback" in run.said or not all(word in last for word in ("error: ", *words)):
            self.report.unclear.append(f"{fault}: exit code {run.code}: {run.said.strip()[-500:]}")

    # -- faults --------------------------------------------------------------------------------------------------

    def kills(self, n: int, seed: int = 0) -> Iterator[str]:
        """SIGKILL, n times: a random phase of those that the run goes through, and a random instant in it."""
        rng = random.Random(seed)
        ends = [at for at, _ in self.timeline[1:]] + [self.seconds + 0.3]
        for number in range(n):
            phase = PHASES[number % len(PHASES)]
            places = [i for i, (_, what) in enumerate(self.timeline) if what == phase]
            place = rng.choice(places)
            delay = rng.uniform(0, ends[place] - self.timeline[place][0])
            folder = self.folder()
            run = Run(START, folder)
            while len(run.phases) <= place and run.listen(0.001):
                pass
            run.listen(delay)
            hit = run.phases[-1][1]
            if run.kill() == -signal.SIGKILL:
                self.report.phases[hit] += 1
            self.resume("SIGKILL", folder, run.labels)
            yield f"kill {number + 1} of {n}, {hit}"

    def terminations(self, n: int, seed: int = 1) -> Iterator[str]:
        """SIGTERM and SIGINT at random instants: ends within seconds and says how to go on."""
        rng = random.Random(seed)
        for number in range(n):
            fault = ("SIGTERM", "SIGINT")[number % 2]
            folder = self.folder()
            run = Run(START, folder)
            run.listen(rng.uniform(self.timeline[1][0], self.seconds))
            begun = time.monotonic()
            code = run.kill(getattr(signal, fault))
            took = time.monotonic() - begun
            expected = 128 + getattr(signal, fault)
            told = run.said.strip().splitlines()[-1]
            begun_at_all = (folder / "run" / "config.yaml").exists()
            silent = begun_at_all and "resume=" not in told
            if code not in (0, expected) or took > 5 or (code and silent):
                self.report.unclear.append(f"{fault}: exit code {code} after {took:.1f} s: {told}")
            self.resume(fault, folder, run.labels)
            yield f"{fault} {number + 1} of {n}"

    def torn(self, whole: int) -> Iterator[str]:
        """The last record cut short, or garbled, at every byte; `whole` of them resumed to the end, all reopened.

        Then what no crash does: damage elsewhere, lines that are doubled, missing, swapped, or another run's.
        """
        folder = self.folder()
        shutil.copytree(self.reference / "run", folder / "run")
        run, domain = folder / "run", TowerDomain()
        reopen(run)
        identifier = yaml.safe_load((run / "run.yaml").read_text())["id"]
        lines = (run / "journal.jsonl").read_bytes().splitlines(keepends=True)
        last = max(n for n, line in enumerate(lines) if b'"label"' in line[:20])
        base, record = b"".join(lines[:last]), lines[last]
        known = parse(base, run, identifier).records
        cases = [("torn", record[:n]) for n in range(1, len(record) - 1)]
        for n, byte in enumerate(record):
            cases += [("garbled", record[:n] + bytes([byte ^ flip]) + record[n + 1 :]) for flip in (1, 255)]
        step = max(1, len(cases) // max(1, whole))
        for number, (fault, tail) in enumerate(cases):
            (run / "journal.jsonl").write_bytes(base + tail)
            store = Store(run, domain)
            if store.journal.records != known or (run / "journal.jsonl").read_bytes() != base:
                self.report.unclear.append(f"{fault} record, byte {number}: not cut off")
            if store.journal.torn is None or store.journal.torn.read_bytes() != tail:
                self.report.unclear.append(f"{fault} record, byte {number}: not kept aside")
            store.close()
            (run / "journal.torn-1.jsonl").unlink(missing_ok=True)
            self.report.faults[f"{fault} record"] += 1
            if number % step == 0 and number // step < whole:
                copy = self.folder()
                shutil.copytree(run, copy / "run")
                self.resume(f"{fault} record, resumed", copy, len(labels(run)))
            yield f"torn record {number + 1} of {len(cases)}"
        for n in range(0, len(base), max(1, len(base) // 200)):  # before the last record: no crash does that
            garbled = base[:n] + bytes([base[n] ^ 1]) + base[n + 1 :] + record
            self.refused("damage elsewhere", run, garbled, domain)
            yield f"damage at byte {n}"
        other = (self.other / "run" / "journal.jsonl").read_bytes().splitlines(keepends=True)
        for n in range(1, last):
            for fault, wrong in (
                ("line doubled", [*lines[: n + 1], *lines[n:]]),
                ("line missing", [*lines[:n], *lines[n + 1 :]]),
                ("lines swapped", [*lines[:n], lines[n + 1], lines[n], *lines[n + 2 :]]),
                ("line of another run", [*lines[:n], other[n], *lines[n + 1 :]]),
                ("lines of another run", [*lines[:n], *other[n:]]),
                ("two lines damaged", [*lines[:n], *(b"x" + line for line in lines[n : n + 2])]),
            ):
                self.refused(fault, run, b"".join(wrong), domain)
                yield f"{fault}, {n + 1}"
        self.refused("line ends of Windows", run, b"".join(lines).replace(b"\n", b"\r\n"), domain)
        self.refused("journal of another run", run, b"".join(other), domain)

    def refused(self, fault: str, run: Path, journal: bytes, domain: TowerDomain) -> None:
        """The run must not go on with that journal, which must stay as it is."""
        self.report.faults[fault] += 1
        (run / "journal.jsonl").write_bytes(journal)
        try:
            Store(run, domain).close()
            self.report.unclear.append(f"{fault}: not noticed")
        except InputError:
            self.report.refused += 1
        if (run / "journal.jsonl").read_bytes() != journal or (run / "journal.torn-1.jsonl").exists():
            self.report.unclear.append(f"{fault}: the journal was changed")

    def files(self) -> Iterator[str]:
        """Weights and tables of a finished run missing or garbled; the files of a run that goes on, too."""
        names = sorted(self.expected)
        for name in names:
            for fault in ("missing", "garbled"):
                folder = self.folder()
                shutil.copytree(self.reference / "run", folder / "run")
                path = folder / "run" / name
                if fault == "missing":
                    path.unlink()
                else:
                    path.write_bytes(path.read_bytes()[:-9] + b"\xff" * 9)
                self.resume(f"{fault} file", folder, 12)
                yield f"{fault} {name}"

    def full_disk(self, n: int) -> Iterator[str]:
        """No file may grow beyond a limit, as a quota has it: another limit each time."""
        size = (self.reference / "run" / "journal.jsonl").stat().st_size
        for number in range(n):
            limit = round(size * (number + 0.5) / n)
            folder = self.folder()
            run = Run(START, folder, lambda limit=limit: plant_limit(limit))
            run.wait()
            self.stopped("full disk", run, "cannot be written") if run.code else None
            self.resume("full disk", folder, run.labels)
            yield f"full disk, {limit} bytes"

    def small_disk(self, n: int) -> Iterator[str]:
        """A file system that has no room for the run, each time less of it, and is then read-only: a tmpfs.

        Nothing happens where this process may not mount one.
        """
        size = sum(1 + path.stat().st_size // 4096 for path in (self.reference / "run").rglob("*"))  # in pages
        for number in range(n):
            pages = round(size * (number + 0.5) / n)
            folder, disk = self.folder(), self.folder()
            if not mount("-t", "tmpfs", "-o", f"size={4 * pages}k", "tmpfs", disk):
                yield "no small disk: mounting is not permitted"
                return
            try:
                run = Run(START, disk)
                run.wait()
                self.stopped("small disk", run, "No space left on device") if run.code else None
                known = run.labels
                if (disk / "run" / "run.yaml").exists() and run.code:
                    mount("-o", "remount,ro", disk)
                    run = Run(RESUME, disk)
                    run.wait()
                    self.stopped("read-only disk", run, "Read-only file system")
                    self.report.faults["read-only disk"] += 1
                    self.report.refused += 1
                if (disk / "run").exists():
                    shutil.copytree(disk / "run", folder / "run")
            finally:
                subprocess.run(["umount", disk], check=True)
            self.resume("small disk", folder, known)
            yield f"small disk, {pages} pages"

    def worlds(self, towers: Sequence[int] = (2, 9)) -> Iterator[str]:
        """A world that raises, hangs, dies, or answers nonsense, in one of those towers."""
        for number in towers:
            for fault, fail, words in WORLDS:
                folder = self.folder()
                run = Run((*START, "execution.time_limit=0.5"), folder, lambda f=fail, n=number: plant_world(f, n))
                run.wait()
                if words:
                    self.stopped(fault, run, *words, f"plan {number}", "resume=")
                elif run.code == 0:
                    self.report.unclear.append(f"{fault}: ended well")
                self.resume(fault, folder, run.labels)
                yield fault

    def concurrent(self, n: int) -> Iterator[str]:
        """Two starts in one directory: one works, the other says so."""
        for number in range(n):
            folder = self.folder()
            first, second = Run(START, folder), Run(START, folder)
            codes = sorted([first.wait(), second.wait()])
            loser = first if first.code else second
            if codes == [0, 1]:
                self.stopped("two at once", loser, "works in it")
                self.report.refused += 1
            elif codes != [0, 0]:
                self.report.unclear.append(f"two at once: exit codes {codes}")
            self.resume("two at once", folder, 12)
            yield f"two at once {number + 1} of {n}"


def hang() -> None:
    """What the time limit is for."""
    time.sleep(60)


def hang_natively() -> None:
    """What no Python signal reaches."""
    sum(range(10**12))


def throw() -> None:
    """A robot that lost its gripper."""
    raise RuntimeError("the gripper is lost")


WORLDS: tuple[tuple[str, Callable[[], object], tuple[str, ...]], ...] = (
    ("world raises", throw, ("RuntimeError: the gripper is lost",)),
    ("world hangs", hang, ("execution.time_limit=0.5",)),
    ("world hangs in native code", hang_natively, ()),
    ("world answers nonsense", lambda: np.array([[0, 1]]), ("got [0, 1]",)),
    ("world exits", lambda: os._exit(3), ()),
    ("world dies of a segmentation fault", lambda: os.kill(os.getpid(), signal.SIGSEGV), ()),
)


def mount(*arguments: str | Path) -> bool:
    """Mount a file system, or mount it otherwise. Returns whether that was permitted."""
    return subprocess.run(["mount", *arguments], stderr=subprocess.DEVNULL, check=False).returncode == 0


def plant_limit(size: int) -> None:
    """From its beginning on, the run can write no file larger than that, as if the disk were full."""
    begin = apf.commands.run.begin

    def limited(*args: Any) -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
        begin(*args)

    apf.commands.run.begin = limited


def plant_world(fail: Callable[[], object], number: int) -> None:
    """Make the noisy world fail when it builds that tower."""
    execute, calls = NoisyWorld.execute, iter(range(1000))

    def failing(*args: object) -> object:
        return fail() if next(calls) == number else execute(*args)

    NoisyWorld.execute = failing


def contents(run: Path) -> dict[str, bytes]:
    """Tables and weights of a run directory, by name."""
    paths = [run / name for name in KEPT] + sorted(run.glob("weights/*.safetensors"))
    return {str(path.relative_to(run)): path.read_bytes() for path in paths if path.exists()}


def labels(run: Path) -> dict[int, str]:
    """The labels that the journal holds whole, by tower."""
    path = run / "journal.jsonl"
    found = {}
    for line in path.read_bytes().splitlines() if path.exists() else []:
        try:
            record = json.loads(line)
        except ValueError:
            continue
        if record["kind"] == "label":
            found[record["plan"]] = record["labels"]
    return found


def reopen(run: Path) -> None:
    """Take back that the run has finished, and how far its journal went."""
    state = yaml.safe_load((run / "run.yaml").read_text()) | {"finished": False}
    del state["journal"]
    (run / "run.yaml").write_text(yaml.safe_dump(state))
