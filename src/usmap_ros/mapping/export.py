"""Between the tiled grid and finished rectangular maps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usmap_ros.grids import FREE_PROBABILITY, GridGeometry, OccupancyMap
from usmap_ros.mapping.extent import check_size
from usmap_ros.mapping.grid import TiledGrid
from usmap_ros.numerics.arrays import IndexArray
from usmap_ros.numerics.special import logit
from usmap_ros.parameters import MappingParameters

#: Layers that every map has: log-odds, and how often an object would have been heard.
LOG_ODDS, EXPOSURE = "log_odds", "exposure"

#: Evidence that shifts log-odds by less than this, as at the rim of a beam, says nothing.
LEAST_NEWS = 0.05


def as_map(
    grid: TiledGrid,
    parameters: MappingParameters,
    frame_id: str,
    stamp_ns: int,
    least_believed: float = FREE_PROBABILITY,
) -> OccupancyMap:
    """Rectangle around all cells of which evidence says anything.

    Cells count as observed in which something would have been heard, or that are occupied with
    more than the probability `least_believed`.

    Its origin is a multiple of the resolution, so that a map that grows never shifts.  Log-odds
    are there for every cell, also for those that count as unobserved because echoes could
    neither fill nor free them: what they are believed to be is not lost, but nobody should
    rely on it.  Without any evidence the map is a single unobserved cell.

    Raises
    ------
    MapSizeError
        If the rectangle would have more cells than `parameters.most_cells`.
    """
    log_odds, prior = grid.layer(LOG_ODDS), np.float32(logit(parameters.prior))
    observed = (log_odds != prior) & (
        (grid.layer(EXPOSURE) >= parameters.observed_exposure) | (log_odds > logit(least_believed))
    )
    touched = observed | (np.abs(log_odds - prior) >= LEAST_NEWS)
    rows, columns, slots = grid.cells(touched)
    if len(slots) == 0:
        rows = columns = np.zeros(1, dtype=np.intp)
    top, left = int(rows.min()), int(columns.min())
    shape = (int(rows.max()) - top + 1, int(columns.max()) - left + 1)
    check_size(*shape, parameters)
    values = np.full(shape, prior, dtype=np.float32)
    mask = np.zeros(shape, dtype=np.bool_)
    if len(slots):
        values[rows - top, columns - left] = log_odds[slots]
        mask[rows - top, columns - left] = observed[slots]
    resolution_m = grid.resolution_m
    geometry = GridGeometry(resolution_m, (left * resolution_m, top * resolution_m), shape)
    return OccupancyMap(geometry, values, mask, frame_id, stamp_ns)


def on_map(
    geometry: GridGeometry,
    rows: IndexArray,
    columns: IndexArray,
    values: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Values of some cells on the rectangle of a map, 0 elsewhere.

    Parameters
    ----------
    geometry : GridGeometry
        Of the map.
    rows, columns : (n,) integer arrays
        Of the cells on the tiled grid; those beyond the map are left out.
    values : (n,) float32 array
        Of the cells.
    """
    left, top = geometry.first_cell
    rows, columns = rows - top, columns - left
    height, width = geometry.shape
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    placed = np.zeros(geometry.shape, np.float32)
    placed[rows[inside], columns[inside]] = values[inside]
    return placed


def fill_grid(grid: TiledGrid, occupancy: OccupancyMap, parameters: MappingParameters) -> None:
    """Take over what a map that was exported before says of its cells.

    Raises
    ------
    ValueError
        If its resolution is another, or its origin is not on this grid.
    """
    geometry = occupancy.geometry
    if not np.isclose(geometry.resolution_m, grid.resolution_m, rtol=1e-6):
        raise ValueError(
            f"its cells are {geometry.resolution_m:g} m and not {grid.resolution_m:g} m"
        )
    first = np.array(geometry.origin_m) / grid.resolution_m
    if np.any(np.abs(first - np.rint(first)) > 1e-3):
        raise ValueError(f"its origin {geometry.origin_m} is not a multiple of the resolution")
    left, top = geometry.first_cell
    prior = np.float32(logit(parameters.prior))
    rows, columns = np.nonzero(occupancy.observed | (occupancy.log_odds != prior))
    slots = grid.slots(rows + top, columns + left)
    grid.layer(LOG_ODDS)[slots] = occupancy.log_odds[rows, columns]
    grid.layer(EXPOSURE)[slots] = np.where(
        occupancy.observed[rows, columns], parameters.observed_exposure, 0.0
    )
