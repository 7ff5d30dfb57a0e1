"""A planner's path over the map of the demo's room, from one side of the partition to the other.

    python benchmarks/planner.py [--scenario FILE] [--start X Y] [--goal X Y] [-o PICTURE]

The global costmap is that of ``config/nav2/costmaps.yaml``.  nav2 itself needs a ROS installation;
here stand NumPy replicas: ``StaticLayer`` of `nav2_layers`, ``InflationLayer::computeCost``
(inflation_layer.hpp), and the costs of ``NavFn`` (navfn.hpp: ``COST_NEUTRAL``, ``COST_FACTOR``;
navfn.cpp: ``setCostmap``), whose potential is that of Dijkstra's algorithm, here by cells.
"""

from __future__ import annotations

import argparse
import heapq
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from costmap import ROOT
from nav2_layers import FREE, LETHAL, ROBOT_RADIUS_M, UNKNOWN, static_layer
from PIL import Image
from scipy.ndimage import distance_transform_edt

from usmap_ros.grids import OccupancyMap, TruthMap
from usmap_ros.plotting import style
from usmap_ros.plotting.map import map_figure
from usmap_ros.plotting.style import save_figure
from usmap_ros.runs.trial import Trial, try_scenario
from usmap_ros.simulation import Scenario

#: As in nav2: cost of a cell that the robot's inscribed circle would touch something from, and
#: what each cell costs a path.
INSCRIBED, COST_NEUTRAL, COST_FACTOR = 253, 50, 0.8
_NEIGHBOURS = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column]


class NoPathError(Exception):
    """The goal cannot be reached."""


def global_costmap(occupancy: OccupancyMap, file: Path = ROOT / "config/nav2/costmaps.yaml") -> Any:
    """Costs of the map's cells as shipped: the static layer, and inflation around its marks."""
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    layer = content["global_costmap"]["global_costmap"]["ros__parameters"]["inflation_layer"]
    costs = np.full(occupancy.geometry.shape, UNKNOWN, np.uint8)
    static_layer(_at_origin(occupancy), costs)
    resolution_m = occupancy.geometry.resolution_m
    cells = distance_transform_edt(costs != LETHAL)
    # nav2 makes a polygon of 16 corners of the radius, and of that takes the inscribed circle.
    beyond_m = cells * resolution_m - ROBOT_RADIUS_M * np.cos(np.pi / 16)
    falling = np.exp(-layer["cost_scaling_factor"] * beyond_m)
    inflated = np.where(beyond_m <= 0.0, INSCRIBED, np.floor((INSCRIBED - 1) * falling))
    inflated[cells > np.ceil(layer["inflation_radius"] / resolution_m)] = FREE
    inflated[cells == 0.0] = LETHAL
    # Inflation leaves what is unknown unknown, unless the robot would touch something there.
    is_raised = np.where(costs == UNKNOWN, inflated >= INSCRIBED, inflated > costs)
    return np.where(is_raised, inflated, costs).astype(np.uint8)


def _at_origin(occupancy: OccupancyMap) -> OccupancyMap:
    """The same map with its first cell at the origin, where the costmap has its own."""
    geometry = replace(occupancy.geometry, origin_m=(0.0, 0.0))
    return replace(occupancy, geometry=geometry)


def plan(
    occupancy: OccupancyMap, start_m: tuple[float, float], goal_m: tuple[float, float]
) -> np.ndarray[Any, Any]:
    """Cheapest path over a map, (cells, 2) in metres.

    Raises
    ------
    NoPathError
        If there is none.
    """
    costs = global_costmap(occupancy).astype(float)
    # What is unknown may be crossed, and costs more than anything that may.
    step = np.where(costs == UNKNOWN, INSCRIBED, COST_NEUTRAL + COST_FACTOR * costs)
    step[(costs >= INSCRIBED) & (costs != UNKNOWN)] = np.inf
    origin_m, resolution_m = occupancy.geometry.origin_m, occupancy.geometry.resolution_m
    start, goal = (
        tuple(int(cell) for cell in np.floor((np.array(place) - origin_m) / resolution_m)[::-1])
        for place in (start_m, goal_m)
    )
    for cell, place in ((start, start_m), (goal, goal_m)):
        if not (0 <= cell[0] < step.shape[0] and 0 <= cell[1] < step.shape[1]):
            raise NoPathError(f"({place[0]:g}, {place[1]:g}) m lies outside of the map")
    found = _cheapest(step, start, goal)
    if not found:
        ends = " to ".join(f"({place[0]:g}, {place[1]:g}) m" for place in (start_m, goal_m))
        raise NoPathError(f"no path leads from {ends}: something stands in every way")
    rows, columns = np.array(found).T
    return occupancy.geometry.cell_centers_m(rows, columns)


