"""What is timed: each operation with its reference, its limit and its target.

Every function here makes a `Case` for a setting. It first checks that the reference computes the same, and raises
AssertionError if it does not.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from apf.planning import Planner, Problem
from apf.rng import stream
from apf.towers import AnalyticWorld, Towers
from benchmarks import reference as plain
from benchmarks import reference_learning as plain_learning
from benchmarks.learning import acquisition, epoch, plain_members
from benchmarks.limits import memory_pass, products_with_weights, replay
from benchmarks.setting import SEED, Setting
from benchmarks.timing import Case, Target, Timed

SEARCH_RIVAL, SEARCH_PROBLEMS = 10, 5
"""The search is compared with Monte Carlo of so many times the candidates of one plan, on so many problems."""

MEMORY = "limit: memory bandwidth, each array read or written once"


def towers(setting: Setting) -> Case:
    """Drawing random towers of 5 blocks."""
    n, fraction = setting.sizes.towers, setting.sizes.towers_reference
    domain, blocks = setting.default.domain, plain.block_list(setting.default.domain.training_blocks)
    check_towers(setting, 200)
    seconds_of_copy, scale = memory_pass(array_bytes(setting.random_towers("towers", n)))

    def reference() -> None:
        rng = stream(SEED, "towers")
        for _ in range(fraction):
            plain.random_tower(blocks, 5, rng, domain.offset.sd, domain.offset.limit)

    return Case(
        "random 5-block towers",
        unit="towers",
        amount=n,
        ours=Timed(lambda: setting.random_towers("towers", n)),
        reference=[Timed(reference, n / fraction)],
        limit=[Timed(seconds_of_copy, scale)],
        target=Target(ratio=100, rate=150_000),
        note=f"{n:,} at once; reference on {fraction}, scaled; {MEMORY}",
        repetitions=setting.sizes.repetitions,
    )


def check_towers(setting: Setting, n: int) -> None:
    """The same draws give the same tower, and both draw from the same distribution."""
    domain = setting.default.domain
    ours = setting.random_towers("check towers", 4000)
    blocks = plain.block_list(domain.training_blocks)
    reach = (ours.dims[:, 1:, :2] + ours.dims[:, :-1, :2]) / 2
    offset = np.concatenate([np.zeros((len(ours), 1, 2)), np.diff(ours.xy, axis=1) / reach], axis=1)
    for i in range(n):
        tower: plain.Tower = []
        for k in range(ours.length):
            orientation = plain.ORIENTATIONS[ours.rotation[i, k]]
            plain.place(tower, blocks[ours.block[i, k]], orientation, offset[i, k])
        same_tower(ours, i, tower)
    rng = stream(SEED, "check plain towers")
    drawn = [plain.random_tower(blocks, 5, rng, domain.offset.sd, domain.offset.limit) for _ in range(400)]
    by_name = {name: i for i, name in enumerate(domain.training_blocks.name)}
    for tower in drawn:
        np.testing.assert_equal(len({block.name for block in tower}), 5)
    same_mean(ours.block, np.array([[by_name[block.name] for block in tower] for tower in drawn]))
    same_mean(ours.dims[..., 2], np.array([[block.dims.z for block in tower] for tower in drawn]))
    same_mean(ours.xy[:, 1:] ** 2, np.array([[block.position[:2] for block in tower] for tower in drawn])[:, 1:] ** 2)


def same_tower(towers: Towers, i: int, tower: plain.Tower) -> None:
    """Row i is this tower, placement by placement."""
    position = np.concatenate([towers.xy[i], towers.z[i][:, None]], axis=1)
    np.testing.assert_allclose([block.dims for block in tower], towers.dims[i], atol=1e-12)
    np.testing.assert_allclose([block.com for block in tower], towers.com[i], atol=1e-12)
    np.testing.assert_allclose([block.mass for block in tower], towers.mass[i])
    np.testing.assert_allclose([block.position for block in tower], position, atol=1e-12)


def same_mean(a: np.ndarray, b: np.ndarray) -> None:
    """Samples [N, ...] and [M, ...] of one distribution: their means agree within 5 standard errors, everywhere."""
    error = np.sqrt(a.var(0) / len(a) + b.var(0) / len(b))
    np.testing.assert_array_less(np.abs(a.mean(0) - b.mean(0)), 5 * error)


def labels(setting: Setting) -> Case:
    """Labels of all prefixes of random towers, without noise."""
    n = setting.sizes.towers
    towers = setting.random_towers("towers", n)
    return label_case(setting, "prefix labels of random 5-block towers", towers, f"{n:,} at once, most fall early")


def labels_balanced(setting: Setting) -> Case:
    """The same where half of the towers stand, so that the reference must look at all prefixes of those."""
    n = setting.sizes.towers // 10
    towers, _ = setting.default.domain.balanced(5, n, stream(SEED, "balanced"))
    towers = towers[stream(SEED, "order").permutation(n)]
    return label_case(setting, "prefix labels of 5-block towers, half standing", towers, f"{n:,} at once")


def label_case(setting: Setting, title: str, towers: Towers, what: str) -> Case:
    """Labels of the given towers."""
    world, rng = AnalyticWorld(), stream(SEED, "unused")
    n, fraction = len(towers), setting.sizes.towers_reference
    some = plain.tower_list(towers[:fraction])
    expected = world.execute(towers, rng)
    np.testing.assert_array_equal([plain.prefix_labels(tower) for tower in some], expected[:fraction])
    copy, scale = memory_pass(array_bytes(towers) + expected.nbytes)
    return Case(
        title,
        unit="towers",
        amount=n,
        ours=Timed(lambda fresh: world.execute(fresh, rng), setup=lambda: towers[:]),
        reference=[Timed(lambda: [plain.prefix_labels(tower) for tower in some], n / fraction)],
        limit=[Timed(copy, scale)],
        target=Target(ratio=80),
        note=f"{what}; reference on {fraction}, scaled; {MEMORY}",
        repetitions=setting.sizes.repetitions,
    )


def rotations(setting: Setting) -> Case:
    """Towers as seen from four sides, with all that a network is told about: sides, centres of mass, positions."""
    n, fraction = setting.sizes.towers, setting.sizes.towers_reference // 2
    towers = setting.random_towers("towers", n)
    some = plain.tower_list(towers[:fraction])

    def views(towers: Towers) -> list[Towers]:
        turned = [towers.turned(quarters) for quarters in range(4)]
        for view in turned:
            _ = view.dims, view.com
        return turned

    ours = views(towers[:fraction])
    for i, tower in enumerate(some):
        for view, plain_view in zip(ours, plain.four_views(tower), strict=True):
            same_tower(view, i, plain_view)
    written = sum(array_bytes(view) + view.dims.nbytes + view.com.nbytes for view in ours) * n / fraction
    copy, scale = memory_pass(array_bytes(towers) + round(written))
    return Case(
        "rotation augmentation",
        unit="views",
        amount=4 * n,
        ours=Timed(views, setup=lambda: towers[:]),
        reference=[Timed(lambda: [plain.four_views(tower) for tower in some], n / fraction)],
        limit=[Timed(copy, scale)],
        target=Target(ratio=300),
        note=f"{n:,} towers x 4, sides and centres of mass included; reference on {fraction}, scaled; {MEMORY}",
        repetitions=setting.sizes.repetitions,
    )


def bald(setting: Setting) -> Case:
    """Expected BALD of random candidates under a trained ensemble."""
    ensemble, n = setting.trained, setting.sizes.candidates
    score, rng, fraction = setting.default.sampler.score, stream(SEED, "unused"), setting.sizes.candidates_reference
    candidates = setting.random_towers("candidates", n)
    members = plain_members(ensemble)
    some = plain.tower_list(candidates[:fraction])
    expected = score(ensemble, candidates[:fraction], rng)
    np.testing.assert_allclose(plain_learning.expected_bald(members, some), expected, rtol=1e-4, atol=1e-5)
    products = products_with_weights(ensemble.network, lambda: score(ensemble, candidates[:], rng))
    return Case(
        f"expected BALD of {n:,} 5-block candidates",
        unit="candidates",
        amount=n,
        ours=Timed(lambda fresh: score(ensemble, fresh, rng), setup=lambda: candidates[:]),
        reference=[Timed(lambda: plain_learning.expected_bald(members, some), n / fraction)],
        limit=[Timed(replay(products))],
        target=Target(ratio=6),
        note=f"TGN, {ensemble.members} members; reference on {fraction}, scaled",
        repetitions=setting.sizes.repetitions,
    )


def plan(setting: Setting) -> Case:
    """One plan with a trained ensemble: the mean over the three tasks, each from the beginning."""
    ensemble, domain, n = setting.trained, setting.default.domain, setting.sizes.plan_candidates
    planner, tasks, rng = setting.default.planner, setting.default.task, stream(SEED, "unused")
    fraction = setting.sizes.candidates_reference
    candidates = domain.problem(5, n, stream(SEED, "problem"))
    members = plain_members(ensemble)
    some = plain.tower_list(candidates[:fraction])
    for name, task in tasks.items():
        choice = planner.plan(task, planner.pool(candidates[:fraction], ensemble, rng))
        index, value, expected = plain_learning.plan(members, some, plain.VALUES[name])
        np.testing.assert_equal(choice.index, index)
        np.testing.assert_allclose([choice.value, choice.expected], [value, expected], rtol=1e-4)
    feasible = np.concatenate([ensemble.feasibility(candidates[i : i + 10_000]) for i in range(0, n, 10_000)])
    for task in tasks.values():
        choice = planner.plan(task, planner.pool(candidates, ensemble, rng))
        expected = feasible * task.value(candidates)
        np.testing.assert_equal(choice.index, expected.argmax())
        np.testing.assert_allclose(choice.expected, expected.max(), rtol=1e-5)

    def plans(candidates: Towers) -> None:
        for task in tasks.values():
            planner.plan(task, planner.pool(candidates[:], ensemble, rng))

    def reference() -> None:
        for name in tasks:
            plain_learning.plan(members, some, plain.VALUES[name])

    products = products_with_weights(ensemble.network, lambda: plans(candidates))
    return Case(
        f"one plan over {n:,} candidates",
        unit="candidates",
        amount=n,
        ours=Timed(plans, 1 / len(tasks), setup=lambda: candidates),
        reference=[Timed(reference, n / fraction / len(tasks))],
        limit=[Timed(replay(products), 1 / len(tasks))],
        target=Target(ratio=100),
        note=f"trained TGN, candidates given, mean of three tasks; reference scores {fraction}, scaled; same choice as "
        f"exhaustive scoring of all {n:,}; limit: products of the candidates that are looked at",
        repetitions=setting.sizes.repetitions,
    )


def search(setting: Setting) -> Case:
    """One plan by local search, the mean over three tasks, each alone; against Monte Carlo of many more candidates."""
    ensemble, domain = setting.trained, setting.default.domain
    tasks, planner = setting.default.task, setting.planner("search")
    monte_carlo, n = setting.default.planner, SEARCH_RIVAL * setting.sizes.plan_candidates

    def problem(number: int, n: int) -> Problem:
        return Problem(domain.problem(5, n, stream(SEED, "problem", number)), stream(SEED, "search", number))

    def choose(by: Planner, number: int, n: int) -> list[float]:
        """P x V of the plan for each task; the members' own P, which both planners maximise here."""
        return [
            next(by.choose([problem(number, n)], {name: task}, ensemble, domain))[name].expected
            for name, task in tasks.items()
        ]

    plain_search = setting.planner("search", "planner.pessimism=null")
    rival = np.array([choose(monte_carlo, number, n) for number in range(SEARCH_PROBLEMS)])
    found = np.array([choose(plain_search, number, planner.start) for number in range(SEARCH_PROBLEMS)])
    np.testing.assert_array_less(rival.mean(0), found.mean(0))
    return Case(
        f"one plan by search, {planner.start:,} candidates and {planner.generations * planner.children:,} variations",
        unit="plans",
        amount=1,
        ours=Timed(lambda: choose(planner, 0, planner.start), 1 / len(tasks)),
        reference=[Timed(lambda: choose(monte_carlo, 0, n), 1 / len(tasks))],
        target=Target(seconds=0.3),
        note=f"trained TGN, candidates drawn, mean of three tasks; reference: Monte Carlo of {n:,} candidates; the "
        f"search's mean P x V is higher for each task, over {SEARCH_PROBLEMS} problems: {gains(rival, found)}",
        repetitions=min(setting.sizes.repetitions, 3),
    )


