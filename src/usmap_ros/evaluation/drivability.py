"""Whether one can drive by a map: free space that was seen, walls that hold."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt, label

from usmap_ros.evaluation.alignment import AlignedMaps
from usmap_ros.evaluation.line_of_sight import pings_in_sight
from usmap_ros.evaluation.sight import PINGS_TO_KNOW
from usmap_ros.grids import GridGeometry
from usmap_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from usmap_ros.pings.fields_of_view import PingViews

#: Of the robot that looks for a way out.
ROBOT_RADIUS_M = 0.15

_AROUND = np.ones((3, 3), dtype=bool)


@dataclass(frozen=True)
class Drivability:
    """What a robot risks that takes the map at its word; truth stops sound and sight."""

    #: Of the cells called free, the share that no beam can have reached: not within one cell of a
    #: cell in line of sight of any ping, within its beam and maximum range.
    leak: float
    #: Of the truth cells in line of sight of two pings or more, the share called free with no
    #: predicted cell within one cell.
    lost: float
    #: Area that no beam can have reached and that a robot of `ROBOT_RADIUS_M` gets to from a
    #: robot's path.
    escape_m2: float


def drivability(
    maps: AlignedMaps, views: PingViews, sightings: IntArray | None = None
) -> Drivability:
    """Leak, lost and escape of a map.

    Parameters
    ----------
    maps : AlignedMaps
        The map and the truth.
    views : PingViews
        What it was made from.
    sightings : (rows, columns) int array, optional
        By `pings_in_sight`, where that is known: it takes most of the time.
    """
    if sightings is None:
        sightings = pings_in_sight(maps.occupied, maps.geometry, views)
    unseen = ~binary_dilation(sightings > 0, _AROUND)
    free, predicted = maps.free, maps.predicted
    known = maps.occupied & (sightings >= PINGS_TO_KNOW)
    lost = free & ~binary_dilation(predicted, _AROUND)
    way_out = unseen & reachable(free, predicted, maps.geometry, views.positions_m)
    return Drivability(
        leak=share(unseen, free),
        lost=share(lost, known),
        escape_m2=float(np.count_nonzero(way_out) * maps.geometry.resolution_m**2),
    )


def reachable(
    free: BoolArray,
    predicted: BoolArray,
    geometry: GridGeometry,
    positions_m: FloatArray,
    radius_m: float = ROBOT_RADIUS_M,
) -> BoolArray:
    """Cells that the centre of a round robot can get to by what a map says.

    It moves over free cells whose centres are farther than its radius from the centre of
    every predicted one, to any of the eight neighbours, as planners do. Cells that
    are neither free nor predicted are closed to its centre, but may lie under its body.

    Parameters
    ----------
    free, predicted : (rows, columns) bool arrays
        What the map says.
    geometry : GridGeometry
        Where the cells lie.
    positions_m : (n, 2) array
        Where it may start: on any open cell within its radius of one of them.
    radius_m : float
        Of the robot.
    """
    reach = radius_m / geometry.resolution_m + 1e-6
    is_open = free & (_distances(predicted) > reach)
    starts = np.zeros(geometry.shape, dtype=bool)
    index = (positions_m - np.array(geometry.origin_m)) / geometry.resolution_m
    columns, rows = np.floor(index).astype(np.int64).T
    inside = (rows >= 0) & (rows < starts.shape[0]) & (columns >= 0) & (columns < starts.shape[1])
    starts[rows[inside], columns[inside]] = True
    regions, _ = label(is_open, structure=_AROUND)
    entered = np.unique(regions[is_open & (_distances(starts) <= reach)])
    return np.isin(regions, entered) & is_open


def _distances(cells: BoolArray) -> FloatArray:
    """Distance of every cell's centre to the nearest one of `cells`, in cells."""
    if not cells.any():
        return np.full(cells.shape, np.inf)
    distances: FloatArray = distance_transform_edt(~cells)
    return distances


def share(property_: BoolArray, among: BoolArray) -> float:
    """Share of the cells `among` that have a property; 0 if there are none."""
    count = np.count_nonzero(among)
    return float(np.count_nonzero(property_ & among) / count) if count else 0.0