def _cheapest(
    step: np.ndarray[Any, Any], start: tuple[int, ...], goal: tuple[int, ...]
) -> list[tuple[int, ...]]:
    """Cells from start to goal, by Dijkstra's algorithm; none if there is no way."""
    potential = np.full(step.shape, np.inf)
    before: dict[tuple[int, ...], tuple[int, ...]] = {}
    potential[start] = 0.0
    waiting = [(0.0, start)]
    while waiting:
        cost, cell = heapq.heappop(waiting)
        if cell == goal:
            path = [goal]
            while path[-1] != start:
                path.append(before[path[-1]])
            return path[::-1]
        if cost > potential[cell]:
            continue
        for down, right in _NEIGHBOURS:
            beside = (cell[0] + down, cell[1] + right)
            if not (0 <= beside[0] < step.shape[0] and 0 <= beside[1] < step.shape[1]):
                continue
            there = cost + step[beside] * float(np.hypot(down, right))
            if there < potential[beside]:
                potential[beside], before[beside] = there, cell
                heapq.heappush(waiting, (there, beside))
    return []


def length_m(path_m: np.ndarray[Any, Any]) -> float:
    """Length of a path."""
    return float(np.hypot(*np.diff(path_m, axis=0).T).sum())


def clearance_m(path_m: np.ndarray[Any, Any], truth: TruthMap) -> float:
    """Least distance from a path to the centre of a cell in which something really stands."""
    rows, columns = np.nonzero(truth.occupied)
    standing_m = truth.geometry.cell_centers_m(rows, columns)
    return float(np.hypot(*(path_m[:, None] - standing_m).transpose(2, 0, 1)).min())


def main() -> None:
    """Map the room, plan through it, print what the path is like, and draw it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", type=Path, default=ROOT / "config/scenarios/room.yaml")
    parser.add_argument("--start", type=float, nargs=2, default=(1.0, 4.8), metavar=("X", "Y"))
    parser.add_argument("--goal", type=float, nargs=2, default=(6.8, 5.0), metavar=("X", "Y"))
    parser.add_argument("-o", "--output", type=Path, default=None)
    arguments = parser.parse_args()
    trial = try_scenario(Scenario.load(arguments.scenario))
    try:
        path_m = plan(trial.occupancy, tuple(arguments.start), tuple(arguments.goal))
    except NoPathError as error:
        sys.exit(f"planner: {error}")
    print(
        f"{length_m(path_m):.2f} m long, at least {clearance_m(path_m, trial.truth):.2f} m from"
        " the centres of all cells in which something stands"
    )
    if arguments.output is not None:
        _draw(arguments.output, trial, path_m)


def _draw(file: Path, trial: Trial, path_m: np.ndarray[Any, Any]) -> None:
    figure = map_figure(trial.occupancy, None, trial.truth, "A planner's path over the map")
    axes = figure.axes[0]
    with style.styled():
        axes.plot(*path_m.T, color=style.ROBOTS[0], linewidth=2.0)
        axes.plot(*path_m[0], "o", color=style.ROBOTS[0])
        axes.plot(*path_m[-1], "*", color=style.ROBOTS[0], markersize=12)
    save_figure(figure, file)
    with Image.open(file) as image:
        image.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(file, optimize=True)


if __name__ == "__main__":
    main()
