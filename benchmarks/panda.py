"""python -m benchmarks.panda [--only ROW ...] [--csv FILE]: what the robot world reaches, against its targets.

Each measurement fills one or more rows of FILE (target, bound, value, holds, command); rows of earlier runs that are
not measured again stay. `experiment` (400 towers, hours) is measured only if it is named.
"""

import argparse
import csv
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np
import pandas as pd
from hydra import compose, initialize_config_dir

from apf.config.values import config_dir
from apf.rng import stream
from apf.rundir.files import read_yaml
from apf.schema import validate
from apf.towers import AnalyticWorld, BlockSet, Offset, Towers, random_extensions, random_towers, standing_prefixes

COLUMNS = ["target", "bound", "value", "holds", "command"]
SEED = 0
LENGTHS = (2, 3, 4, 5)
FEASIBLE, PLACED, COMPARED = 10, 8, 8
"""Towers of each length that are built for the shares and errors."""
SIDE_BY_SIDE = 6
"""Towers that each of two processes builds."""
EXPERIMENT = Path("runs/panda_experiment")
"""Run directory of the long experiment."""


@dataclass(frozen=True)
class Row:
    """One target: what is measured, what it must be, what it is, and whether that is enough."""

    target: str
    bound: str
    value: str
    holds: bool


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.panda", description="Targets of the robot world.")
    parser.add_argument("--only", nargs="+", metavar="ROW", choices=list(MEASUREMENTS), help=", ".join(MEASUREMENTS))
    parser.add_argument("--csv", type=Path, metavar="FILE", default=Path("results/robot/targets.csv"))
    parser.add_argument("--worker", metavar="JSON", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.worker:
        print(json.dumps(work(**json.loads(options.worker))))
        return
    for name in options.only or [name for name in MEASUREMENTS if name != "experiment"]:
        command = f"python -m benchmarks.panda --only {name}"
        for row in MEASUREMENTS[name](options.csv.parent):
            print(f"{row.target}: {row.value} ({row.bound}): {'holds' if row.holds else 'does not hold'}", flush=True)
            keep(row, command, options.csv)


def keep(row: Row, command: str, path: Path) -> None:
    """Put a row into the file, in place of an earlier one of the same target."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = list(csv.DictReader(path.open())) if path.exists() else []
    new = {**row.__dict__, "holds": "yes" if row.holds else "no", "command": command}
    place = next((i for i, old in enumerate(rows) if old["target"] == row.target), len(rows))
    rows[place : place + 1] = [new]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)


# -- what is built ----------------------------------------------------------------------------------------------


def robot(**settings: Any) -> tuple[Any, BlockSet]:
    """The robot world as configured, with other settings, and the blocks that it experiments with."""
    with initialize_config_dir(config_dir(), version_base="1.3"):
        config = validate(compose("config", ["world=panda"]))
    return replace(config.world, **settings), config.domain.training_blocks


def exact(world: Any) -> Any:
    """The world of a robot without flaws: all is where the robot believes it to be, as far as cameras can tell."""
    return replace(world, flaws=type(world.flaws)())


def margins(towers: Towers) -> np.ndarray:
    """[N, K] how far inside its contact patch the worst joint centre of mass of each prefix lies [m]; below 0: outside.

    It follows `apf.towers.stability`, one tower at a time; a single block has no contact patch, and infinity.
    """
    result = np.full(towers.block.shape, np.inf)
    place, half, mass = towers.xy, towers.dims[..., :2] / 2, towers.mass
    centre = place + towers.com[..., :2]
    for n in range(len(towers)):
        for top in range(1, towers.length):
            worst = np.inf
            for i in range(top):
                above = slice(i + 1, top + 1)
                joint = (mass[n, above, None] * centre[n, above]).sum(0) / mass[n, above].sum()
                low = np.maximum(place[n, i] - half[n, i], place[n, i + 1] - half[n, i + 1])
                high = np.minimum(place[n, i] + half[n, i], place[n, i + 1] + half[n, i + 1])
                worst = min(worst, (joint - low).min(), (high - joint).min())
            result[n, top] = worst
    return result


def any_towers(blocks: BlockSet, each: int) -> list[Towers]:
    """Random towers, `each` of 2, 3, 4 and 5 blocks, as a list of single ones in mixed order."""
    singles: list[Towers] = []
    for length in LENGTHS:
        batch = random_towers(blocks, length, each, stream(SEED, "panda plans", length))
        singles += [batch[i : i + 1] for i in range(each)]
    return [singles[i] for i in stream(SEED, "panda order").permutation(len(singles))]


def grown(blocks: BlockSet, length: int, n: int, margin: float) -> list[Towers]:
    """n random towers of which every prefix stands by at least `margin` [m], grown block by block."""
    found: list[Towers] = []
    rng = stream(SEED, "panda grown", length)
    while len(found) < n:
        towers = random_towers(blocks, 1, 500, rng)
        for _ in range(length - 1):
            towers = random_extensions(towers, rng, Offset())
            towers = towers[standing_prefixes(towers)[:, -1]]
            towers = towers[margins(towers)[:, -1] >= margin]
            if not len(towers):
                break
        else:
            found += [towers[i : i + 1] for i in range(len(towers))]
    return found[:n]


def carried_out(world: Any, towers: Sequence[Towers], what: str) -> Iterator[tuple[Towers, np.ndarray, dict]]:
    """Each tower with its labels [K] and the robot's report; every one begins where the one before it ended."""
    report = None
    for number, tower in enumerate(towers):
        began = time.perf_counter()
        outcome = world.attempt(tower, stream(SEED, what, number), report)
        report = outcome.report
        print(
            f"{what} {number + 1} of {len(towers)}: {outcome.labels.tolist()} {report['outcome']}, "
            f"{sum(e['purpose'] == 'intervention' for e in report['entries'])} interventions, "
            f"{time.perf_counter() - began:.1f} s",
            file=sys.stderr,
            flush=True,
        )
        yield tower, outcome.labels, report
    world.close()


# -- measurements -----------------------------------------------------------------------------------------------


def plans(out: Path) -> Iterator[Row]:
    """100 random plans with the default settings."""
    world, blocks = robot()
    reports, labelled, lost, memory = {}, 0, 0, []
    for number, (_, labels, report) in enumerate(carried_out(world, any_towers(blocks, 25), "random plan")):
        reports[number] = report
        labelled += labels[0] != -1
        lost += sum(position[2] < -0.02 for position in report["blocks"].values())
        memory.append(resident())
    table = world.table(reports)
    out.mkdir(parents=True, exist_ok=True)
    table.to_csv(out / "plans.csv", index=False, float_format="%.6g")
    helped = int((table["purpose"] == "intervention").sum())
    done = table[(table["purpose"] != "intervention") & (table["outcome"] == "done")]
    yield Row("100 random plans: labelled", "100", f"{labelled}", labelled == 100)
    yield Row("100 random plans: interventions", "at most 2", f"{helped}", helped <= 2)
    yield Row("100 random plans: blocks lost", "0", f"{lost}", lost == 0)
    median, processor = done["wall"].median(), done["processor"].median()
    value = f"{median:.2f} s, of which {processor:.2f} s on the processor"
    yield Row("one pick-and-place, median wall time", "at most 2.5 s", value, median <= 2.5)
    growth = memory[-1] - memory[19]
    yield Row("memory growth from plan 20 to 100", "at most 20 MiB", f"{growth:.1f} MiB", growth <= 20)


def resident(process: int | str = "self") -> float:
    """Memory that a process holds now [MiB]."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def feasible(out: Path) -> Iterator[Row]:
    """Plans that the analytic rule calls feasible by a wide margin."""
    world, blocks = robot()
    towers = [tower for length in LENGTHS for tower in grown(blocks, length, FEASIBLE, 0.01)]
    built = [bool((labels == 1).all()) for _, labels, _ in carried_out(world, towers, "feasible plan")]
    share = float(np.mean(built))
    name = "plans feasible by the analytic rule with 10 mm margin: built"
    yield Row(name, "at least 95 %", f"{share:.1%} of {len(built)}", share >= 0.95)


def placement(out: Path) -> Iterator[Row]:
    """Where blocks come to lie, for a robot without flaws."""
    world, blocks = robot()
    towers = [tower for length in LENGTHS for tower in grown(blocks, length, PLACED, 0.01)]
    reports, built = {}, 0
    for number, (_, labels, report) in enumerate(carried_out(exact(world), towers, "exact plan")):
        reports[number] = report
        built += bool((labels == 1).all())
    table = world.table(reports)
    errors = table[table["purpose"] == "build"]["error"].dropna().to_numpy() * 1000
    median, most = np.quantile(errors, [0.5, 0.9])
    yield Row("placement error, no flaws: median", "at most 1 mm", f"{median:.2f} mm of {len(errors)}", median <= 1)
    yield Row("placement error, no flaws: 90th percentile", "at most 3 mm", f"{most:.2f} mm", most <= 3)
    share = built / len(reports)
    name = "plans feasible by the analytic rule with 10 mm margin, no flaws: built"
    yield Row(name, "at least 95 %", f"{share:.1%} of {len(reports)}", share >= 0.95)


def sight(out: Path) -> Iterator[Row]:
    """What the cameras tell in rendered scenes: of a calibrated robot, and of one without flaws."""
    from benchmarks.sight import picture, static, wrist

    world, blocks = robot()
    out.mkdir(parents=True, exist_ok=True)
    imageio.imwrite(out / "sight.png", picture(world, blocks))
    both, hand, unbiased = static(world, blocks), wrist(world, blocks), wrist(exact(world), blocks)
    seen, off = _seen(both["off"]), np.nanmedian(both["off"]) * 1000
    number = len(both["off"])
    yield Row("cameras beside the table: blocks seen", "at least 99 %", f"{seen:.1%} of {number}", seen >= 0.99)
    yield Row("cameras beside the table: median error", "at most 4 mm", f"{off:.2f} mm", off <= 4)
    seen, off = _seen(hand["before"]["off"]), np.nanmedian(hand["before"]["off"]) * 1000
    name = "camera on the hand, before a grasp"
    yield Row(f"{name}: seen", "at least 99 %", f"{seen:.1%} of {len(hand['before']['off'])}", seen >= 0.99)
    yield Row(f"{name}: median error", "at most 3 mm", f"{off:.2f} mm", off <= 3)
    off, turned = (np.nanmedian(unbiased["before"][key]) for key in ("off", "turned"))
    value = f"{off * 1000:.2f} mm, {np.rad2deg(turned):.2f} deg"
    holds = off <= 0.0015 and turned <= np.deg2rad(0.5)
    yield Row(f"{name}, no flaws: median error", "at most 1.5 mm, 0.5 deg", value, holds)
    seen, off = _seen(unbiased["held"]["off"]), np.nanmedian(unbiased["held"]["off"]) * 1000
    name = "camera on the hand, a block in it, no flaws"
    yield Row(f"{name}: seen", "at least 90 %", f"{seen:.1%} of {len(unbiased['held']['off'])}", seen >= 0.9)
    yield Row(f"{name}: median error", "at most 1.5 mm", f"{off:.2f} mm", off <= 1.5)


def _seen(errors: np.ndarray) -> float:
    """The share of blocks that were seen: those with an error."""
    return float(np.isfinite(errors).mean())


def agreement(out: Path) -> Iterator[Row]:
    """Labels against the analytic rule, with no flaws and a hand that does not let blocks slip."""
    world, blocks = robot(hold="constraint")
    standing = [tower for length in LENGTHS for tower in grown(blocks, length, COMPARED, 0.0)]
    towers = standing + any_towers(blocks, COMPARED)
    same, judged = 0, 0
    for tower, labels, _ in carried_out(exact(world), towers, "compared plan"):
        rule = AnalyticWorld().execute(tower, stream(SEED, "unused"))[0]
        clear = (np.abs(margins(tower)[0]) > 0.005) & (labels != -1) & (rule != -1)
        same += int((labels == rule)[clear].sum())
        judged += int(clear.sum())
    share = same / judged
    name = "prefix labels as the analytic rule's beyond 5 mm margin, no flaws, constraint grasp"
    yield Row(name, "at least 99 %", f"{share:.1%} of {judged}", share >= 0.99)


def determinism(out: Path) -> Iterator[Row]:
    """The same plans in two processes, whose hashes differ."""
    results = [in_process("labels", 4, hash_seed).communicate()[0] for hash_seed in (1, 2)]
    same = results[0] == results[1]
    yield Row("same seed, two processes", "bit for bit", "identical" if same else "different", same)


def side_by_side(out: Path) -> Iterator[Row]:
    """Two robot worlds in two processes at once, against one after the other."""
    alone = [seconds_of([in_process("seconds", SIDE_BY_SIDE, 1)])[0] for _ in range(2)]
    together = seconds_of([in_process("seconds", SIDE_BY_SIDE, 1) for _ in range(2)])
    ratio = sum(alone) / max(together)
    name = f"two processes on {os.cpu_count()} cores, against one after the other"
    yield Row(name, "at least 1.7 times as fast", f"{ratio:.2f} times", ratio >= 1.7)


def in_process(what: str, towers: int, hash_seed: int) -> subprocess.Popen:
    """Build some random plans in a process of its own."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONHASHSEED": str(hash_seed)}
    arguments = ["-m", "benchmarks.panda", "--worker", json.dumps({"what": what, "towers": towers})]
    root = Path(__file__).parents[1]
    return subprocess.Popen(
        [sys.executable, *arguments], cwd=root, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )


