"""What nav2's local costmap makes of the map and the ranges, and whether it boxes the robot in.

    python benchmarks/costmap.py [--scenario FILE] [-o PICTURE]

The costmap is that of ``config/nav2/costmaps.yaml``, fed as the nodes feed it.  nav2 itself needs a
ROS installation; here stand NumPy replicas of its layers, after nav2_costmap_2d (commit a3a97043):
``StaticLayer::interpretValue`` and ``updateCosts`` (static_layer.cpp, lines 282 and 441),
``RangeSensorLayer::gamma``, ``delta``, ``sensor_model``, ``update_cell`` and ``updateCosts``
(range_sensor_layer.cpp, lines 164 to 540), and ``ObstacleLayer::updateBounds`` and
``raytraceFreespace`` (obstacle_layer.cpp), which keeps what it has marked until a ray clears it:
without any ray, and with those of ``free_scan``.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image

from usmap_ros.grids import OccupancyMap, TruthMap
from usmap_ros.io.conversions import range_to_message
from usmap_ros.io.message_types import BagMessageTypes
from usmap_ros.mapping.candidates import candidate_cells
from usmap_ros.mapping.free_space import free_space
from usmap_ros.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate

ROOT = Path(__file__).parents[1]
LETHAL, FREE, UNKNOWN = 254, 0, 255
#: The costmap as it is shipped, and an obstacle layer that marks ``cone_cells``.
SHIPPED, UNCLEARED = "as shipped", "marks that nobody clears"
CLEARED = "marks that free_scan clears"
#: Of the robot; a lethal cell as near as that boxes it in.
ROBOT_RADIUS_M = 0.15


@dataclass
class RangeLayer:
    """``RangeSensorLayer`` on a fixed grid; a rolling window sees a part of the same cells."""

    shape: tuple[int, int]
    resolution_m: float
    settings: dict[str, Any]
    probability: Any = field(init=False)

    def __post_init__(self) -> None:
        self.probability = np.full(self.shape, 127, np.uint8)

    def take(self, message: Any, x_m: float, y_m: float, yaw_rad: float) -> None:
        """``processVariableRangeMsg`` and ``updateCostmap``, for all cells in reach."""
        if not message.min_range <= message.range <= message.max_range:
            return
        is_clear = message.range >= message.max_range and self.settings["clear_on_max_reading"]
        reach_m = 1.2 * message.range
        low = np.floor((np.array([y_m, x_m]) - reach_m) / self.resolution_m).astype(int)
        high = np.ceil((np.array([y_m, x_m]) + reach_m) / self.resolution_m).astype(int) + 1
        low, high = np.maximum(low, 0), np.minimum(high, self.shape)
        rows, columns = np.mgrid[low[0] : high[0], low[1] : high[1]]
        east_m = (columns + 0.5) * self.resolution_m - x_m
        north_m = (rows + 0.5) * self.resolution_m - y_m
        angle = (np.arctan2(north_m, east_m) - yaw_rad + np.pi) % (2.0 * np.pi) - np.pi
        far_m, half = np.hypot(east_m, north_m), 0.5 * message.field_of_view
        # inflate_cone is 1 by default: every cell in the bounds of the triangle is updated.
        sensor = (
            np.zeros_like(far_m) if is_clear else self._model(message.range, far_m, angle, half)
        )
        inside = (np.abs(angle) <= half) if is_clear else np.ones_like(far_m, bool)
        window = self.probability[low[0] : high[0], low[1] : high[1]]
        prior = window / LETHAL
        occupied = sensor * prior
        with np.errstate(invalid="ignore", divide="ignore"):
            new = occupied / (occupied + (1.0 - sensor) * (1.0 - prior))
        new = np.where(np.isfinite(new), new, prior)
        window[inside] = (new[inside] * LETHAL).astype(np.uint8)

    def _model(self, r: float, far_m: Any, angle: Any, half: float) -> Any:
        """``sensor_model``; its delta is the cell's side, and counts relative to the range."""
        weight = 0.5 * (1.0 - np.tanh(2.0 * (far_m - self.settings["phi"])))
        weight = weight * np.where(np.abs(angle) > half, 0.0, 1.0 - (angle / half) ** 2)
        depth_m = self.resolution_m * r
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
        marked = self.probability > int(self.settings["mark_threshold"] * LETHAL)
        cleared = self.probability < int(self.settings["clear_threshold"] * LETHAL)
        current = np.select([marked, cleared], [LETHAL, FREE], UNKNOWN).astype(np.uint8)
        known = current != UNKNOWN
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
class Shares:
    """Of the local costmap over time: what share of it is what, and whether the robot can move."""

    seconds: list[float] = field(default_factory=list)
    lethal: list[float] = field(default_factory=list)
    false_lethal: list[float] = field(default_factory=list)
    free: list[float] = field(default_factory=list)
    missed: list[float] = field(default_factory=list)
    boxed: list[bool] = field(default_factory=list)

    def add(self, second: float, master: Any, truth: TruthMap, x_m: float, y_m: float) -> None:
        """Take one cycle down: of the window of 6 m around the robot."""
        resolution_m = truth.geometry.resolution_m
        row, column = int(y_m / resolution_m), int(x_m / resolution_m)
        half = round(3.0 / resolution_m)
        part = np.s_[max(0, row - half) : row + half, max(0, column - half) : column + half]
        window, occupied = master[part], _grown(truth.occupied, 2)[part]
        lethal = window == LETHAL
        self.seconds.append(second)
        self.lethal.append(float(lethal.mean()))
        self.false_lethal.append(float((lethal & ~occupied).mean()))
        self.free.append(float((window == FREE).mean()))
        self.missed.append(
            float((truth.occupied[part] & (window == FREE)).sum())
            / max(1.0, float(truth.occupied[part].sum()))
        )
        near = round(ROBOT_RADIUS_M / resolution_m)
        close = np.s_[row - near : row + near + 1, column - near : column + near + 1]
        self.boxed.append(bool((master[close] == LETHAL).any() and not occupied_near(truth, close)))


