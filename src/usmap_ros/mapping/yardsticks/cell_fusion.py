"""Maps whose cells add up what each ping says of them, once and for all."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from usmap_ros.grids import FREE_PROBABILITY, GridGeometry, OccupancyMap
from usmap_ros.mapping.extent import check_size
from usmap_ros.mapping.fusion import LEAST_NEWS, Fusion
from usmap_ros.numerics.arrays import IndexArray, RealArray
from usmap_ros.numerics.special import logit
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: The rectangle of cells grows by whole blocks of so many, so that it seldom has to.
BLOCK_CELLS = 64


class CellFusion(Fusion):
    """A rectangle of cells that grows in any direction and never shifts.

    Row and column count from the world's origin, either may be negative.

    Parameters
    ----------
    parameters : MappingParameters
        Cell size, prior, clamps and sensor model.
    """

    def __init__(self, parameters: MappingParameters) -> None:
        super().__init__(parameters)
        self._prior = np.float32(logit(parameters.prior))
        # Row and column of the first cell; log-odds, and how often an object would have been heard.
        self._first = np.zeros(2, np.intp)
        self._log_odds = self._exposure = np.zeros((0, 0), np.float32)

    @property
    def memory_bytes(self) -> int:
        """Memory that the cells take."""
        return self._log_odds.nbytes + self._exposure.nbytes

    def _add(
        self,
        rows: IndexArray,
        columns: IndexArray,
        evidence: RealArray,
        exposure: RealArray | float,
    ) -> None:
        """Add to the log-odds and to the exposure of cells, each of which is named once."""
        places = self._places(rows, columns)
        self._log_odds[places] = np.clip(
            self._log_odds[places] + evidence,
            self.parameters.least_log_odds,
            self.parameters.greatest_log_odds,
        )
        self._exposure[places] += exposure

    def _places(self, rows: IndexArray, columns: IndexArray) -> tuple[IndexArray, IndexArray]:
        """Where cells are in the arrays, which are made larger where they must be."""
        if len(rows):
            first = np.array([rows.min(), columns.min()]) // BLOCK_CELLS * BLOCK_CELLS
            last = (np.array([rows.max(), columns.max()]) // BLOCK_CELLS + 1) * BLOCK_CELLS
            self._cover(first, last)
        return rows - self._first[0], columns - self._first[1]

    def _cover(self, first: IndexArray, last: IndexArray) -> None:
        """Make room from one row and column to before others."""
        if self._log_odds.size:
            first = np.minimum(first, self._first)
            last = np.maximum(last, self._first + self._log_odds.shape)
        shape = int(last[0] - first[0]), int(last[1] - first[1])
        if shape == self._log_odds.shape:
            return
        check_size(*shape, self.parameters)
        row, column = self._first - first if self._log_odds.size else (0, 0)
        rows, columns = self._log_odds.shape
        log_odds, exposure = np.full(shape, self._prior), np.zeros(shape, np.float32)
        log_odds[row : row + rows, column : column + columns] = self._log_odds
        exposure[row : row + rows, column : column + columns] = self._exposure
        self._first, self._log_odds, self._exposure = first, log_odds, exposure

    def mend(self, cone: EchoCone | None = None) -> int:
        """Make cells unknown again of which there are numbers that are not finite."""
        part: tuple[slice, ...] = (slice(None), slice(None))
        if cone is not None:
            middle_m, reach_m = cone.pose.position_m[1::-1], cone.transducer.max_range_m
            side_m = self.parameters.resolution_m
            first = np.floor((middle_m - reach_m) / side_m).astype(int) - self._first
            last = np.ceil((middle_m + reach_m) / side_m).astype(int) - self._first
            part = tuple(map(slice, np.maximum(first, 0), np.maximum(last, 0)))
        log_odds, exposure = self._log_odds[part], self._exposure[part]
        broken = ~(np.isfinite(log_odds) & np.isfinite(exposure))
        log_odds[broken], exposure[broken] = self._prior, 0.0
        return int(np.count_nonzero(broken))

    def snapshot(self) -> Callable[[], OccupancyMap]:
        """What makes the map as it is now, in its own time and in any thread."""
        return partial(
            as_map, self._log_odds.copy(), self._exposure.copy(), self._first, self.parameters,
            self.frame_id, self.stamp_ns,
        )  # fmt: skip

    def resume(self, occupancy: OccupancyMap) -> None:
        """Start from a map that was exported before; see `Fusion.resume`."""
        super().resume(occupancy)
        left, top = occupancy.geometry.first_cell
        rows, columns = np.nonzero(occupancy.observed | (occupancy.log_odds != self._prior))
        places = self._places(rows + top, columns + left)
        self._log_odds[places] = occupancy.log_odds[rows, columns]
        is_observed = occupancy.observed[rows, columns]
        self._exposure[places] = np.where(is_observed, self.parameters.observed_exposure, 0.0)


def as_map(
    log_odds: NDArray[np.float32],
    exposure: NDArray[np.float32],
    first: IndexArray,
    parameters: MappingParameters,
    frame_id: str,
    stamp_ns: int,
) -> OccupancyMap:
    """Rectangle around all cells of which evidence says anything.

    Cells count as observed in which something would have been heard, or that are not believed to be
    free.  Log-odds are there for every cell, also for those that count as unobserved because echoes
    could neither fill nor free them: what they are believed to be is not lost, but nobody should
    rely on it.  Without any evidence the map is a single unobserved cell.

    Parameters
    ----------
    log_odds, exposure : (rows, columns) arrays
        Of cells, and how often an object in each would have been heard.
    first : (2,) integer array
        Row and column of the first cell.
    parameters : MappingParameters
        Cell size, prior, and the exposure from which on a cell counts as observed.
    frame_id, stamp_ns : str, int
        Of the map.
    """
    prior = np.float32(logit(parameters.prior))
    observed = (log_odds != prior) & (
        (exposure >= parameters.observed_exposure) | (log_odds > logit(FREE_PROBABILITY))
    )
    touched = observed | (np.abs(log_odds - prior) >= LEAST_NEWS)
    rows, columns = (np.flatnonzero(touched.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        log_odds, observed = np.full((1, 1), prior), np.zeros((1, 1), np.bool_)
        touched, first = observed, np.zeros(2, np.intp)
        rows = columns = np.zeros(1, np.intp)
    part = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    top, left = int(first[0] + rows[0]), int(first[1] + columns[0])
    values = np.where(touched, log_odds, prior)[part]
    resolution_m = parameters.resolution_m
    geometry = GridGeometry(resolution_m, (left * resolution_m, top * resolution_m), values.shape)
    return OccupancyMap(geometry, values, observed[part], frame_id, stamp_ns)
