"""The rectangle of cells that a joint estimate works on, and its quarters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.grids import GridGeometry
from usmap_ros.mapping.ping_table import GREATEST_RANGE, PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray

#: What stands in a cell is placed to half its side: quarters of a cell.
QUARTERS = 4


class Field(NamedTuple):
    """A rectangle of cells; cell (row, column) of it is row * columns + column.

    Quarter q of a cell lies to its right if q & 1, and above if q & 2; quarters of all cells lie
    one behind the other.
    """

    #: Of its lowest left cell, counted from y = 0 and x = 0.
    first_row: int
    first_column: int
    #: Its size.
    rows: int
    columns: int
    #: Side of a cell.
    resolution_m: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows, self.columns

    def geometry(self) -> GridGeometry:
        """Where its cells lie."""
        step_m = self.resolution_m
        origin_m = (self.first_column * step_m, self.first_row * step_m)
        return GridGeometry(step_m, origin_m, self.shape)

    def bands(self, rows: int) -> list[tuple[slice, Field]]:
        """It, cut into bands of so many rows: where they are in arrays, and each a field."""
        bands = []
        for row in range(0, self.rows, rows):
            end = min(row + rows, self.rows)
            band = self._replace(first_row=self.first_row + row, rows=end - row)
            bands.append((slice(row, end), band))
        return bands

    def cells_at(self, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> BoolArray:
        """Mask of the cells at some places; what is outside is left out."""
        mask = np.zeros(self.shape, bool)
        columns = np.floor(x_m / self.resolution_m).astype(np.int64) - self.first_column
        rows = np.floor(y_m / self.resolution_m).astype(np.int64) - self.first_row
        inside = (rows >= 0) & (columns >= 0) & (rows < self.rows) & (columns < self.columns)
        mask[rows[inside], columns[inside]] = True
        return mask

    def cells_within(
        self, x_m: NDArray[np.float64], y_m: NDArray[np.float64], radius_m: float
    ) -> BoolArray:
        """Mask of the cells whose centres lie within a radius of any of some places."""
        mask = np.zeros(self.shape, bool)
        res = self.resolution_m
        columns, rows = (np.floor(at_m / res).astype(np.int64) for at_m in (x_m, y_m))
        reach = int(np.ceil(radius_m / res))
        for up, right in np.ndindex(2 * reach + 1, 2 * reach + 1):
            row, column = rows + up - reach, columns + right - reach
            near = np.hypot((column + 0.5) * res - x_m, (row + 0.5) * res - y_m) < radius_m
            row, column = row[near] - self.first_row, column[near] - self.first_column
            inside = (row >= 0) & (column >= 0) & (row < self.rows) & (column < self.columns)
            mask[row[inside], column[inside]] = True
        return mask


def field_around(table: PingTable, rows: NDArray[np.int64], resolution_m: float) -> Field:
    """The least rectangle that holds all that some pings may reach.

    Parameters
    ----------
    table : PingTable
        Pings.
    rows : (pings,) integer array
        Which of them.
    resolution_m : float
        Side of a cell.
    """
    numbers = table.numbers[rows]
    reach_m = numbers[:, GREATEST_RANGE]
    first_column, first_row = (
        int(np.floor((numbers[:, axis] - reach_m).min() / resolution_m)) - 1 for axis in (X, Y)
    )
    end_column, end_row = (
        int(np.ceil((numbers[:, axis] + reach_m).max() / resolution_m)) + 1 for axis in (X, Y)
    )
    return Field(
        first_row, first_column, end_row - first_row, end_column - first_column, resolution_m
    )