def occupied_near(truth: TruthMap, part: Any) -> bool:
    """Whether something really stands there."""
    return bool(_grown(truth.occupied, 1)[part].any())


def _grown(cells: Any, by: int) -> Any:
    """Cells and their neighbours up to `by` cells away."""
    grown, steps = np.pad(cells, by), range(-by, by + 1)
    moved = [np.roll(grown, (rows, columns), (0, 1)) for rows in steps for columns in steps]
    return np.max(moved, axis=0)[by:-by, by:-by]


def layer_settings(file: Path = ROOT / "config/nav2/costmaps.yaml") -> dict[str, Any]:
    """Layers of the local costmap as they are shipped."""
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    settings: dict[str, Any] = content["local_costmap"]["local_costmap"]["ros__parameters"]
    return settings


def drive(
    scenario: Scenario, settings: dict[str, Any], robot: str = "robot1"
) -> tuple[dict[str, Shares], Any, TruthMap]:
    """Costmaps of one robot while the fleet maps: as shipped, and with an obstacle layer.

    Returns
    -------
    shares : dict of str to Shares
        Over time, at 5 Hz: as shipped, with marks that nobody clears, and with marks that rays do.
    master : array
        The last costmap that is shipped.
    truth : TruthMap
        What is there.
    """
    pipeline, types = Pipeline(), BagMessageTypes()
    resolution_m = pipeline.parameters.mapping.resolution_m
    truth = scenario.truth_map(resolution_m)
    origin_m = np.array(truth.geometry.origin_m)
    ranges = RangeLayer(truth.occupied.shape, resolution_m, settings["range_layer"])
    marks = {name: np.zeros(truth.occupied.shape, bool) for name in (UNCLEARED, CLEARED)}
    shares = {name: Shares() for name in (SHIPPED, UNCLEARED, CLEARED)}
    published: OccupancyMap | None = None
    next_map_ns = next_cycle_ns = scenario.start_ns
    master = np.full(truth.occupied.shape, UNKNOWN, np.uint8)
    for topic, trace in simulate(scenario):
        cone = pipeline.process(trace)
        if cone.stamp_ns >= next_map_ns:
            published, next_map_ns = pipeline.occupancy_map(), cone.stamp_ns + 10**9
        if not topic.startswith(f"/{robot}/"):
            continue
        x_m, y_m = cone.pose.position_m[:2] - origin_m
        ranges.take(range_to_message(cone, types), x_m, y_m, cone.pose.yaw_rad)
        _clear(marks[CLEARED], cone, pipeline, origin_m)
        for marked in marks.values():
            _mark(marked, cone, pipeline, origin_m)
        if cone.stamp_ns < next_cycle_ns:
            continue
        next_cycle_ns = cone.stamp_ns + 2 * 10**8
        second = (cone.stamp_ns - scenario.start_ns) / 1e9
        master = np.full(truth.occupied.shape, UNKNOWN, np.uint8)
        static_layer(_moved(published, origin_m), master)
        ranges.apply(master)
        shares[SHIPPED].add(second, master, truth, x_m, y_m)
        for name, marked in marks.items():
            costs = np.where(marked, LETHAL, FREE).astype(np.uint8)
            shares[name].add(second, costs, truth, x_m, y_m)
    return shares, master, truth


