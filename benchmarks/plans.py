"""Worlds as they are drawn: outlines, what stands inside, and where robots may start."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from usmap_ros.simulation.occlusion import point_segment_distances

FloatArray = NDArray[np.float64]
Point = tuple[float, float]
#: Lowest and highest x, lowest and highest y.
Area = tuple[float, float, float, float]

#: Least distance of things, doors and robots from one another and from walls.
MARGIN_M = 0.5
DOOR_M = 0.95
#: Least distance of a robot from everything at its start.
START_M = 0.4
#: How often a place is drawn before there is taken to be none.
_ATTEMPTS = 200


@dataclass
class Plan:
    """A world as it is drawn: outlines, what stands inside, and where robots may start.

    Parameters
    ----------
    walls : list of (corners, closed)
        Outlines and partitions.
    poles, pillars : list of (x, y)
        Thin poles, and pillars of 10 to 25 cm.
    columns : list of (x, y, radius)
        Round columns of a stated radius.
    free : list of (x, y)
        Places with room for a robot.
    """

    walls: list[tuple[list[Point], bool]] = field(default_factory=list)
    poles: list[Point] = field(default_factory=list)
    pillars: list[Point] = field(default_factory=list)
    columns: list[tuple[float, float, float]] = field(default_factory=list)
    free: list[Point] = field(default_factory=list)


def room(rng: np.random.Generator) -> Plan:
    """A rectangle cut by one or two partitions with a door each."""
    width_m, height_m = rng.uniform(6.0, 8.5), rng.uniform(4.5, 6.5)
    plan = Plan([(_box(0.0, 0.0, width_m, height_m), True)])
    cuts = np.sort(rng.uniform(0.3, 0.7, 1)) if rng.random() < 0.5 else np.array([0.34, 0.67])
    for cut in cuts * width_m:
        door_m = rng.uniform(MARGIN_M, height_m - MARGIN_M - DOOR_M)
        plan.walls.append(([(cut, 0.0), (cut, door_m)], False))
        plan.walls.append(([(cut, door_m + DOOR_M), (cut, height_m)], False))
    borders = [0.0, *(cuts * width_m), width_m]
    for left, right in pairwise(borders):
        _furnish(plan, rng, (left, right, 0.0, height_m), poles=2, pillars=1)
    return plan


def two_rooms(rng: np.random.Generator) -> Plan:
    """Two rooms side by side, whose walls are the first two outlines, with a doorway between."""
    height_m, thick_m = rng.uniform(4.0, 5.5), 0.1
    left_m, right_m = rng.uniform(3.5, 5.0, 2)
    low_m = rng.uniform(MARGIN_M, height_m - MARGIN_M - DOOR_M)
    high_m, begin_m = low_m + DOOR_M, left_m + thick_m
    end_m = begin_m + right_m
    plan = Plan()
    for door_m, far_m in ((left_m, 0.0), (begin_m, end_m)):
        corners = [(door_m, high_m), (door_m, height_m), (far_m, height_m)]
        corners += [(far_m, 0.0), (door_m, 0.0), (door_m, low_m)]
        plan.walls.append((corners, False))
    plan.walls += [([(left_m, y_m), (begin_m, y_m)], False) for y_m in (low_m, high_m)]
    for area in ((0.0, left_m, 0.0, height_m), (begin_m, end_m, 0.0, height_m)):
        _furnish(plan, rng, area, poles=1, pillars=1)
    return plan


def corridor(rng: np.random.Generator) -> Plan:
    """A corridor with rooms along one side."""
    length_m, depth_m, across_m = rng.uniform(8.0, 10.0), rng.uniform(2.5, 3.2), 1.6
    plan = Plan([(_box(0.0, 0.0, length_m, depth_m + across_m), True)])
    borders = np.linspace(0.0, length_m, 4)
    borders[1:-1] += rng.uniform(-0.4, 0.4, 2)
    ends = [0.0]
    for left, right in pairwise(borders):
        door_m = rng.uniform(left + MARGIN_M, right - MARGIN_M - DOOR_M)
        plan.walls.append(([(ends[-1], across_m), (door_m, across_m)], False))
        ends.append(door_m + DOOR_M)
        _furnish(plan, rng, (left, right, across_m, across_m + depth_m), poles=1, pillars=0)
    plan.walls.append(([(ends[-1], across_m), (length_m, across_m)], False))
    for border in borders[1:-1]:
        plan.walls.append(([(border, across_m), (border, across_m + depth_m)], False))
    _furnish(plan, rng, (0.0, length_m, 0.0, across_m), poles=1, pillars=0)
    return plan


def corners(rng: np.random.Generator) -> Plan:
    """A room in the shape of an L or of a U."""
    width_m, height_m = rng.uniform(6.5, 8.5), rng.uniform(5.0, 7.0)
    arm_m, foot_m = rng.uniform(2.0, 2.6), rng.uniform(2.0, 2.6)
    inner = [(width_m, foot_m), (arm_m, foot_m), (arm_m, height_m)]
    areas = [(0.0, arm_m, 0.0, height_m), (arm_m, width_m, 0.0, foot_m)]
    if rng.random() < 0.5:
        right_m = width_m - arm_m
        inner = [
            (width_m, height_m), (right_m, height_m), (right_m, foot_m),
            (arm_m, foot_m), (arm_m, height_m),
        ]  # fmt: skip
        areas = [areas[0], (arm_m, right_m, 0.0, foot_m), (right_m, width_m, 0.0, height_m)]
    plan = Plan([([(0.0, 0.0), (width_m, 0.0), *inner, (0.0, height_m)], True)])
    for area in areas:
        _furnish(plan, rng, area, poles=1, pillars=0)
    return plan


def clutter(rng: np.random.Generator) -> Plan:
    """A room full of poles, pillars and crates."""
    width_m, height_m = rng.uniform(5.5, 7.5), rng.uniform(5.0, 6.5)
    plan = Plan([(_box(0.0, 0.0, width_m, height_m), True)])
    crates: list[Point] = []
    for _ in range(4):
        _place(crates, rng, (0.5, width_m - 0.5, 0.5, height_m - 0.5), [crates], 1.6)
    for x_m, y_m in crates:
        half_x_m, half_y_m = rng.uniform(0.15, 0.35, 2)
        box = _box(x_m - half_x_m, y_m - half_y_m, x_m + half_x_m, y_m + half_y_m)
        plan.walls.append((box, True))
    for things, count in ((plan.pillars, 4), (plan.poles, 8), (plan.free, 3)):
        for _ in range(count):
            others = [crates, plan.pillars, plan.poles, plan.free]
            _place(things, rng, (0.0, width_m, 0.0, height_m), others, 0.9)
    return plan


def hall(rng: np.random.Generator) -> Plan:
    """An empty rectangle but for a few poles and a pillar."""
    width_m, height_m = rng.uniform(5.0, 6.5), rng.uniform(4.5, 6.0)
    plan = Plan([(_box(0.0, 0.0, width_m, height_m), True)])
    for _ in range(3):
        _place(plan.free, rng, (0.0, width_m, 0.0, height_m), [plan.free], 1.5)
    _furnish(plan, rng, (0.0, width_m, 0.0, height_m), poles=3, pillars=1)
    return plan


def columns(rng: np.random.Generator) -> Plan:
    """A room with round columns, along the axes of the map."""
    width_m, height_m = rng.uniform(6.0, 8.0), rng.uniform(5.0, 6.5)
    plan = Plan([(_box(0.0, 0.0, width_m, height_m), True)])
    inside = (0.6, width_m - 0.6, 0.6, height_m - 0.6)
    for _ in range(int(rng.integers(3, 6))):
        _place(plan.pillars, rng, inside, [plan.pillars], 1.4)
    plan.columns = [(x_m, y_m, float(rng.uniform(0.15, 0.35))) for x_m, y_m in plan.pillars]
    plan.pillars = []
    for _ in range(3):
        _start(plan, rng, inside)
    return plan


def arena(rng: np.random.Generator) -> Plan:
    """A hexagon with nine columns in rows, as robots' simulators like to have."""
    side_m = rng.uniform(2.6, 3.2)
    angles = np.arange(6) * np.pi / 3.0
    corners = [
        (float(x), float(y)) for x, y in side_m * np.stack([np.cos(angles), np.sin(angles)]).T
    ]
    plan = Plan([(corners, True)])
    apart_m = rng.uniform(1.0, 1.2)
    for x in (-1, 0, 1):
        for y in (-1, 0, 1):
            plan.columns.append((x * apart_m, y * apart_m, 0.15))
    for _ in range(3):
        _start(plan, rng, (-0.8 * side_m, 0.8 * side_m, -0.8 * side_m, 0.8 * side_m))
    return plan


