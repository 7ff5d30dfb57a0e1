"""Random worlds to judge maps by, made otherwise than the scenarios that parameters were chosen on.

A kind, a condition and a seed give the same scenario every time.  `plans` draws what has walls;
most of it is turned and stands off the grid.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plans import (
    Plan,
    Point,
    arena,
    clutter,
    columns,
    corners,
    corridor,
    depot,
    hall,
    room,
    swarm_room,
    symmetric,
    two_rooms,
    warehouse,
)

from usmap_ros.simulation import Scenario

FloatArray = NDArray[np.float64]
#: Of a world's section in a scenario file.
World = dict[str, Any]
#: Draws a world, and where robots start in it; empty: anywhere.
Draw = Callable[[np.random.Generator], tuple[World, list[Point]]]

ROOT = Path(__file__).parent.parent
FLAT = ROOT / "config" / "maps" / "flat.yaml"
#: nav2's small world, which is not part of this repository: where tests look for others' maps, too.
SANDBOX = Path(os.environ.get("USMAP_SHARED", ROOT.parent / "shared")) / "maps" / "tb3_sandbox.yaml"
ROUGH = {"specular_reflectivity": 0.1, "diffuse_reflectivity": 5.0, "scatterers_per_m": 20.0}
SMOOTH = {"specular_reflectivity": 0.5, "diffuse_reflectivity": 0.3, "scatterers_per_m": 20.0}
PANE = {"specular_reflectivity": 0.9, "diffuse_reflectivity": 0.1, "scatterers_per_m": 20.0}
#: Angles by which rooms are turned against the map's grid, if not at all or by any.
SLIGHTLY_RAD, NOT_AT_ALL_RAD, ANYHOW_RAD = (-0.5, 0.5), (0.0, 0.0), (0.0, 0.5 * np.pi)
#: Directions in which a small robot of a swarm measures ranges, and half the angle of each beam.
RANGE_YAWS_RAD, RANGE_HALF_ANGLE_RAD = (0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi), np.deg2rad(22.5)


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
    floor_reflectivity : float
        Of a floor half a metre below the transducers; 0: there is none.
    parked_s : float
        How long each robot stands and pings before it drives; not counted in `pings`.
    sensor : str
        ``sonar``: echo traces.  ``ranges``: sensors that measure ranges only, as
        ``sensor_msgs/Range`` has them, four on each robot.  ``range_traces``: the same readings
        as traces with one pulse.  ``first_echoes``: of echo traces, the first echo of each as
        ``sensor_msgs/Range`` has it.
    stated_sound_speed_m_s : float, optional
        If it is not that of air of 20 °C.
    latency_s, pose_late_s : float
        How much later than they say traces begin, and before their stamps poses were true.
    """

    shown: str
    robots: int = 3
    pings: int = 200
    noise_std: float = 0.01
    position_std_m: float = 0.0
    yaw_std_rad: float = 0.0
    wander_s: float = 0.0
    floor_reflectivity: float = 0.0
    parked_s: float = 0.0
    sensor: str = "sonar"
    stated_sound_speed_m_s: float | None = None
    latency_s: float = 0.0
    pose_late_s: float = 0.0