def _moved(occupancy: OccupancyMap | None, origin_m: Any) -> OccupancyMap | None:
    """The map on the grid of the truth, whose first cell need not be at the world's origin."""
    if occupancy is None:
        return None
    x, y = np.array(occupancy.geometry.origin_m) - origin_m
    return replace(occupancy, geometry=replace(occupancy.geometry, origin_m=(float(x), float(y))))


def _mark(marks: Any, cone: Any, pipeline: Pipeline, origin_m: Any) -> None:
    """``ObstacleLayer`` without clearing: candidate cells within 3 m stay marked."""
    mapping = pipeline.parameters.mapping
    cells = candidate_cells(cone, mapping)
    near = np.hypot(*(cells.centers_m - cone.pose.position_m[:2]).T) < 3.0
    offsets_m = cells.centers_m[near] - origin_m
    columns, rows = np.floor(offsets_m / mapping.resolution_m).astype(int).T
    inside = (rows >= 0) & (columns >= 0) & (rows < marks.shape[0]) & (columns < marks.shape[1])
    marks[rows[inside], columns[inside]] = True


def _clear(marks: Any, cone: Any, pipeline: Pipeline, origin_m: Any) -> None:
    """``raytraceFreespace``: cells on the rays of ``free_scan`` are free."""
    mapping = pipeline.parameters.mapping
    angles_rad, ranges_m = free_space(cone, mapping)
    x_m, y_m = cone.pose.position_m[:2] - origin_m
    for angle_rad, range_m in zip(angles_rad + cone.pose.yaw_rad, ranges_m, strict=True):
        along_m = np.arange(0.0, range_m, 0.5 * mapping.resolution_m)
        columns = ((x_m + along_m * np.cos(angle_rad)) / mapping.resolution_m).astype(int)
        rows = ((y_m + along_m * np.sin(angle_rad)) / mapping.resolution_m).astype(int)
        inside = (rows >= 0) & (columns >= 0) & (rows < marks.shape[0]) & (columns < marks.shape[1])
        marks[rows[inside], columns[inside]] = False


def main() -> None:
    """Drive through the fleet's room, print the shares, and draw them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", type=Path, default=ROOT / "config/scenarios/room.yaml")
    parser.add_argument("-o", "--output", type=Path, default=None)
    arguments = parser.parse_args()
    all_shares, master, truth = drive(Scenario.load(arguments.scenario), layer_settings())
    for name, shares in all_shares.items():
        print(f"{name}: lethal {np.mean(shares.lethal):.1%}, of it where nothing stands"
              f" {np.mean(shares.false_lethal):.1%}, free {np.mean(shares.free):.1%},"
              f" truth called free {np.mean(shares.missed):.1%},"
              f" boxed in {np.mean(shares.boxed):.0%} of {len(shares.boxed)} cycles")  # fmt: skip
    if arguments.output is not None:
        _draw(arguments.output, all_shares, master, truth)


def _draw(path: Path, shares: dict[str, Shares], master: Any, truth: TruthMap) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
    shipped, uncleared, cleared = shares.values()
    left.plot(shipped.seconds, shipped.free, color="tab:green", label="free")
    left.plot(shipped.seconds, shipped.lethal, color="tab:red", label="lethal")
    left.plot(shipped.seconds, shipped.false_lethal, "k:", label="lethal where nothing stands")
    left.plot(
        uncleared.seconds, uncleared.lethal, "--", color="tab:gray", label="lethal, uncleared"
    )
    left.plot(cleared.seconds, cleared.lethal, "-.", color="tab:gray", label="lethal, cleared")
    left.set(xlabel="time (s)", ylabel="share of the local costmap", ylim=(0.0, 1.0))
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower left", ncols=5)
    shades = np.select([master == LETHAL, master == FREE], [0, 255], 190)
    extent = truth.geometry.extent_m
    right.imshow(shades, cmap="gray", origin="lower", extent=extent, vmin=0, vmax=255)
    rows, columns = np.nonzero(truth.occupied)
    right.plot(*truth.geometry.cell_centers_m(rows, columns).T, "r.", markersize=0.8)
    right.set(xlabel="x (m)", ylabel="y (m)", title="costmap at the end; red: what stands there")
    figure.savefig(path, dpi=110)
    with Image.open(path) as image:
        image.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


if __name__ == "__main__":
    main()