def depot(rng: np.random.Generator) -> Plan:
    """A hall with racks in two rows, boxes along a wall and a few pillars."""
    width_m, height_m = rng.uniform(8.5, 10.5), rng.uniform(6.5, 8.0)
    plan = Plan([(_box(0.0, 0.0, width_m, height_m), True)])
    for share in (0.3, 0.6):
        left_m, middle_m = (
            share * width_m + rng.uniform(-0.2, 0.2),
            rng.uniform(0.42, 0.58) * height_m,
        )
        for low_m, high_m in ((1.3, middle_m - 0.7), (middle_m + 0.7, height_m - 1.3)):
            plan.walls.append((_box(left_m, low_m, left_m + 0.55, high_m), True))
    for y_m in np.linspace(1.0, height_m - 1.6, 4):
        if rng.random() < 0.75:
            left_m, size_m = rng.uniform(0.86, 0.9) * width_m, rng.uniform(0.35, 0.65)
            plan.walls.append((_box(left_m, y_m, left_m + size_m, y_m + size_m), True))
    plan.pillars = [(0.14 * width_m, share * height_m) for share in (0.3, 0.7)]
    for area in ((0.0, 0.28), (0.4, 0.58), (0.7, 0.84)):
        _start(plan, rng, (area[0] * width_m, area[1] * width_m, 0.0, height_m))
    return plan


