"""NumPy replicas of the layers of nav2's costmaps, for machines without nav2.

After nav2_costmap_2d, branch jazzy, commit f4108e5b:

- `Window`: ``Costmap2D::updateOrigin`` and ``worldToMapNoBounds`` (costmap_2d.cpp);
- `static_layer`: ``StaticLayer::interpretValue`` and ``updateCosts`` (static_layer.cpp);
- `RangeLayer`: ``RangeSensorLayer::updateCostmap``, ``sensor_model``, ``update_cell`` and
  ``updateCosts`` (range_sensor_layer.cpp);
- `ObstacleLayer`: ``ObstacleLayer::updateBounds``, ``raytraceFreespace`` and ``updateFootprint``
  (obstacle_layer.cpp), with one observation a cycle, as ``observation_persistence: 0.0`` has it.

Fed with the same messages, the first three give what nav2's own code gives: ``docs/integration.md``
has the figures.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from usmap_ros.grids import OccupancyMap
from usmap_ros.mapping.candidates import candidate_cells
from usmap_ros.mapping.free_scan import free_scan
from usmap_ros.numerics.geometry import wrapped
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

LETHAL, FREE, UNKNOWN = 254, 0, 255
#: Of the robot; a lethal cell as near as that boxes it in.
ROBOT_RADIUS_M = 0.15
#: nav2's defaults of ``obstacle_max_range`` and ``raytrace_max_range``.
OBSTACLE_RANGE_M, RAYTRACE_RANGE_M = 2.5, 3.0


@dataclass
class Window:
    """Costs of the cells of a costmap that rolls along with the robot (``Costmap2D``).

    Its cells are aligned with those of the world, whose first cell has its corner at the origin.
    """

    resolution_m: float
    cells: int
    default: int
    corner: Any = field(init=False)
    values: Any = field(init=False)

    def __post_init__(self) -> None:
        self.corner = np.zeros(2, int)
        self.values = np.full((self.cells, self.cells), self.default, np.uint8)

    def roll(self, place_m: Any) -> None:
        """``updateOrigin``: move on by whole cells, and forget what is left behind."""
        lowest_m = np.asarray(place_m) - 0.5 * self.cells * self.resolution_m
        steps = ((lowest_m - self.corner * self.resolution_m) / self.resolution_m).astype(int)
        before, self.values = self.values, np.full_like(self.values, self.default)
        if np.all(np.abs(steps) < self.cells):
            (old_x, new_x), (old_y, new_y) = (
                (slice(max(0, step), self.cells + min(0, step)),
                 slice(max(0, -step), self.cells - max(0, step)))
                for step in steps
            )  # fmt: skip
            self.values[new_y, new_x] = before[old_y, old_x]
        self.corner = self.corner + steps

    def cell(self, place_m: Any) -> Any:
        """Column and row that a place is in, in the window or not (``worldToMapNoBounds``)."""
        offset_m = np.asarray(place_m) - self.corner * self.resolution_m
        return (offset_m / self.resolution_m).astype(int)

    def spread(self, shape: tuple[int, int]) -> Any:
        """The same on the whole grid, unknown outside of the window."""
        whole = np.full(shape, UNKNOWN, np.uint8)
        left, bottom = np.maximum(self.corner, 0)
        right, top = np.minimum(self.corner + self.cells, shape[::-1])
        x, y = self.corner
        whole[bottom:top, left:right] = self.values[bottom - y : top - y, left - x : right - x]
        return whole


@dataclass
class RangeLayer:
    """``RangeSensorLayer`` with its settings; each cell has the probability of being occupied."""

    window: Window
    settings: dict[str, Any]

    def take(self, message: Any, place_m: Any, yaw_rad: float) -> None:
        """``processVariableRangeMsg`` and ``updateCostmap``."""
        range_m, half = float(np.float32(message.range)), 0.5 * float(message.field_of_view)
        if not message.min_range <= message.range <= message.max_range:
            return
        is_clear = message.range >= message.max_range and self.settings["clear_on_max_reading"]
        place_m = np.asarray(place_m)
        directions = yaw_rad + np.array([0.0, -half, half])
        reach_m = range_m * np.array([1.0, 1.2, 1.2])[:, None]
        ends_m = place_m + reach_m * np.stack([np.cos(directions), np.sin(directions)], axis=-1)
        target, *sides = (self.window.cell(end_m) for end_m in ends_m)
        if np.all((target >= 0) & (target < self.window.cells)):
            self.window.values[target[1], target[0]] = 233
        corners = np.array([*sides, self.window.cell(place_m)])
        low = np.maximum(corners.min(axis=0), 0)
        high = np.minimum(corners.max(axis=0) + 1, self.window.cells)
        rows, columns = np.mgrid[low[1] : high[1], low[0] : high[0]]
        # `inflate_cone` is 1 by default: every cell of the box about the cone is updated.
        self._update(rows.ravel(), columns.ravel(), place_m, yaw_rad, range_m, half, is_clear)

    def _update(
        self, rows: Any, columns: Any, place_m: Any, yaw_rad: float, r: float, half: float,
        is_clear: bool,
    ) -> None:  # fmt: skip
        """``update_cell``."""
        resolution_m = self.window.resolution_m
        centers = np.stack([columns, rows], axis=-1) + self.window.corner + 0.5
        east_m, north_m = (centers * resolution_m - place_m).T
        angle = wrapped(np.arctan2(north_m, east_m) - yaw_rad)
        far_m = np.hypot(east_m, north_m)
        sensor = np.zeros_like(far_m) if is_clear else self._model(r, far_m, angle, half)
        prior = self.window.values[rows, columns] / LETHAL
        occupied = sensor * prior
        with np.errstate(invalid="ignore"):
            new = occupied / (occupied + (1.0 - sensor) * (1.0 - prior))
        self.window.values[rows, columns] = np.nan_to_num(new * LETHAL).astype(np.uint8)

    def _model(self, r: float, far_m: Any, angle: Any, half: float) -> Any:
        """``sensor_model``; its delta is the cell's side, and counts relative to the range."""
        weight = 0.5 * (1.0 - np.tanh(2.0 * (far_m - self.settings["phi"])))
        weight = weight * np.where(np.abs(angle) > half, 0.0, 1.0 - (angle / half) ** 2)
        depth_m = self.window.resolution_m * r
        near = (1.0 - weight) * 0.5
        rising = weight * 0.5 * ((far_m - (r - 2.0 * depth_m)) / depth_m) ** 2 + near
        hit = weight * (0.5 - 0.5 * ((r - far_m) / depth_m) ** 2) + 0.5
        return np.select(
            [far_m < r - 2.0 * depth_m, far_m < r - depth_m, far_m < r + depth_m],
            [near, rising, hit],
            0.5,
        )

    def apply(self, master: Any) -> None:
        """``updateCosts``: what is above one threshold is lethal, below the other free."""
        probability = self.window.spread(master.shape)
        marked = probability > int(self.settings["mark_threshold"] * LETHAL)
        cleared = probability < int(self.settings["clear_threshold"] * LETHAL)
        current = np.select([marked, cleared], [LETHAL, FREE], UNKNOWN).astype(np.uint8)
        known = (probability != UNKNOWN) & (current != UNKNOWN)
        higher = known & ((master == UNKNOWN) | (master < current))
        master[higher] = current[higher]


