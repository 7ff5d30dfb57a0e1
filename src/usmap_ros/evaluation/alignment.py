"""A map and the truth, laid over each other."""

from dataclasses import dataclass

import numpy as np

from usmap_ros.errors import MapSizeError
from usmap_ros.grids import (
    FREE_PROBABILITY,
    OCCUPIED_PROBABILITY,
    GridGeometry,
    OccupancyMap,
    TruthMap,
)
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Cells that map and truth may have together; comparing them takes about 2 GB then.
MOST_CELLS = 100_000_000
#: Probability of cells that lie beyond a map.
_SAYS_NOTHING = 0.5
#: Origins that are whole cells apart to this share of a cell, and cells of sizes that differ by
#: this share, are those of the same grid.
_SAME, _SAME_SIZE = 0.01, 1e-6


@dataclass(frozen=True)
class AlignedMaps:
    """A map and the truth on one grid that holds both."""

    geometry: GridGeometry
    #: (rows, columns) array: what the map says; beyond its rectangle, an even chance.
    probability: FloatArray
    #: (rows, columns) bool array: where it says something.
    observed: BoolArray
    #: (rows, columns) bool array: what is there.
    occupied: BoolArray
    #: (rows, columns) bool array: the truth's rectangle: beyond it the truth says nothing.
    charted: BoolArray

    @property
    def predicted(self) -> BoolArray:
        """Observed cells that the map calls occupied."""
        return self.observed & (self.probability >= OCCUPIED_PROBABILITY)

    @property
    def free(self) -> BoolArray:
        """Observed cells that the map calls free."""
        return self.observed & (self.probability <= FREE_PROBABILITY)


def align(occupancy: OccupancyMap, truth: TruthMap) -> AlignedMaps:
    """Lay a map and the truth over each other by their origins, on the map's cells.

    The truth's cells may have another size, or lie otherwise.  Then a cell is occupied if the
    centre of an occupied cell of the truth lies in it, or if its own centre lies in one: finer
    cells add up, and coarser ones are filled.

    Raises
    ------
    MapSizeError
        If a rectangle that holds both would have more than `MOST_CELLS` of the map's cells.
    """
    ours = occupancy.geometry
    _check_size(ours, truth.geometry)
    occupied_there, row, column = _on_cells_of(ours, truth)
    theirs_shape = occupied_there.shape
    top, left = min(0, row), min(0, column)
    shape = (
        max(ours.shape[0], row + theirs_shape[0]) - top,
        max(ours.shape[1], column + theirs_shape[1]) - left,
    )
    inside = _window(-top, -left, ours.shape)
    probability = np.full(shape, _SAYS_NOTHING)
    probability[inside] = occupancy.probability()
    observed = np.zeros(shape, dtype=np.bool_)
    observed[inside] = occupancy.observed
    occupied = np.zeros(shape, dtype=np.bool_)
    charted = np.zeros(shape, dtype=np.bool_)
    there = _window(row - top, column - left, theirs_shape)
    occupied[there], charted[there] = occupied_there, True
    resolution_m, (x_m, y_m) = ours.resolution_m, ours.origin_m
    origin_m = (x_m + left * resolution_m, y_m + top * resolution_m)
    geometry = GridGeometry(resolution_m, origin_m, shape)
    return AlignedMaps(geometry, probability, observed, occupied, charted)


def _check_size(ours: GridGeometry, theirs: GridGeometry) -> None:
    west, east, south, north = np.array([ours.extent_m, theirs.extent_m]).T
    width_m, height_m = east.max() - west.min(), north.max() - south.min()
    cells = width_m * height_m / ours.resolution_m**2
    if cells > MOST_CELLS:
        raise MapSizeError(
            f"map and truth lie in a rectangle of {width_m:.0f} m x {height_m:.0f} m, which would"
            f" have {cells:.3g} of the map's cells and may have {MOST_CELLS:.3g}"
        )


def _on_cells_of(geometry: GridGeometry, truth: TruthMap) -> tuple[BoolArray, int, int]:
    """What is there by cells of another map, with the row and column of the first of them."""
    theirs = truth.geometry
    offset = (np.array(theirs.origin_m) - geometry.origin_m) / geometry.resolution_m
    ratio = theirs.resolution_m / geometry.resolution_m
    column, row = (int(cell) for cell in np.floor(offset + _SAME))
    shift = (offset - (column, row))[::-1]
    if abs(ratio - 1.0) < _SAME_SIZE and np.all(np.abs(shift) <= _SAME):
        return truth.occupied, row, column
    shape = np.ceil(np.array(theirs.shape) * ratio + shift - _SAME).astype(np.intp)
    occupied = np.zeros(shape, dtype=np.bool_)
    found = np.argwhere(truth.occupied)
    holding = np.floor((found + 0.5) * ratio + shift).astype(np.intp)
    occupied[tuple(np.clip(holding, 0, shape - 1).T)] = True
    around = [
        np.floor((np.arange(count) + 0.5 - part) / ratio).astype(np.intp)
        for count, part in zip(shape, shift, strict=True)
    ]
    # Beyond the truth's own rectangle, at its rim, there is nothing.
    rows, columns = (
        np.where((cell >= 0) & (cell < count), cell, count)
        for cell, count in zip(around, theirs.shape, strict=True)
    )
    occupied |= np.pad(truth.occupied, (0, 1))[np.ix_(rows, columns)]
    return occupied, row, column


def _window(row: int, column: int, shape: tuple[int, int]) -> tuple[slice, slice]:
    return slice(row, row + shape[0]), slice(column, column + shape[1])
