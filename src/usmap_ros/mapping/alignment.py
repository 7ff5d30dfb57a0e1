"""A map and the truth, laid over each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usmap_ros.arrays import BoolArray, FloatArray
from usmap_ros.grids import (
    FREE_PROBABILITY,
    OCCUPIED_PROBABILITY,
    GridGeometry,
    OccupancyMap,
    TruthMap,
)


@dataclass(frozen=True)
class AlignedMaps:
    """A map and the truth on one grid that holds both.

    Parameters
    ----------
    geometry : GridGeometry
        Of that grid.
    probability : (rows, columns) array
        What the map says.
    observed : (rows, columns) bool array
        Where it says something.
    occupied : (rows, columns) bool array
        What is there.
    """

    geometry: GridGeometry
    probability: FloatArray
    observed: BoolArray
    occupied: BoolArray

    @property
    def predicted(self) -> BoolArray:
        """Observed cells that the map calls occupied."""
        return self.observed & (self.probability >= OCCUPIED_PROBABILITY)

    @property
    def free(self) -> BoolArray:
        """Observed cells that the map calls free."""
        return self.observed & (self.probability <= FREE_PROBABILITY)


def align(occupancy: OccupancyMap, truth: TruthMap) -> AlignedMaps:
    """Lay a map and the truth over each other by their origins.

    Raises
    ------
    ValueError
        If the two have different resolutions, or origins that are not whole cells apart.
    """
    ours, theirs = occupancy.geometry, truth.geometry
    resolution_m = ours.resolution_m
    if not np.isclose(resolution_m, theirs.resolution_m, rtol=1e-6):
        raise ValueError(
            f"the map's cells are {resolution_m:g} m and the truth's {theirs.resolution_m:g} m"
        )
    offset = (np.array(theirs.origin_m) - np.array(ours.origin_m)) / resolution_m
    if np.any(np.abs(offset - np.rint(offset)) > 0.01):
        raise ValueError("the origins of map and truth are not whole cells apart")
    column, row = (int(value) for value in np.rint(offset))
    top, left = min(0, row), min(0, column)
    shape = (
        max(ours.shape[0], row + theirs.shape[0]) - top,
        max(ours.shape[1], column + theirs.shape[1]) - left,
    )
    inside = _window(-top, -left, ours.shape)
    probability = np.zeros(shape)
    probability[inside] = occupancy.probability()
    observed = np.zeros(shape, dtype=np.bool_)
    observed[inside] = occupancy.observed
    occupied = np.zeros(shape, dtype=np.bool_)
    occupied[_window(row - top, column - left, theirs.shape)] = truth.occupied
    x_m, y_m = ours.origin_m
    origin_m = (x_m + left * resolution_m, y_m + top * resolution_m)
    return AlignedMaps(GridGeometry(resolution_m, origin_m, shape), probability, observed, occupied)


def _window(row: int, column: int, shape: tuple[int, int]) -> tuple[slice, slice]:
    return slice(row, row + shape[0]), slice(column, column + shape[1])
