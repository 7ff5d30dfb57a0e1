"""Random worlds to judge maps by, made otherwise than the scenarios that parameters were chosen on.

Rooms are cut out of a rectangle by partitions with doors, or are corridors with rooms beside them,
or have the shape of an L or a U; they are turned by any angle and stand off the grid.  A kind, a
condition and a seed give the same scenario every time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usmap_ros.simulation import Scenario

FloatArray = NDArray[np.float64]
#: Of a world's section in a scenario file.
World = dict[str, Any]
Point = tuple[float, float]

FLAT = Path(__file__).parent.parent / "config" / "maps" / "flat.yaml"
ROUGH = {"specular_reflectivity": 0.1, "diffuse_reflectivity": 5.0, "scatterers_per_m": 20.0}
SMOOTH = {"specular_reflectivity": 0.5, "diffuse_reflectivity": 0.3, "scatterers_per_m": 20.0}
#: Least distance of things, doors and robots from one another and from walls.
MARGIN_M = 0.5
DOOR_M = 0.95


@dataclass(frozen=True)
class Condition:
    """What a scene is recorded with.

    Parameters
    ----------
    shown : str
        In words.
    robots, pings : int
        How many, and how many pings of each.
    noise_std : float
        RMS of the complex baseband noise; an ideal point target at 1 m gives 1.
    position_std_m, yaw_std_rad : float
        Errors of reported poses.
    wander_s : float
        Time in which such an error is forgotten; 0: at once.
    """

    shown: str
    robots: int = 3
    pings: int = 200
    noise_std: float = 0.01
    position_std_m: float = 0.0
    yaw_std_rad: float = 0.0
    wander_s: float = 0.0


CONDITIONS = {
    "plain": Condition("three robots, 200 pings each"),
    "noisy": Condition("noise of 0.04", noise_std=0.04),
    "few_pings": Condition("30 pings a robot", pings=30),
    "one_robot": Condition("one robot", robots=1),
    "six_robots": Condition("six robots", robots=6),
    "poses_off": Condition("poses off by 3 cm and 0.6°", position_std_m=0.03, yaw_std_rad=0.01),
    "headings_off": Condition("poses off by 3 cm and 6°", position_std_m=0.03, yaw_std_rad=0.1),
    "poses_drift": Condition(
        "poses off by 3 cm and 3.4° that drift over 5 s",
        position_std_m=0.03,
        yaw_std_rad=0.06,
        wander_s=5.0,
    ),
}


@dataclass
class Plan:
    """A world as it is drawn: outlines, what stands inside, and where robots may start.

    Parameters
    ----------
    walls : list of (corners, closed)
        Outlines and partitions.
    poles, pillars : list of (x, y)
        Thin poles, and pillars of 10 to 25 cm.
    free : list of (x, y)
        Places with room for a robot.
    """

    walls: list[tuple[list[Point], bool]] = field(default_factory=list)
    poles: list[Point] = field(default_factory=list)
    pillars: list[Point] = field(default_factory=list)
    free: list[Point] = field(default_factory=list)


def scenario(kind: str, condition: str, seed: int, nav2_map: Path | None = None) -> Scenario:
    """One scene under one condition.

    Parameters
    ----------
    kind : str
        One of `KINDS`; ignored if a map is given.
    condition : str
        One of `CONDITIONS`.
    seed : int
        Of everything random.
    nav2_map : path, optional
        A map whose occupied cells are rough walls.
    """
    rng = np.random.default_rng([seed, *kind.encode()])
    if nav2_map is None:
        world, starts = KINDS[kind](rng)
    else:
        world, starts = of_map(nav2_map, ROUGH)
    recorded = CONDITIONS[condition]
    content = {
        "description": f"{kind}, {recorded.shown}",
        "seed": seed,
        "duration_s": recorded.pings / 10.0,
        "world": world,
        "medium": {"temperature_c": 20.0, "relative_humidity": 0.5},
        "robots": [
            robot(number, recorded, starts, speed_m_s=1.2 if "random_poles" in world else 0.6)
            for number in range(recorded.robots)
        ],
    }
    return Scenario.from_mapping(content, f"{kind}-{condition}-{seed}")


def robot(
    number: int, recorded: Condition, starts: list[Point], speed_m_s: float
) -> dict[str, Any]:
    """A robot that wanders, at ten pings a second."""
    motion: dict[str, Any] = {"kind": "random_walk", "speed_m_s": speed_m_s, "clearance_m": 0.25}
    if starts:
        x_m, y_m = starts[number % len(starts)]
        motion["start"] = [x_m, y_m, 2.4 * number]
    return {
        "name": f"robot{number + 1}",
        "motion": motion,
        "transducers": [{"receiver": {"noise_std": recorded.noise_std}}],
        "pose_error": {
            "position_std_m": recorded.position_std_m,
            "yaw_std_rad": recorded.yaw_std_rad,
            "wander_s": recorded.wander_s,
        },
    }


def poles(rng: np.random.Generator) -> tuple[World, list[Point]]:
    """Poles in the open."""
    side_m = float(rng.uniform(7.0, 10.0))
    count = int(rng.integers(18, 36))
    scattered = {"count": count, "separation_m": 0.4, "reflectivity_spread": 0.35}
    return {"area_m": [0.0, side_m, 0.0, side_m], "random_poles": scattered}, []


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


def built(
    draw: Callable[[np.random.Generator], Plan], surface: dict[str, float]
) -> Callable[[np.random.Generator], tuple[World, list[Point]]]:
    """A kind of scene from what draws its plan: turned by any angle, with walls of a surface."""

    def build(rng: np.random.Generator) -> tuple[World, list[Point]]:
        plan = draw(rng)
        angle = rng.uniform(-0.5, 0.5)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        shift = rng.uniform(-1.0, 1.0, 2)

        def moved(points: list[Point]) -> list[Point]:
            places = np.reshape(points, (-1, 2)) @ turn.T + shift
            return [(float(x_m), float(y_m)) for x_m, y_m in places]

        return {
            "surface": surface,
            "walls": [
                {"corners_m": moved(corners), "closed": closed} for corners, closed in plan.walls
            ],
            "points": [
                {"x_m": x_m, "y_m": y_m, "reflectivity": float(np.exp(rng.normal(0.0, 0.35)))}
                for x_m, y_m in moved(plan.poles)
            ],
            "cylinders": [
                {"x_m": x_m, "y_m": y_m, "radius_m": float(rng.uniform(0.1, 0.25))}
                for x_m, y_m in moved(plan.pillars)
            ],
        }, moved(plan.free)

    return build


def hall(rng: np.random.Generator) -> Plan:
    """An empty rectangle but for a few poles and a pillar."""
    width_m, height_m = rng.uniform(5.0, 6.5), rng.uniform(4.5, 6.0)
    plan = Plan([(_box(0.0, 0.0, width_m, height_m), True)])
    for _ in range(3):
        _place(plan.free, rng, (0.0, width_m, 0.0, height_m), [plan.free], 1.5)
    _furnish(plan, rng, (0.0, width_m, 0.0, height_m), poles=3, pillars=1)
    return plan


def moving(rng: np.random.Generator) -> tuple[World, list[Point]]:
    """A rough hall in which somebody walks from place to place."""
    world, starts = built(hall, ROUGH)(rng)
    walker = {"waypoints_m": starts, "speed_m_s": 0.8, "radius_m": 0.2, "reflectivity": 0.8}
    return {**world, "moving": [walker]}, starts


def of_map(path: Path, surface: dict[str, float]) -> tuple[World, list[Point]]:
    """The occupied cells of a nav2 map as walls; robots start on free ones."""
    return {"map": {"path": str(path.resolve()), "surface": surface}}, []


KINDS: dict[str, Callable[[np.random.Generator], tuple[World, list[Point]]]] = {
    "poles": poles,
    "clutter": built(clutter, ROUGH),
    "rough_rooms": built(room, ROUGH),
    "smooth_rooms": built(room, SMOOTH),
    "corridors": built(corridor, ROUGH),
    "corners": built(corners, ROUGH),
    "moving": moving,
    "flat_rough": lambda rng: of_map(FLAT, ROUGH),
    "flat_smooth": lambda rng: of_map(FLAT, SMOOTH),
}


def _box(left: float, low: float, right: float, high: float) -> list[Point]:
    return [(left, low), (right, low), (right, high), (left, high)]


def _furnish(
    plan: Plan,
    rng: np.random.Generator,
    area: tuple[float, float, float, float],
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
    area: tuple[float, float, float, float],
    others: list[list[Point]],
    apart_m: float,
) -> None:
    """Add a place in an area apart from others, if one is found."""
    low = np.array(area[0::2]) + MARGIN_M
    high = np.array(area[1::2]) - MARGIN_M
    taken: FloatArray = np.array([place for places in others for place in places]).reshape(-1, 2)
    for _ in range(200):
        x_m, y_m = rng.uniform(low, high)
        if np.all(np.hypot(*(taken - [x_m, y_m]).T) >= apart_m):
            things.append((float(x_m), float(y_m)))
            return
