"""What nav2's local costmap makes of the map and the ranges, and whether it boxes the robot in.

    python benchmarks/costmap.py [--scenario FILE] [-o PICTURE]

The costmap is that of ``config/nav2/costmaps.yaml``, fed as the nodes feed it, through the replicas
of nav2's layers in `nav2_layers`.  Beside it stands an obstacle layer on ``cone_cells``: without
any ray, and with those of ``free_scan``.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from nav2_layers import (
    FREE,
    LETHAL,
    ROBOT_RADIUS_M,
    UNKNOWN,
    ObstacleLayer,
    RangeLayer,
    Window,
    static_layer,
)
from PIL import Image

from usmap_ros.grids import OccupancyMap, TruthMap
from usmap_ros.io.conversions import range_to_message
from usmap_ros.io.message_types import BagMessageTypes
from usmap_ros.pings.cone import EchoCone
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate

ROOT = Path(__file__).parents[1]
#: The costmap as it is shipped, and an obstacle layer that marks ``cone_cells``.
SHIPPED, UNCLEARED = "as shipped", "marks that nobody clears"
CLEARED = "marks that free_scan clears"


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
    truth = scenario.truth_map(settings["resolution"])
    origin_m = np.array(truth.geometry.origin_m)
    ranges = RangeLayer(_window(settings, 127), settings["range_layer"])
    marks = {name: ObstacleLayer(_window(settings, UNKNOWN)) for name in (UNCLEARED, CLEARED)}
    shares = {name: Shares() for name in (SHIPPED, UNCLEARED, CLEARED)}
    published: OccupancyMap | None = None
    next_map_ns = next_cycle_ns = scenario.start_ns
    master, waiting = np.full(truth.occupied.shape, UNKNOWN, np.uint8), list[EchoCone]()
    for topic, trace in simulate(scenario):
        cone = pipeline.process(trace)
        if cone.stamp_ns >= next_map_ns:
            published, next_map_ns = pipeline.occupancy_map(), cone.stamp_ns + 10**9
        if not topic.startswith(f"/{robot}/"):
            continue
        waiting.append(cone)
        if cone.stamp_ns < next_cycle_ns:
            continue
        next_cycle_ns = cone.stamp_ns + 2 * 10**8
        second, place_m = (cone.stamp_ns - scenario.start_ns) / 1e9, _place_m(cone, origin_m)
        ranges.window.roll(place_m)
        for heard in waiting:
            message = range_to_message(heard, types)
            ranges.take(message, _place_m(heard, origin_m), heard.pose.yaw_rad)
        waiting.clear()
        master = np.full(truth.occupied.shape, UNKNOWN, np.uint8)
        static_layer(_moved(published, origin_m), master)
        ranges.apply(master)
        shares[SHIPPED].add(second, master, truth, *place_m)
        for name, layer in marks.items():
            layer.take(cone, pipeline.parameters.mapping, origin_m, has_rays=name == CLEARED)
            shares[name].add(second, layer.window.spread(truth.occupied.shape), truth, *place_m)
    return shares, master, truth


def _window(settings: dict[str, Any], default: int) -> Window:
    cells = int(settings["width"] / settings["resolution"])
    return Window(settings["resolution"], cells, default)


def _place_m(cone: EchoCone, origin_m: Any) -> Any:
    """Where a ping was made, on the grid of the truth."""
    return cone.pose.position_m[:2] - origin_m


def _moved(occupancy: OccupancyMap | None, origin_m: Any) -> OccupancyMap | None:
    """The map on the grid of the truth, whose first cell need not be at the world's origin."""
    if occupancy is None:
        return None
    x, y = np.array(occupancy.geometry.origin_m) - origin_m
    return replace(occupancy, geometry=replace(occupancy.geometry, origin_m=(float(x), float(y))))


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