def warehouse(rng: np.random.Generator) -> Plan:
    """Long racks with aisles between, more than a few robots see of in a short time."""
    width_m, height_m = rng.uniform(13.0, 15.0), rng.uniform(9.0, 10.5)
    plan = Plan([(_box(0.0, 0.0, width_m, height_m), True)])
    cross_m = rng.uniform(0.42, 0.58) * width_m
    rows = np.linspace(1.7, height_m - 2.4, 4)
    for row_m in rows:
        for left_m, right_m in ((1.5, cross_m - 0.75), (cross_m + 0.75, width_m - 1.5)):
            if rng.random() < 0.85:
                plan.walls.append((_box(left_m, row_m, right_m, row_m + 0.8), True))
    for _ in range(3):
        _start(plan, rng, (0.0, width_m, 0.0, height_m))
    return plan


def symmetric(rng: np.random.Generator) -> Plan:
    """A room that is the same after half a turn: two partitions, and a pole on either side."""
    width_m, height_m = rng.uniform(6.0, 8.5), rng.uniform(4.5, 6.5)
    cut_m, end_m = rng.uniform(0.3, 0.4) * width_m, rng.uniform(0.5, 0.7) * height_m
    pole_m = rng.uniform(0.7, 0.8) * width_m, rng.uniform(0.2, 0.3) * height_m
    plan = Plan([(_box(0.0, 0.0, width_m, height_m), True)], [pole_m])
    partition = [(cut_m, 0.0), (cut_m, end_m)]
    turned = [(width_m - x_m, height_m - y_m) for x_m, y_m in partition]
    plan.walls += [(partition, False), (turned, False)]
    plan.poles.append((width_m - pole_m[0], height_m - pole_m[1]))
    for _ in range(3):
        _start(plan, rng, (0.0, width_m, 0.0, height_m))
    return plan


