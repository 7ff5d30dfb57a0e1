"""Which ping is expected to settle most of what a map leaves undecided."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.grids import AMBIGUITY, FREE_PROBABILITY, LOOKS_COS, LOOKS_SIN, OccupancyMap
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled

#: Amplitude that must be exceeded to be heard: four times a receiver's noise of 0.005.
LIMIT_AMPLITUDE = 0.02
#: Median reflectivity expected of an object, as in `MappingParameters`.
REFLECTIVITY = 0.5
#: A surface does not hide itself: way before a cell on which nothing hides it, in cells.
_OWN_DEPTH_CELLS = 1.5
#: Cells that are less undecided settle nothing worth a ping.
_LEAST_AMBIGUITY = 0.01


@dataclass(frozen=True)
class NextView:
    """A pose from which to ping."""

    #: Of the transducer.
    x_m: float
    y_m: float
    #: Of its beam axis.
    yaw_rad: float
    #: Undecided cells that a ping is expected to settle.
    score: float


def candidate_poses(
    occupancy: OccupancyMap,
    spacing_m: float = 0.25,
    headings: int = 12,
    clearance_m: float = 0.3,
) -> FloatArray:
    """Poses on free cells, a grid of places with several headings each.

    Parameters
    ----------
    occupancy : OccupancyMap
        The map so far, with its layer of ambiguity.
    spacing_m : float
        Between neighbouring places.
    headings : int
        At each place.
    clearance_m : float
        Least distance from the centre of every cell that the map believes occupied.

    Returns
    -------
    poses : (n, 3) array
        x and y in m, yaw in rad.
    """
    # Here, because who only maps must not wait until it is loaded.
    from scipy.ndimage import distance_transform_edt

    geometry, believed = occupancy.geometry, occupancy.predicted()
    is_open = occupancy.observed & (occupancy.probability() <= FREE_PROBABILITY)
    if believed.any():
        is_open &= distance_transform_edt(~believed) * geometry.resolution_m >= clearance_m
    every = max(1, round(spacing_m / geometry.resolution_m))
    rows, columns = np.nonzero(is_open)
    left, top = geometry.first_cell
    chosen = ((rows + top) % every == 0) & ((columns + left) % every == 0)
    places = geometry.cell_centers_m(rows[chosen], columns[chosen])
    yaws = np.arange(headings) * (2.0 * np.pi / headings) - np.pi
    return np.column_stack([np.repeat(places, headings, axis=0), np.tile(yaws, len(places))])


def view_scores(
    occupancy: OccupancyMap,
    poses: FloatArray,
    transducer: Transducer,
    limit_amplitude: float = LIMIT_AMPLITUDE,
    reflectivity: float = REFLECTIVITY,
) -> FloatArray:
    """How much a ping from each pose is expected to settle.

    The sum, over undecided cells in the cone and in line of sight, of their ambiguity, times the
    probability that what may stand there is heard, times the mean sin² of the angle between
    this look and those so far: from where, or opposite to where, a ring of candidates was heard,
    all of them answer at the same time once more.

    Parameters
    ----------
    occupancy : OccupancyMap
        A map with the layer `ambiguity`.
    poses : (n, 3) array
        x and y in m, yaw in rad.
    transducer : Transducer
        What would ping.
    limit_amplitude : float
        Above which an echo is heard, in units of that of a perfect reflector at 1 m.
    reflectivity : float
        Root of the mean power that an object scatters.

    Returns
    -------
    scores : (n,) array

    Raises
    ------
    ValueError
        If the map does not have the layer.
    """
    if AMBIGUITY not in occupancy.layers:
        raise ValueError(f"has no layer {AMBIGUITY}")
    layers, geometry = occupancy.layers, occupancy.geometry
    rows, columns = np.nonzero(layers[AMBIGUITY] >= _LEAST_AMBIGUITY)
    centers_m = geometry.cell_centers_m(rows, columns)
    nowhere = np.zeros(geometry.shape, np.float32)
    table = np.stack(
        [layers.get(name, nowhere)[rows, columns] for name in (LOOKS_COS, LOOKS_SIN)], axis=-1
    ).astype(np.float64)
    ambiguity = layers[AMBIGUITY][rows, columns].astype(np.float64)
    blocked, origin_m = occupancy.predicted(), np.array(geometry.origin_m)
    scores = np.zeros(len(poses))
    for index, (x_m, y_m, yaw_rad) in enumerate(poses):
        offset_m = centers_m - (x_m, y_m)
        range_m = np.hypot(*offset_m.T)
        direction = np.arctan2(offset_m[:, 1], offset_m[:, 0])
        gain = transducer.beam.gain(np.angle(np.exp(1j * (direction - yaw_rad))))
        inside = (gain > 0.0) & (range_m > transducer.min_range_m)
        seen = np.flatnonzero(inside & (range_m < transducer.max_range_m))
        start, ends = np.array([x_m, y_m]) - origin_m, centers_m[seen] - origin_m
        resolution_m = geometry.resolution_m
        seen = seen[in_line_of_sight(blocked, start / resolution_m, ends / resolution_m)]
        amplitude = reflectivity * gain[seen] / range_m[seen] ** 2
        heard = np.exp(-((limit_amplitude / amplitude) ** 2))
        twice = 2.0 * direction[seen]
        alike = table[seen, 0] * np.cos(twice) + table[seen, 1] * np.sin(twice)
        scores[index] = np.sum(ambiguity[seen] * heard * 0.5 * (1.0 - alike))
    return scores


@compiled
def in_line_of_sight(
    blocked: BoolArray, start: NDArray[np.float64], ends: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether nothing stands between a place and others.

    Parameters
    ----------
    blocked : (rows, columns) bool array
        Cells that stop sound, but not that of the cells right before a place.
    start : (2,) array
        Column and row, in cells from the grid's corner.
    ends : (n, 2) array
        The same of the places.
    """
    rows, columns = blocked.shape
    clear = np.ones(len(ends), dtype=np.bool_)
    for index in range(len(ends)):
        x, y = ends[index, 0] - start[0], ends[index, 1] - start[1]
        distance = np.hypot(x, y)
        way = 0.5
        while clear[index] and way < distance - _OWN_DEPTH_CELLS:
            column = int(np.floor(start[0] + way / distance * x))
            row = int(np.floor(start[1] + way / distance * y))
            if 0 <= row < rows and 0 <= column < columns and blocked[row, column]:
                clear[index] = False
            way += 0.5
    return clear


def best_views(
    occupancy: OccupancyMap,
    candidates: FloatArray,
    transducer: Transducer,
    count: int = 5,
    apart_m: float = 0.5,
    limit_amplitude: float = LIMIT_AMPLITUDE,
) -> list[NextView]:
    """The poses among candidates from which a ping is expected to settle most, best first.

    Parameters
    ----------
    occupancy, candidates, transducer, limit_amplitude
        As in `view_scores`.
    count : int
        How many at the most; fewer if nothing else would settle anything.
    apart_m : float
        Least distance between them: neighbours would settle the same.

    Raises
    ------
    ValueError
        If the map does not have the layer `ambiguity`.
    """
    scores = view_scores(occupancy, candidates, transducer, limit_amplitude)
    views: list[NextView] = []
    for index in np.argsort(-scores, kind="stable"):
        if len(views) == count or scores[index] <= 0.0:
            break
        x_m, y_m, yaw_rad = (float(value) for value in candidates[index])
        if all(np.hypot(view.x_m - x_m, view.y_m - y_m) >= apart_m for view in views):
            views.append(NextView(x_m, y_m, yaw_rad, float(scores[index])))
    return views
