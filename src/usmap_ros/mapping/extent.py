"""How far a map may reach: its rectangle has to fit into memory, however few cells are known."""

import math

from usmap_ros.bounds import MAX_MAP_SIDE
from usmap_ros.errors import MapSizeError
from usmap_ros.grids import GridGeometry
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone


class Extent:
    """Rectangle around all that the pings of a map may hear, which no map exceeds.

    Parameters
    ----------
    parameters : MappingParameters
        Say how large a cell is, and how many there may be.
    """

    def __init__(self, parameters: MappingParameters) -> None:
        self._parameters = parameters
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
        reach_m = cone.transducer.max_range_m
        self._stretch(x_m - reach_m, x_m + reach_m, y_m - reach_m, y_m + reach_m)

    def distance_m(self, cone: EchoCone) -> float:
        """How far from it a ping was sent; 0 within it."""
        x_m, y_m, _ = cone.pose.position_m.tolist()
        east_m = max(self._west_m - x_m, 0.0, x_m - self._east_m)
        north_m = max(self._south_m - y_m, 0.0, y_m - self._north_m)
        return math.hypot(east_m, north_m)

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
        if max(rows, columns) > MAX_MAP_SIDE:
            raise MapSizeError(
                f"{_rectangle(rows, columns, self._parameters)} has a side of more than"
                f" {MAX_MAP_SIDE} cells, which nav2 does not take: {_ADVICE}"
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
