"""Areas that are too large for one worker, divided into tiles.

Each tile is mapped of all pings that reach it, with what stands around it, and cut out of the map
of these.  So tiles need nothing from each other, and each cell is in one of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from usmap_ros.grids import GridGeometry, OccupancyMap
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.pings.cone import EchoCone

#: Pings count that come within so much of a tile: farther than gaps in walls are bridged.
MARGIN_M = 2.0
#: Lowest x and y, and highest x and y.
Box = tuple[float, float, float, float]


class Tile(NamedTuple):
    """A rectangle of an area; the outer ones have no end, and one alone has none at all."""

    #: Lowest x and y, and highest x and y.
    west_m: float = -math.inf
    south_m: float = -math.inf
    east_m: float = math.inf
    north_m: float = math.inf

    def holds(self, x_m: float, y_m: float) -> bool:
        """Whether a place is in it: each is in one of an area's tiles."""
        return self.west_m <= x_m < self.east_m and self.south_m <= y_m < self.north_m

    def is_near(self, box_m: Box) -> bool:
        """Whether a rectangle comes as near to it as counts."""
        west_m, south_m, east_m, north_m = box_m
        return (
            west_m <= self.east_m + MARGIN_M
            and self.west_m <= east_m + MARGIN_M
            and south_m <= self.north_m + MARGIN_M
            and self.south_m <= north_m + MARGIN_M
        )

    def is_reached_by(self, cone: EchoCone) -> bool:
        """Whether a ping may tell something of it."""
        (x_m, y_m), reach_m = map(float, cone.pose.position_m[:2]), cone.transducer.max_range_m
        return self.is_near((x_m - reach_m, y_m - reach_m, x_m + reach_m, y_m + reach_m))

    def cut(self, occupancy: OccupancyMap) -> OccupancyMap | None:
        """The part of a map whose cells have their lower left corners in it; None: it has none."""
        geometry = occupancy.geometry
        west_m, east_m, south_m, north_m = geometry.extent_m
        cell_m = geometry.resolution_m
        columns = _cells(west_m, east_m, self.west_m, self.east_m, cell_m)
        rows = _cells(south_m, north_m, self.south_m, self.north_m, cell_m)
        shape = rows.stop - rows.start, columns.stop - columns.start
        if min(shape) <= 0:
            return None
        here = rows, columns
        origin_m = west_m + columns.start * cell_m, south_m + rows.start * cell_m
        return replace(
            occupancy,
            geometry=GridGeometry(cell_m, origin_m, shape),
            log_odds=occupancy.log_odds[here],
            observed=occupancy.observed[here],
            layers={name: layer[here] for name, layer in occupancy.layers.items()},
        )


def tiles_of(box_m: Box, most_m: float) -> list[Tile]:
    """Divide an area into tiles of one size, none of whose sides is longer than `most_m`.

    Parameters
    ----------
    box_m : Box
        What its pings reach.
    most_m : float
        Infinite: it is not divided.
    """
    west_m, south_m, east_m, north_m = box_m
    columns, rows = _borders(west_m, east_m, most_m), _borders(south_m, north_m, most_m)
    return [
        Tile(*map(float, (left, low, right, high)))
        for low, high in pairwise(rows)
        for left, right in pairwise(columns)
    ]


def _borders(least_m: float, greatest_m: float, most_m: float) -> FloatArray:
    count = max(1, math.ceil((greatest_m - least_m) / most_m))
    borders = np.linspace(least_m, greatest_m, count + 1)
    borders[[0, -1]] = -math.inf, math.inf
    return borders


def _cells(first_m: float, end_m: float, from_m: float, to_m: float, cell_m: float) -> slice:
    """Which cells of a row of them, from `first_m` to `end_m`, are of a stretch of it."""
    bounds_m = np.clip([from_m, to_m], first_m, end_m)
    # A cell is one's whatever the row begins with: counted from zero, but for rounding.
    start, stop = np.ceil(bounds_m / cell_m - 1e-6) - np.rint(first_m / cell_m)
    return slice(int(start), int(stop))


def around(boxes_m: Sequence[Box]) -> Box:
    """The rectangle around others."""
    sides_m = np.array(boxes_m)
    west_m, south_m = map(float, sides_m[:, :2].min(axis=0))
    east_m, north_m = map(float, sides_m[:, 2:].max(axis=0))
    return west_m, south_m, east_m, north_m