def static_layer(occupancy: OccupancyMap | None, master: Any) -> None:
    """``StaticLayer`` with ``track_unknown_space``: it writes over the whole of the map."""
    if occupancy is None:
        return
    costs = np.select(
        [occupancy.trinary() == 100, occupancy.trinary() == 0], [LETHAL, FREE], UNKNOWN
    )
    left, bottom = occupancy.geometry.first_cell
    rows, columns = np.nonzero(costs != UNKNOWN)
    row, column = rows + bottom, columns + left
    inside = (row >= 0) & (column >= 0) & (row < master.shape[0]) & (column < master.shape[1])
    master[row[inside], column[inside]] = costs[rows[inside], columns[inside]]


@dataclass
class ObstacleLayer:
    """``ObstacleLayer``: what it has marked stays, until a ray or the robot goes through it."""

    window: Window

    def take(
        self, cone: EchoCone, parameters: MappingParameters, origin_m: Any, *, has_rays: bool
    ) -> None:
        """``updateBounds`` and ``updateCosts``, with the newest ping's cells."""
        place_m = cone.pose.position_m[:2] - origin_m
        self.window.roll(place_m)
        if has_rays:
            angles_rad, ranges_m = free_scan(cone, parameters)
            headings_rad, step_m = angles_rad + cone.pose.yaw_rad, 0.5 * self.window.resolution_m
            for heading_rad, range_m in zip(headings_rad, ranges_m, strict=True):
                along_m = np.arange(0.0, min(range_m, RAYTRACE_RANGE_M), step_m)[:, None]
                direction = np.array([np.cos(heading_rad), np.sin(heading_rad)])
                self._set(place_m + along_m * direction, FREE)
        centers_m = candidate_cells(cone, parameters).centers_m
        far_m = np.hypot(*(centers_m - cone.pose.position_m[:2]).T)
        self._set(centers_m[far_m <= OBSTACLE_RANGE_M] - origin_m, LETHAL)
        # The robot's footprint is cleared: where it is, nothing stands.
        steps = np.arange(-ROBOT_RADIUS_M, ROBOT_RADIUS_M, 0.5 * self.window.resolution_m)
        about_m = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        self._set(place_m + about_m[np.hypot(*about_m.T) < ROBOT_RADIUS_M], FREE)

    def _set(self, places_m: Any, cost: int) -> None:
        columns, rows = self.window.cell(places_m).T
        inside = (np.minimum(rows, columns) >= 0) & (np.maximum(rows, columns) < self.window.cells)
        self.window.values[rows[inside], columns[inside]] = cost
