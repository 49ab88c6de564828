"""The rule in plain Python, one packing and one corner at a time, in exact fractions."""

from fractions import Fraction
from itertools import product
from typing import NamedTuple

from apf.packing import Failure, Packings

LEVEL = Fraction(1, 10_000)


class Lying(NamedTuple):
    """A box: its lowest and its highest corner."""

    low: tuple[Fraction, ...]
    high: tuple[Fraction, ...]


Rectangle = tuple[tuple[Fraction, Fraction], tuple[Fraction, Fraction]]
"""From x to x, from y to y."""


def reference(packings: Packings, number: int) -> list[Failure]:
    """`Failure` of each prefix of one packing, up to the first that fails."""
    container, gripper = packings.cell.container, packings.cell.gripper
    walls = [Fraction(side) / 2 for side in (container.length, container.width)]
    lying: list[Lying] = []
    found: list[Failure] = []
    for j in range(packings.length):
        sides = [Fraction(side) for side in packings.dims[number, j].tolist()]
        x, y = (Fraction(v) for v in packings.xy[number, j].tolist())
        area = around((x, y), (sides[0] / 2, sides[1] / 2))
        bottom = max((box.high[2] for box in lying if meet(area, seen(box))), default=Fraction(0))
        box = Lying((area[0][0], area[1][0], bottom), (area[0][1], area[1][1], bottom + sides[2]))
        grip = int(packings.orientation[number, j]) % 2
        fingers = []
        for sign in (-1, 1):
            centre, half = [x, y], [Fraction(gripper.width) / 2] * 2
            centre[grip] += sign * (sides[grip] / 2 + Fraction(gripper.thickness) / 2)
            half[grip] = Fraction(gripper.thickness) / 2
            fingers.append(around(centre, half))
        tips = bottom + Fraction(gripper.lift)
        if sticks_out(area, walls):
            failure = Failure.WALL
        elif tips < Fraction(container.height) and any(sticks_out(finger, walls) for finger in fingers):
            failure = Failure.FINGER_WALL
        elif any(meet(finger, seen(other)) and other.high[2] > tips for finger in fingers for other in lying):
            failure = Failure.FINGER_BOX
        elif box.high[2] > Fraction(container.height):
            failure = Failure.TOO_HIGH
        else:
            failure = balance([*lying, box])
        found.append(failure)
        if failure is not Failure.NONE:
            break
        lying.append(box)
    return found


def balance(lying: list[Lying]) -> Failure:
    """Does the last box tip, or one that bears it?"""
    loads: list[list[tuple[Fraction, tuple[Fraction, Fraction], tuple[Fraction, Fraction]]]] = [[] for _ in lying]
    for b in range(len(lying) - 1, -1, -1):
        box = lying[b]
        weight = (box.high[0] - box.low[0]) * (box.high[1] - box.low[1]) * (box.high[2] - box.low[2])
        middle = ((box.low[0] + box.high[0]) / 2, (box.low[1] + box.high[1]) / 2)
        parts = [(weight, middle, middle), *loads[b]]
        total = sum((w for w, _, _ in parts), Fraction(0))
        low = [sum((w * at[axis] for w, at, _ in parts), Fraction(0)) / total for axis in range(2)]
        high = [sum((w * at[axis] for w, _, at in parts), Fraction(0)) / total for axis in range(2)]
        if box.low[2] <= LEVEL:
            continue
        below = {
            s: common(seen(lying[s]), seen(box))
            for s in range(b)
            if meet(seen(lying[s]), seen(box)) and abs(lying[s].high[2] - box.low[2]) < LEVEL
        }
        corners = [corner for area in below.values() for corner in product(*area)]
        if not all(in_hull(point, corners) for point in product((low[0], high[0]), (low[1], high[1]))):
            return Failure.UNSUPPORTED if b == len(lying) - 1 else Failure.PUSHED
        for s, ((x_low, x_high), (y_low, y_high)) in below.items():
            place = (tuple(low), tuple(high)) if len(below) == 1 else ((x_low, y_low), (x_high, y_high))
            loads[s].append((total, *place))  # type: ignore[arg-type]
    return Failure.NONE


def in_hull(point, corners) -> bool:
    """Strictly inside the convex hull, by Andrew's monotone chain?"""
    points = sorted(set(corners))
    hull = []
    for ordered in (points, points[::-1]):
        chain = []
        for p in ordered:
            while len(chain) > 1 and turn(chain[-2], chain[-1], p) <= 0:
                chain.pop()
            chain.append(p)
        hull += chain[:-1]
    return all(turn(a, b, point) > 0 for a, b in zip(hull, hull[1:] + hull[:1], strict=True))


def turn(a, b, c) -> Fraction:
    """Above 0 if a, b, c turn to the left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def around(centre, half) -> Rectangle:
    return tuple((c - h, c + h) for c, h in zip(centre, half, strict=True))  # type: ignore[return-value]


def seen(box: Lying) -> Rectangle:
    return (box.low[0], box.high[0]), (box.low[1], box.high[1])


def common(one: Rectangle, other: Rectangle) -> Rectangle:
    return tuple((max(a[0], b[0]), min(a[1], b[1])) for a, b in zip(one, other, strict=True))  # type: ignore[return-value]


def meet(one: Rectangle, other: Rectangle) -> bool:
    return all(low < high for low, high in common(one, other))


def sticks_out(area: Rectangle, walls) -> bool:
    return any(low < -wall or high > wall for (low, high), wall in zip(area, walls, strict=True))