#: Sensors that hear echo traces, whatever they tell of them.
SONARS = ("sonar", "first_echoes")
CONDITIONS = {
    "plain": Condition("three robots, 200 pings each"),
    "noisy": Condition("noise of 0.04", noise_std=0.04),
    "many_pings": Condition("500 pings a robot", pings=500),
    "few_pings": Condition("30 pings a robot", pings=30),
    "100_pings": Condition("100 pings a robot", pings=100),
    "100_noisy": Condition("100 pings, noise of 0.04", pings=100, noise_std=0.04),
    "100_poses_off": Condition(
        "100 pings, poses off by 3 cm and 0.6°", pings=100, position_std_m=0.03, yaw_std_rad=0.01
    ),
    "100_floor": Condition("100 pings, a floor", pings=100, floor_reflectivity=0.6),
    "100_parked": Condition("100 pings after 30 s of standing", pings=100, parked_s=30.0),
    "sound_off": Condition("sound 2 % slower than stated", stated_sound_speed_m_s=350.1),
    "poses_late": Condition("poses told 0.1 s late", pose_late_s=0.1),
    "told_late": Condition("traces that begin 0.3 ms late", latency_s=0.0003),
    "floor": Condition("a floor", floor_reflectivity=0.6),
    "parked": Condition("30 s of standing first", parked_s=30.0),
    "ranges": Condition("range readings alone", robots=5, pings=120, sensor="ranges"),
    "range_traces": Condition(
        "range readings as traces", robots=5, pings=120, sensor="range_traces"
    ),
    "first_echoes": Condition("first echoes alone", sensor="first_echoes"),
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


def scenario(kind: str, condition: str, seed: int, nav2_map: Path | None = None) -> Scenario:
    """One scene under one condition.

    Parameters
    ----------
    kind : str
        One of `KINDS` or `UNSCORED`; ignored if a map is given.
    condition : str
        One of `CONDITIONS`.
    seed : int
        Of everything random.
    nav2_map : path, optional
        A map whose occupied cells are rough walls.
    """
    rng = np.random.default_rng([seed, *kind.encode()])
    if nav2_map is None:
        world, starts = (KINDS | UNSCORED)[kind](rng)
    else:
        world, starts = of_map(nav2_map, ROUGH)
    recorded = CONDITIONS[condition]
    medium = {"temperature_c": 20.0, "relative_humidity": 0.5}
    if recorded.floor_reflectivity:
        medium["floor_reflectivity"] = recorded.floor_reflectivity
    content = {
        "description": f"{kind}, {recorded.shown}",
        "seed": seed,
        "duration_s": recorded.parked_s + recorded.pings / 10.0,
        "world": world,
        "medium": medium,
        "robots": [
            robot(number, recorded, starts, speed_m_s=1.2 if "random_poles" in world else 0.6)
            for number in range(recorded.robots)
        ],
    }
    if recorded.stated_sound_speed_m_s is not None:
        content["stated"] = {"sound_speed_m_s": recorded.stated_sound_speed_m_s}
    return Scenario.from_mapping(content, f"{kind}-{condition}-{seed}")


def robot(
    number: int, recorded: Condition, starts: list[Point], speed_m_s: float
) -> dict[str, Any]:
    """A robot that wanders, at ten pings a second."""
    motion: dict[str, Any] = {"kind": "random_walk", "speed_m_s": speed_m_s, "clearance_m": 0.25}
    if starts:
        x_m, y_m = starts[number % len(starts)]
        motion["start"] = [x_m, y_m, 2.4 * number]
    if recorded.sensor not in SONARS:
        motion |= {"speed_m_s": 0.4, "clearance_m": 0.12}
    return {
        "name": f"robot{number + 1}",
        "motion": motion,
        "transducers": transducers(recorded),
        "starts_after_s": recorded.parked_s,
        "pose_error": {
            "position_std_m": recorded.position_std_m,
            "yaw_std_rad": recorded.yaw_std_rad,
            "wander_s": recorded.wander_s,
            "late_s": recorded.pose_late_s,
        },
    }


def transducers(recorded: Condition) -> list[dict[str, Any]]:
    """What a robot carries: a sonar, or range sensors all around."""
    if recorded.sensor in SONARS:
        receiver = {"noise_std": recorded.noise_std, "latency_s": recorded.latency_s}
        sonar: dict[str, Any] = {"receiver": receiver}
        if recorded.floor_reflectivity:
            sonar["mount"] = {"z_m": 0.5}
        return [sonar]
    beam = {"kind": "linear", "half_angle_rad": float(RANGE_HALF_ANGLE_RAD)}
    return [
        {"name": f"range{number + 1}", "mount": {"yaw_rad": yaw_rad}, "beam": beam,
         "min_range_m": 0.02, "max_range_m": 4.0}
        for number, yaw_rad in enumerate(RANGE_YAWS_RAD)
    ]  # fmt: skip


def poles(rng: np.random.Generator) -> tuple[World, list[Point]]:
    """Poles in the open."""
    side_m = float(rng.uniform(7.0, 10.0))
    count = int(rng.integers(18, 36))
    scattered = {"count": count, "separation_m": 0.4, "reflectivity_spread": 0.35}
    return {"area_m": [0.0, side_m, 0.0, side_m], "random_poles": scattered}, []


def built(
    draw: Callable[[np.random.Generator], Plan],
    surface: dict[str, float],
    turned_rad: tuple[float, float] = SLIGHTLY_RAD,
) -> Draw:
    """A kind of scene from what draws its plan: turned by some angle, with walls of a surface."""

    def build(rng: np.random.Generator) -> tuple[World, list[Point]]:
        plan = draw(rng)
        angle = rng.uniform(*turned_rad)
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
            ]
            + [
                {"x_m": x_m, "y_m": y_m, "radius_m": radius_m}
                for (x_m, y_m), (_, _, radius_m) in zip(
                    moved([column[:2] for column in plan.columns]), plan.columns, strict=True
                )
            ],
        }, moved(plan.free)

    return build


