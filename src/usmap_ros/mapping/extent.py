"""How far a map may reach: its rectangle has to fit into memory, however few cells are known."""

from __future__ import annotations

import math

from usmap_ros.errors import MapSizeError
from usmap_ros.grids import GridGeometry
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone


class Extent:
    """Rectangle around the pings of a map.

    Parameters
    ----------
    parameters : MappingParameters
        Say how large a cell is, and how many there may be.
    most_side : int, optional
        Cells along a side that there may be.
    with_reach : bool
        Whether it goes around all that they may hear, which no map exceeds, or around the places
        alone from which they were sent, which is the least that a map needs.
    """

    def __init__(
        self,
        parameters: MappingParameters,
        most_side: int | None = None,
        *,
        with_reach: bool = True,
    ) -> None:
        self._parameters = parameters
        self._with_reach = with_reach
        self._most_side = most_side
        self._west_m = self._south_m = math.inf
        self._east_m = self._north_m = -math.inf

    def add(self, cone: EchoCone) -> None:
        """Stretch it over a ping, unless the rectangle would become too large.

        Raises
        ------
        MapSizeError
            If it would: then it stays as it is.
        """
        # For every ping: NumPy's way with two numbers takes four times as long.
        x_m, y_m, _ = cone.pose.position_m.tolist()
        reach_m = cone.transducer.max_range_m if self._with_reach else 0.0
        self._stretch(x_m - reach_m, x_m + reach_m, y_m - reach_m, y_m + reach_m)

    def cover(self, geometry: GridGeometry) -> None:
        """Stretch it over a map.

        Raises
        ------
        MapSizeError
            If the rectangle would become too large.
        """
        self._stretch(*geometry.extent_m)

    def _stretch(self, west_m: float, east_m: float, south_m: float, north_m: float) -> None:
        west_m, east_m = min(west_m, self._west_m), max(east_m, self._east_m)
        south_m, north_m = min(south_m, self._south_m), max(north_m, self._north_m)
        columns = math.ceil((east_m - west_m) / self._parameters.resolution_m)
        rows = math.ceil((north_m - south_m) / self._parameters.resolution_m)
        check_size(rows, columns, self._parameters)
        if self._most_side is not None and max(rows, columns) > self._most_side:
            raise MapSizeError(
                f"{_rectangle(rows, columns, self._parameters)} has a side of more than"
                f" {self._most_side} cells, which nav2 does not take: {_ADVICE}"
            )
        self._west_m, self._east_m = west_m, east_m
        self._south_m, self._north_m = south_m, north_m


_ADVICE = "map robots that are so far apart by themselves, or with larger cells"


def check_size(rows: float, columns: float, parameters: MappingParameters) -> None:
    """Raise `MapSizeError` if a rectangle of so many cells would take too much memory."""
    if rows * columns > parameters.most_cells:
        raise MapSizeError(
            f"{_rectangle(rows, columns, parameters)} would have {rows * columns:.3g} cells and may"
            f" have {parameters.most_cells:.3g} (mapping.most_cells): {_ADVICE}"
        )


def _rectangle(rows: float, columns: float, parameters: MappingParameters) -> str:
    width_m, height_m = columns * parameters.resolution_m, rows * parameters.resolution_m
    return f"the map's rectangle of {width_m:.0f} m x {height_m:.0f} m"
