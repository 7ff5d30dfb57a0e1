"""What pictures of maps show; nothing here needs matplotlib, which takes long to load."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from usmap_ros.grids import OccupancyMap, TruthMap
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.robot_paths import RobotPaths

#: Around what is shown, in cells.
_MARGIN_CELLS = 2.0

#: Lowest x, highest x, lowest y, highest y, m.
Extent = tuple[float, float, float, float]


@dataclass(frozen=True)
class MapFrame:
    """A map while it forms."""

    occupancy: OccupancyMap
    cones: dict[str, EchoCone]
    #: How many positions of each topic's path lie behind it.
    positions: dict[str, int]
    stamp_ns: int


def shown_extent(
    maps: Iterable[OccupancyMap], paths: RobotPaths, truth: TruthMap | None = None
) -> Extent:
    """What holds all that maps observed and all paths, which may lead out of them.

    Parameters
    ----------
    maps : iterable of OccupancyMap
        One or more.
    paths : RobotPaths
        Where the robots were.
    truth : TruthMap, optional
        To be held as well.
    """
    geometries = [occupancy.observed_geometry() for occupancy in maps]
    geometries += [] if truth is None else [truth.geometry]
    places = [np.reshape(positions, (-1, 2)) for positions in paths.positions_m.values()]
    places += [np.reshape(geometry.extent_m, (2, 2)).T for geometry in geometries]
    margin_m = _MARGIN_CELLS * geometries[0].resolution_m
    x_min, y_min = np.concatenate(places).min(axis=0) - margin_m
    x_max, y_max = np.concatenate(places).max(axis=0) + margin_m
    return float(x_min), float(x_max), float(y_min), float(y_max)