def moving(rng: np.random.Generator) -> tuple[World, list[Point]]:
    """A rough hall in which somebody walks from place to place."""
    world, starts = built(hall, ROUGH)(rng)
    walker = {"waypoints_m": starts, "speed_m_s": 0.8, "radius_m": 0.2, "reflectivity": 0.8}
    return {**world, "moving": [walker]}, starts


def mixed(rng: np.random.Generator) -> tuple[World, list[Point]]:
    """A rough room beside a smooth one."""
    world, starts = built(two_rooms, ROUGH)(rng)
    world["walls"][1]["surface"] = SMOOTH
    return world, starts


def panes(rng: np.random.Generator) -> tuple[World, list[Point]]:
    """A room turned anyhow, each wall of which is rough, smooth, or nearly all mirror."""
    world, starts = built(room, ROUGH, ANYHOW_RAD)(rng)
    sides = [
        [corners[number - 1], corners[number]]
        for corners, closed in ((wall["corners_m"], wall["closed"]) for wall in world["walls"])
        for number in range(0 if closed else 1, len(corners))
    ]
    kinds = ROUGH, SMOOTH, PANE
    walls = [{"corners_m": side, "surface": kinds[rng.integers(len(kinds))]} for side in sides]
    return {**world, "walls": walls}, starts


def of_map(path: Path, surface: dict[str, float]) -> tuple[World, list[Point]]:
    """The occupied cells of a nav2 map as walls; robots start on free ones."""
    return {"map": {"path": str(path.resolve()), "surface": surface}}, []


KINDS: dict[str, Draw] = {
    "poles": poles,
    "clutter": built(clutter, ROUGH),
    "rough_rooms": built(room, ROUGH),
    "smooth_rooms": built(room, SMOOTH),
    "corridors": built(corridor, ROUGH),
    "corners": built(corners, ROUGH),
    "mixed": mixed,
    "panes": panes,
    "moving": moving,
    "flat_rough": lambda rng: of_map(FLAT, ROUGH),
    "flat_smooth": lambda rng: of_map(FLAT, SMOOTH),
    "columns_rough": built(columns, ROUGH, NOT_AT_ALL_RAD),
    "columns_smooth": built(columns, SMOOTH, NOT_AT_ALL_RAD),
    "turned_rough": built(room, ROUGH, ANYHOW_RAD),
    "turned_smooth": built(room, SMOOTH, ANYHOW_RAD),
    "depot": built(depot, ROUGH),
    "warehouse": built(warehouse, ROUGH),
    "arena": built(arena, ROUGH),
    "swarm": built(swarm_room, ROUGH),
}
#: Of robots that are to be joined, and of no score.
UNSCORED: dict[str, Draw] = {"symmetric": built(symmetric, ROUGH)}
if SANDBOX.is_file():
    KINDS["sandbox"] = lambda rng: of_map(SANDBOX, ROUGH)