def work(what: str, towers: int) -> Any:
    """What the process answers: labels and where every block ended; or how long the building took [s]."""
    world, blocks = robot()
    began = time.perf_counter()
    outcomes = list(carried_out(world, any_towers(blocks, 25)[:towers], "random plan"))
    if what == "seconds":
        return time.perf_counter() - began
    return [[labels.tolist(), report["outcome"], report["blocks"]] for _, labels, report in outcomes]


def seconds_of(processes: Sequence[subprocess.Popen]) -> list[float]:
    """What processes that all run now answer."""
    return [float(process.communicate()[0]) for process in processes]


def experiment(out: Path) -> Iterator[Row]:
    """The paper's experiment, unattended: 400 towers, in a run directory from which the same command goes on."""
    command = ["-m", "apf.main", "world=panda", "sampler=incremental", "tracker=none", f"hydra.run.dir={EXPERIMENT}"]
    process = subprocess.Popen([sys.executable, *command], env=os.environ | {"OMP_NUM_THREADS": "1"})
    memory = memory_while(process, EXPERIMENT / "journal.jsonl")
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    hours = read_yaml(EXPERIMENT / "run.yaml")["seconds"] / 3600
    table, towers = (pd.read_parquet(EXPERIMENT / f"{name}.parquet") for name in ("world", "plans"))
    helped, built = int((table["purpose"] == "intervention").sum()), int(towers[towers["step"] > 0]["tower"].nunique())
    share = 100 * helped / built
    yield Row("400-tower experiment: wall time", "at most 3 h", f"{hours:.2f} h", hours <= 3)
    name = "400-tower experiment: interventions in 100 towers"
    yield Row(name, "at most 1", f"{share:.2f} ({helped} in {built} built by the robot)", share <= 1)
    size = memory["journal"] / memory["journal"].max()
    early, late = (memory[size.between(*part)]["memory"].median() for part in ((0.25, 0.5), (0.75, 1.0)))
    if np.isfinite(late - early):  # not of a run that went on later than that, or had finished
        name = "400-tower experiment: median memory in its last quarter, against its second"
        yield Row(name, "at most 20 MiB more", f"{late - early:+.1f} MiB of {late:.0f} MiB", late - early <= 20)


def memory_while(process: subprocess.Popen, journal: Path) -> pd.DataFrame:
    """Resident memory [MiB] and the journal's size [bytes], every five seconds until the process ends."""
    samples = []
    while True:
        try:
            process.wait(timeout=5)
            return pd.DataFrame(samples, columns=["memory", "journal"])
        except subprocess.TimeoutExpired:
            if journal.exists():
                samples.append((resident(process.pid), journal.stat().st_size))


MEASUREMENTS: dict[str, Callable[[Path], Iterator[Row]]] = {
    "sight": sight,
    "plans": plans,
    "feasible": feasible,
    "placement": placement,
    "agreement": agreement,
    "determinism": determinism,
    "side_by_side": side_by_side,
    "experiment": experiment,
}


if __name__ == "__main__":
    main()
