"""Finished rectangular maps: what fusion exports, files store, and scoring compares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from usmap_ros.numerics.special import logit

#: A cell counts as occupied from this probability on (nav2's ``occupied_thresh``).
OCCUPIED_PROBABILITY = 0.65
#: A cell counts as free up to this probability.
FREE_PROBABILITY = 0.35

#: Layers that a map may have beside what it believes: the direction in which the surface in each
#: cell faces, in rad from the x axis, NaN where it is not known; how undecided each suspected
#: cell is, from 0 to 1; and the mean cosine and sine of twice the direction of the looks in which
#: it may have been heard.
NORMAL, AMBIGUITY = "normal_rad", "ambiguity"
LOOKS_COS, LOOKS_SIN = "looks_cos", "looks_sin"
LAYERS = (NORMAL, AMBIGUITY, LOOKS_COS, LOOKS_SIN)

#: Values of a trinary ``nav_msgs/OccupancyGrid``.
UNKNOWN_VALUE, FREE_VALUE, OCCUPIED_VALUE = -1, 0, 100


def _log_odds_from(probability: float) -> np.float32:
    """Log-odds of a probability, in the precision of maps and rounded away from an even chance."""
    exact, rounded = logit(probability), np.float32(logit(probability))
    if abs(rounded) >= abs(exact):
        return rounded
    return np.float32(np.nextafter(rounded, np.float32(np.copysign(np.inf, exact))))


#: What log-odds are compared with, since exponentials of all cells take long.
_OCCUPIED_LOG_ODDS = _log_odds_from(OCCUPIED_PROBABILITY)
_FREE_LOG_ODDS = _log_odds_from(FREE_PROBABILITY)


@dataclass(frozen=True)
class GridGeometry:
    """Where the cells of a map lie: rows from the lowest y, columns from the lowest x."""

    resolution_m: float
    #: x, y of the lower-left corner of cell (0, 0).
    origin_m: tuple[float, float]
    shape: tuple[int, int]

    @property
    def extent_m(self) -> tuple[float, float, float, float]:
        """Lowest x, highest x, lowest y, highest y, as matplotlib's ``imshow`` wants them."""
        rows, columns = self.shape
        x, y = self.origin_m
        return x, x + columns * self.resolution_m, y, y + rows * self.resolution_m

    @property
    def first_cell(self) -> tuple[int, int]:
        """Column and row of cell (0, 0), counted from x = 0 and y = 0."""
        column, row = np.rint(np.array(self.origin_m) / self.resolution_m)
        return int(column), int(row)

    @classmethod
    def around(cls, geometries: Sequence[GridGeometry]) -> GridGeometry:
        """Smallest grid that covers others of the same cells, at least one."""
        first = np.array([one.first_cell for one in geometries])
        beyond = first + np.array([one.shape[::-1] for one in geometries])
        left, top = (int(cell) for cell in first.min(axis=0))
        columns, rows = (int(count) for count in beyond.max(axis=0) - (left, top))
        resolution_m = geometries[0].resolution_m
        return cls(resolution_m, (left * resolution_m, top * resolution_m), (rows, columns))

    def within(self, larger: GridGeometry) -> tuple[slice, slice]:
        """Rows and columns on a grid of the same cells that covers this one."""
        left, top = np.subtract(self.first_cell, larger.first_cell).tolist()
        rows, columns = self.shape
        return slice(top, top + rows), slice(left, left + columns)

    def cell_centers_m(self, rows: IntArray, columns: IntArray) -> FloatArray:
        """Centres of cells, shape (..., 2), x before y."""
        x = self.origin_m[0] + (columns + 0.5) * self.resolution_m
        y = self.origin_m[1] + (rows + 0.5) * self.resolution_m
        return np.stack([x, y], axis=-1)


@dataclass(frozen=True)
class OccupancyMap:
    """A map as log-odds, with the cells that were ever observed.

    Parameters
    ----------
    geometry : GridGeometry
        Where the cells lie.
    log_odds : (rows, columns) float32 array
        Natural logarithm of the odds of being occupied, prior included.
    observed : (rows, columns) bool array
        Cells that any cone said something about.
    frame_id : str
        World frame of the map.
    stamp_ns : int
        Stamp of the newest cone in it.
    layers : mapping of str to (rows, columns) float32 array
        What else is known of each cell, by names of `LAYERS`; not every way of fusing knows them.
    """

    geometry: GridGeometry
    log_odds: NDArray[np.float32]
    observed: BoolArray
    frame_id: str
    stamp_ns: int = 0
    layers: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)

    def probability(self) -> FloatArray:
        """Probability that each cell is occupied; the prior where nothing was observed."""
        return 1.0 / (1.0 + np.exp(-self.log_odds.astype(np.float64)))

    def ambiguity_percent(self) -> NDArray[np.int8]:
        """How undecided cells are as 0..100, or -1 where nothing was observed or suspected."""
        ambiguity = self.layers.get(AMBIGUITY, np.zeros(self.geometry.shape, np.float32))
        values = np.rint(100.0 * ambiguity).astype(np.int8)
        return np.where(self.observed | (ambiguity > 0.0), values, np.int8(UNKNOWN_VALUE))

    def observed_geometry(self) -> GridGeometry:
        """Rectangle around the observed cells; the whole map if there are none."""
        rows, columns = np.nonzero(self.observed)
        if len(rows) == 0:
            return self.geometry
        top, left = int(rows.min()), int(columns.min())
        resolution_m, (x_m, y_m) = self.geometry.resolution_m, self.geometry.origin_m
        return GridGeometry(
            resolution_m,
            (x_m + left * resolution_m, y_m + top * resolution_m),
            (int(rows.max()) - top + 1, int(columns.max()) - left + 1),
        )

    def trinary(self) -> NDArray[np.int8]:
        """Occupied (100), free (0) or unknown (-1), as nav2's static layer reads it."""
        values = np.full(self.geometry.shape, UNKNOWN_VALUE, dtype=np.int8)
        values[self.observed & (self.log_odds <= _FREE_LOG_ODDS)] = FREE_VALUE
        values[self.predicted()] = OCCUPIED_VALUE
        return values

    def predicted(self) -> BoolArray:
        """Cells that are observed and count as occupied."""
        predicted: BoolArray = self.observed & (self.log_odds >= _OCCUPIED_LOG_ODDS)
        return predicted

    def percent(self) -> NDArray[np.int8]:
        """Probability as 0..100, or -1 where nothing was observed."""
        values = np.rint(100.0 * self.probability()).astype(np.int8)
        return np.where(self.observed, values, np.int8(UNKNOWN_VALUE))


@dataclass(frozen=True)
class TruthMap:
    """The cells that really are occupied.

    Parameters
    ----------
    geometry : GridGeometry
        Where the cells lie.
    occupied : (rows, columns) bool array
        True where something stands.
    """

    geometry: GridGeometry
    occupied: BoolArray
