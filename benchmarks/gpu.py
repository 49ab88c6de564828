"""What is timed on a GPU, each operation against the same on one core of its machine."""

from collections.abc import Callable
from functools import partial

import numpy as np

from apf.models import Ensemble
from apf.models.training import fit
from apf.rng import stream
from apf.towers import Towers
from benchmarks.learning import changed, new_generators
from benchmarks.operations import run
from benchmarks.setting import SEED, Setting
from benchmarks.timing import Case, Target, Timed

UPDATES, UPDATES_ON_CPU = 1000, 50
"""Of a training, to time one of them: what is prepared for a training counts with them."""
NEAR = 1e-4
"""How far probabilities may be from those of the CPU, whose products round in another order."""


def update(setting: Setting, model: str, members: int, target: Target) -> Case:
    """One update of all members."""
    cpu = setting.on("cpu")
    train = setting.examples()
    there, here = (s.ensemble(f"model={model}", f"model.members={members}") for s in (setting, cpu))

    def updates(ensemble: Ensemble, n: int) -> None:
        some = changed(there.training, updates=n)
        fit(ensemble.passes, train, [], some, *new_generators(ensemble), setting.sizes.labelled)

    return Case(
        f"one update, {members} {model.upper()} members",
        unit="updates",
        amount=1,
        ours=Timed(lambda: updates(there, UPDATES), 1 / UPDATES),
        reference=[Timed(lambda: updates(here, UPDATES_ON_CPU), 1 / UPDATES_ON_CPU)],
        target=target,
        note=f"batches of {there.training.batch} labels of {setting.sizes.labelled} labelled towers; "
        f"{UPDATES} updates and their preparation, divided; on the CPU {UPDATES_ON_CPU}",
        repetitions=setting.sizes.repetitions,
    )


def bald(setting: Setting, target: Target) -> Case:
    """Expected BALD of random candidates, by the same weights on both."""
    here = setting.on("cpu").trained
    there = setting.ensemble()
    there.network.load_state_dict(here.network.state_dict())
    score, rng, n = setting.default.sampler.score, stream(SEED, "unused"), setting.sizes.candidates
    candidates = setting.random_towers("candidates", n)
    np.testing.assert_allclose(score(there, candidates, rng), score(here, candidates, rng), atol=NEAR)
    return Case(
        f"expected BALD of {n:,} 5-block candidates",
        unit="candidates",
        amount=n,
        ours=Timed(lambda fresh: score(there, fresh, rng), setup=lambda: candidates[:]),
        reference=[Timed(lambda fresh: score(here, fresh, rng), setup=lambda: candidates[:])],
        target=target,
        note=f"TGN, {there.members} members, features computed by the CPU included",
        repetitions=setting.sizes.repetitions,
    )


def plan(setting: Setting, target: Target) -> Case:
    """One plan, by the same weights on both: the same tower."""
    here = setting.on("cpu").trained
    there = setting.ensemble()
    there.network.load_state_dict(here.network.state_dict())
    planner, tasks, rng = setting.default.planner, setting.default.task, stream(SEED, "unused")
    candidates = setting.default.domain.problem(5, setting.sizes.plan_candidates, stream(SEED, "problem"))

    def plans(ensemble: Ensemble, candidates: Towers) -> list[int]:
        return [planner.plan(task, planner.pool(candidates[:], ensemble, rng)).index for task in tasks.values()]

    np.testing.assert_equal(plans(there, candidates), plans(here, candidates))
    return Case(
        f"one plan over {len(candidates):,} candidates",
        unit="candidates",
        amount=len(candidates),
        ours=Timed(lambda: plans(there, candidates), 1 / len(tasks)),
        reference=[Timed(lambda: plans(here, candidates), 1 / len(tasks))],
        target=target,
        note="trained TGN, candidates given, mean of three tasks; the same towers as on the CPU",
        repetitions=setting.sizes.repetitions,
    )


OPERATIONS: dict[str, Callable[[Setting], Case]] = {
    "update-tgn": partial(update, model="tgn", members=10, target=Target(seconds=0.25e-3)),
    "update-tgn-160": partial(update, model="tgn", members=160, target=Target(seconds=0.5e-3)),
    "update-fcgn": partial(update, model="fcgn", members=10, target=Target()),
    "update-lstm": partial(update, model="lstm", members=10, target=Target()),
    "bald": partial(bald, target=Target(seconds=0.010)),
    "plan": partial(plan, target=Target(seconds=0.050)),
    "run": partial(run, device="cuda", target=Target(seconds=45)),
}
"""By their short names, in the order of the table."""
