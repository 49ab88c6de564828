"""Which actions in which order: the task level, stated in PDDL and solved by pyperplan (through unified-planning).

    move-free      (from, to)                                the hand is empty
    move-holding   (block, grasp, from, to)
    pick           (block, pose, grasp, before, above)       from before the block to above its place, the block in hand
    place          (block, pose, grasp, before, above)       the other way round, onto a spot
    regrasp        (block, pose, grasp, before, above)       the same, onto the pedestal, to be picked by another grasp

What stations there are (which block, at which pose, by which grasp, from which joints) comes from the samplers, as
static facts.
"""

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache

from unified_planning.environment import Environment
from unified_planning.model import Fluent, InstantaneousAction, Object, Problem, Type

BLOCK, POSE, GRASP, JOINTS = "block", "pose", "grasp", "joints"
"""Types of objects."""
BEFORE, ABOVE = "before", "above"


@dataclass(frozen=True)
class Fact:
    """A station that a sampler found: a block at a named pose can be held by a grasp."""

    block: int
    pose: str
    grasp: int


@dataclass(frozen=True)
class Action:
    """A step of a task plan: its name, and the station that it uses or, for moves, ends at (`where` of it)."""

    name: str
    station: Fact
    where: str


@contextmanager
def _no_log() -> Iterator[None]:
    """pyperplan logs to the root logger, which would make Python log everything to the terminal from then on."""
    root, nowhere = logging.getLogger(), logging.NullHandler()
    root.addHandler(nowhere)
    try:
        yield
    finally:
        root.removeHandler(nowhere)


def _domain() -> Problem:
    """The actions, without objects, in an environment of their own: that keeps every expression ever made in it."""
    environment = Environment()
    environment.credits_stream = None
    types = environment.type_manager

    def typed(parameters: dict[str, str]) -> dict[str, Type]:
        return {name: types.UserType(kind) for name, kind in parameters.items()}

    def fluent(name: str, **parameters: str) -> Fluent:
        return Fluent(name, types.BoolType(), environment=environment, **typed(parameters))

    def action_of(name: str, **parameters: str) -> InstantaneousAction:
        return InstantaneousAction(name, _env=environment, **typed(parameters))

    at = fluent("at", q=JOINTS)
    empty = fluent("empty")
    holding = fluent("holding", b=BLOCK, g=GRASP)
    lies = fluent("lies", b=BLOCK, p=POSE)
    reach = fluent("reach", b=BLOCK, p=POSE, g=GRASP, before=JOINTS, above=JOINTS)
    spot, pedestal = (fluent(name, p=POSE) for name in ("spot", "pedestal"))

    free = action_of("move-free", a=JOINTS, b=JOINTS)
    carry = action_of("move-holding", k=BLOCK, g=GRASP, a=JOINTS, b=JOINTS)
    free.add_precondition(empty())
    carry.add_precondition(holding(carry.parameter("k"), carry.parameter("g")))
    for move in (free, carry):
        a, b = move.parameter("a"), move.parameter("b")
        move.add_precondition(at(a))
        move.add_effect(at(a), False)
        move.add_effect(at(b), True)

    actions = [free, carry]
    for name, kind in (("pick", None), ("place", spot), ("regrasp", pedestal)):
        action = action_of(name, k=BLOCK, p=POSE, g=GRASP, before=JOINTS, above=JOINTS)
        k, p, g, before, above = action.parameters
        action.add_precondition(reach(k, p, g, before, above))
        first, last = (before, above) if kind is None else (above, before)
        action.add_precondition(at(first))
        action.add_effect(at(first), False)
        action.add_effect(at(last), True)
        picks = kind is None
        if kind is None:
            action.add_precondition(empty())
            action.add_precondition(lies(k, p))
        else:
            action.add_precondition(kind(p))
            action.add_precondition(holding(k, g))
        action.add_effect(holding(k, g), picks)
        action.add_effect(empty(), not picks)
        action.add_effect(lies(k, p), not picks)
        actions.append(action)
    problem = Problem("stack", environment, initial_defaults={types.BoolType(): False})
    problem.add_fluents([at, empty, holding, lies, reach, spot, pedestal])
    problem.add_actions(actions)
    return problem


def solve(block: int, now: str, goal: str, pedestal: Sequence[str], facts: Sequence[Fact]) -> list[Action] | None:
    """The actions that bring a block from the pose named `now` to the one named `goal`; None: the facts do not suffice.

    Of several shortest plans any may be answered, and not the same
    one in every process; facts that allow a single one make it certain.

    Args:
        block: The name of the block.
        now: The name of its pose.
        goal: The name of the pose that it is to have.
        pedestal: Named poses that are on the pedestal.
        facts: What is known to be possible.
    """
    # problems that differ in names alone have one plan, found once
    named = dict.fromkeys([now, goal, *pedestal, *(fact.pose for fact in facts)])
    poses = {name: f"pose{i}" for i, name in enumerate(named)}
    grasps = list(dict.fromkeys(fact.grasp for fact in facts))
    plain = tuple(Fact(0, poses[fact.pose], grasps.index(fact.grasp)) for fact in facts)
    found = _solve(poses[now], poses[goal], tuple(poses[name] for name in pedestal), plain)
    if found is None:
        return None
    names = dict(zip(plain, facts))
    return [Action(action.name, names[action.station], action.where) for action in found]


@cache
def _solve(now: str, goal: str, pedestal: tuple[str, ...], facts: tuple[Fact, ...]) -> list[Action] | None:
    """See `solve`."""
    problem = _domain()
    factory, types = problem.environment.factory, problem.environment.type_manager
    fluent = {f.name: f for f in problem.fluents}
    objects: dict[str, Object] = {}

    def named(name: str, kind: str) -> Object:
        if name not in objects:
            objects[name] = problem.add_object(name, types.UserType(kind))
        return objects[name]

    cube, hand = named("b0", BLOCK), named("start", JOINTS)
    problem.set_initial_value(fluent["at"](hand), True)
    problem.set_initial_value(fluent["empty"](), True)
    problem.set_initial_value(fluent["lies"](cube, named(now, POSE)), True)
    problem.set_initial_value(fluent["spot"](named(goal, POSE)), True)
    ends: dict[str, tuple[Fact, str]] = {}
    for name in pedestal:
        problem.set_initial_value(fluent["pedestal"](named(name, POSE)), True)
    for fact in facts:
        stem = f"{fact.pose}-{fact.grasp}"
        joints = [named(f"{stem}-{where}", JOINTS) for where in (BEFORE, ABOVE)]
        ends |= {f"{stem}-{where}": (fact, where) for where in (BEFORE, ABOVE)}
        problem.set_initial_value(
            fluent["reach"](cube, named(fact.pose, POSE), named(f"g{fact.grasp}", GRASP), *joints), True
        )
    problem.add_goal(fluent["lies"](cube, objects[goal]))
    shortest = {"search": "bfs"}
    with _no_log(), factory.OneshotPlanner(name="pyperplan", params=shortest) as planner:
        plan = planner.solve(problem).plan
    if plan is None:
        return None
    actions = []
    for step in plan.actions:
        parameters = [str(parameter) for parameter in step.actual_parameters]
        if step.action.name.startswith("move"):
            station, where = ends[parameters[-1]]
        else:
            station, where = ends[parameters[-2]][0], ABOVE if step.action.name == "pick" else BEFORE
        actions.append(Action(step.action.name, station, where))
    return actions