def gains(rival: np.ndarray, found: np.ndarray) -> str:
    """By how much the means of P x V [problems, tasks] are higher, in words."""
    return ", ".join(f"{gain:+.0%}" for gain in found.mean(0) / rival.mean(0) - 1)


def searches(setting: Setting) -> Case:
    """All plans of an evaluation by local search: the tasks of a problem side by side."""
    ensemble, domain, tasks = setting.trained, setting.default.domain, setting.default.task
    planner, n = setting.planner("search"), setting.default.evaluation.problems

    def evaluate() -> None:
        problems = (
            Problem(domain.problem(5, planner.start, stream(SEED, "problem", i)), stream(SEED, "search", i))
            for i in range(n)
        )
        for _ in planner.choose(problems, tasks, ensemble, domain):
            pass

    return Case(
        f"the {n * len(tasks)} plans of an evaluation by search",
        unit="plans",
        amount=n * len(tasks),
        ours=Timed(evaluate),
        target=Target(seconds=30),
        note=f"trained TGN, {n} problems, three tasks, candidates drawn; timed once",
        repetitions=1,
    )


def run(setting: Setting, device: str, target: Target) -> Case:
    """A whole run with the default config, by its command."""

    def work() -> None:
        with tempfile.TemporaryDirectory() as directory:
            command = [sys.executable, "-m", "apf.main", "tracker=none", f"device={device}", "threads=1"]
            environment = os.environ | {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
            subprocess.run(
                [*command, f"hydra.run.dir={directory}/run"],
                check=True,
                capture_output=True,
                env=environment,
                cwd=Path(__file__).parents[1],
            )

    return Case(
        "a whole run of 400 towers",
        unit="towers",
        amount=400,
        ours=Timed(work),
        target=target,
        note=f"python -m apf.main: evaluation every 100 towers, 50 problems, three tasks; {device}, one thread of the "
        "CPU; timed once",
        repetitions=1,
    )


def array_bytes(towers: Towers) -> int:
    """Bytes of what defines the towers."""
    return towers.block.nbytes + towers.rotation.nbytes + towers.xy.nbytes


OPERATIONS: dict[str, Callable[[Setting], Case]] = {
    "towers": towers,
    "labels": labels,
    "labels-balanced": labels_balanced,
    "rotations": rotations,
    "epoch-tgn": partial(epoch, model="tgn", target=Target(ratio=10, limit_share=0.5)),
    "epoch-fcgn": partial(epoch, model="fcgn", target=Target(ratio=5)),
    "epoch-lstm": partial(epoch, model="lstm", target=Target(ratio=5)),
    "bald": bald,
    "plan": plan,
    "search": search,
    "searches": searches,
    "acquisition": acquisition,
    "run": partial(run, device="cpu", target=Target(seconds=600)),
}
"""By their short names, in the order of the table."""

ONLY_FULL = ("searches", "run")
"""Left out of a quick benchmark."""