def swarm_room(rng: np.random.Generator) -> Plan:
    """A small room with crates and columns, for a swarm of small robots."""
    width_m, height_m = rng.uniform(4.0, 5.5), rng.uniform(3.5, 4.5)
    plan = Plan([(_box(0.0, 0.0, width_m, height_m), True)])
    crates: list[Point] = []
    for _ in range(int(rng.integers(2, 5))):
        _place(crates, rng, (0.2, width_m - 0.2, 0.2, height_m - 0.2), [crates], 1.2)
    for x_m, y_m in crates:
        half_x_m, half_y_m = rng.uniform(0.1, 0.3, 2)
        box = _box(x_m - half_x_m, y_m - half_y_m, x_m + half_x_m, y_m + half_y_m)
        plan.walls.append((box, True))
    for _ in range(5):
        _start(plan, rng, (0.0, width_m, 0.0, height_m))
    return plan


def _box(left: float, low: float, right: float, high: float) -> list[Point]:
    return [(left, low), (right, low), (right, high), (left, high)]


def _start(plan: Plan, rng: np.random.Generator, area: Area) -> None:
    """Add a place to start in an area that keeps clear of all that stands.

    Raises
    ------
    ValueError
        If none is found.
    """
    legs = [
        leg
        for corners, closed in plan.walls
        for leg in pairwise([*corners, corners[0]] if closed else corners)
    ]
    starts_m, ends_m = np.array(legs).transpose(1, 0, 2)
    discs = [*((x_m, y_m, 0.25) for x_m, y_m in plan.pillars), *plan.columns]
    places = np.array([(x_m, y_m, 0.0) for x_m, y_m in plan.poles] + discs).reshape(-1, 3)
    for _ in range(_ATTEMPTS):
        place = rng.uniform(area[0::2], area[1::2])
        away = np.hypot(*(places[:, :2] - place).T) - places[:, 2]
        walls_m = point_segment_distances(place, starts_m, ends_m)
        if min(walls_m.min(), away.min(initial=np.inf)) >= START_M and _is_inside(place, plan):
            plan.free.append((float(place[0]), float(place[1])))
            return
    raise ValueError("there is no room to start anywhere in the area")


def _is_inside(place: FloatArray, plan: Plan) -> bool:
    """Whether a place is inside the outline, the first of the walls, and in no box."""
    within = []
    for corners, closed in plan.walls:
        if not closed:
            continue
        here, there = np.array(corners), np.roll(corners, -1, axis=0)
        spans = (here[:, 1] > place[1]) != (there[:, 1] > place[1])
        with np.errstate(divide="ignore", invalid="ignore"):
            share = (place[1] - here[:, 1]) / (there[:, 1] - here[:, 1])
        crossed = spans & (place[0] < here[:, 0] + share * (there[:, 0] - here[:, 0]))
        within.append(np.count_nonzero(crossed) % 2 == 1)
    return within[0] and not any(within[1:])


def _furnish(
    plan: Plan,
    rng: np.random.Generator,
    area: Area,
    poles: int,
    pillars: int,
) -> None:
    """Put things and a place to start into a rectangle, apart from its borders and one another."""
    others = [plan.pillars, plan.poles, plan.free]
    for things, count in ((plan.free, 1), (plan.pillars, pillars), (plan.poles, poles)):
        for _ in range(count):
            _place(things, rng, area, others, 2.0 * MARGIN_M)


def _place(
    things: list[Point],
    rng: np.random.Generator,
    area: Area,
    others: list[list[Point]],
    apart_m: float,
) -> None:
    """Add a place in an area apart from others, if one is found."""
    low = np.array(area[0::2]) + MARGIN_M
    high = np.array(area[1::2]) - MARGIN_M
    taken: FloatArray = np.array([place for places in others for place in places]).reshape(-1, 2)
    for _ in range(_ATTEMPTS):
        x_m, y_m = rng.uniform(low, high)
        if np.all(np.hypot(*(taken - [x_m, y_m]).T) >= apart_m):
            things.append((float(x_m), float(y_m)))
            return
