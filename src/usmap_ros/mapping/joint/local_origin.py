"""Another origin for what is far from that of its frame, such as a map of a country's grid.

Lines are told by their distance from the origin: tables of all distances would be as large as it is
far, and a line would turn by kilometres.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from usmap_ros.grids import GridGeometry, OccupancyMap
from usmap_ros.pings.cone import EchoCone

#: Places nearer to the origin keep it; others get the nearest corner of squares of this side, m.
SIDE_M = 1000.0


class LocalOrigin(NamedTuple):
    """Where it lies in the frame: whole cells, so that cells stay what they are."""

    #: From the origin of the frame.
    columns: int
    rows: int
    #: Side of a cell.
    resolution_m: float

    @classmethod
    def near(cls, x_m: float, y_m: float, resolution_m: float) -> LocalOrigin:
        """The one for what is around a place."""
        cells = round(SIDE_M / resolution_m)
        columns, rows = (
            cells * round(value_m / (cells * resolution_m)) if math.isfinite(value_m) else 0
            for value_m in (x_m, y_m)
        )
        return cls(columns, rows, resolution_m)

    def cone(self, cone: EchoCone) -> EchoCone:
        """A ping of the frame, as from here."""
        if not (self.columns or self.rows):
            return cone
        offset_m = self.resolution_m * np.array([self.columns, self.rows, 0.0])
        return replace(cone, pose=replace(cone.pose, position_m=cone.pose.position_m - offset_m))

    def from_here(self, occupancy: OccupancyMap) -> OccupancyMap:
        """A map of the frame, as from here."""
        return self._moved(occupancy, -1)

    def in_frame(self, occupancy: OccupancyMap) -> OccupancyMap:
        """A map from here, as of the frame."""
        return self._moved(occupancy, 1)

    def _moved(self, occupancy: OccupancyMap, sign: int) -> OccupancyMap:
        left, bottom = occupancy.geometry.first_cell
        side_m, shape = occupancy.geometry.resolution_m, occupancy.geometry.shape
        origin_m = (left + sign * self.columns) * side_m, (bottom + sign * self.rows) * side_m
        return replace(occupancy, geometry=GridGeometry(side_m, origin_m, shape))
