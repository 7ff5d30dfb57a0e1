"""A sparse, tiled grid that grows in any direction and never shifts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import IndexArray

#: Cells along the side of a tile.
TILE_SIDE = 64
TILE_CELLS = TILE_SIDE * TILE_SIDE


class TiledGrid:
    """Layers of numbers on square cells, kept in tiles that exist only where something was seen.

    Cell (row, column) covers y from ``row * resolution_m`` and x from ``column * resolution_m``;
    both may be negative.  The tiles lie one behind the other in a pool, so that a *slot*, the
    position of a cell in the pool, stays valid when the grid grows.

    Parameters
    ----------
    resolution_m : float
        Side of a cell.
    defaults : mapping of str to float
        Names of the layers, each with the value of a cell of which nothing is known.
    values_per_cell : mapping of str to int, optional
        Of the layers that have more than one value a cell; they lie one behind the other.
    """

    def __init__(
        self,
        resolution_m: float,
        defaults: Mapping[str, float],
        values_per_cell: Mapping[str, int] | None = None,
    ) -> None:
        self.resolution_m = resolution_m
        self._defaults = dict(defaults)
        several = values_per_cell or {}
        self._pools = {
            name: np.empty((0, TILE_CELLS * several.get(name, 1)), dtype=np.float32)
            for name in self._defaults
        }
        self._tile_count = 0
        # Number of each tile by its place; -1 where there is none.
        self._directory = np.full((0, 0), -1, dtype=np.intp)
        self._directory_origin = (0, 0)

    @property
    def memory_bytes(self) -> int:
        """Memory of all layers of the tiles in use."""
        a_tile = sum(pool.shape[1] * pool.itemsize for pool in self._pools.values())
        return self._tile_count * a_tile

    @property
    def directory(self) -> tuple[IndexArray, int, int]:
        """Number of each tile by its place, -1 where there is none; first tile row and column."""
        return self._directory, *self._directory_origin

    def layer(self, name: str) -> NDArray[np.float32]:
        """Values of a layer by slot: a view, valid until `slots` adds tiles."""
        return self._pools[name].reshape(-1)

    def exchange(self, one: str, other: str) -> None:
        """Let two layers change their names: that moves no values."""
        self._pools[one], self._pools[other] = self._pools[other], self._pools[one]

    def copied(self, layers: Mapping[str, str]) -> TiledGrid:
        """The same cells with copies of some layers, which stay as they are now.

        Parameters
        ----------
        layers : mapping of str to str
            Name in the copy, and name here.
        """
        copy = TiledGrid(
            self.resolution_m, {name: self._defaults[here] for name, here in layers.items()}
        )
        count = copy._tile_count = self._tile_count
        copy._pools = {name: self._pools[here][:count].copy() for name, here in layers.items()}
        copy._directory, copy._directory_origin = self._directory.copy(), self._directory_origin
        return copy

    def slots(self, rows: IndexArray, columns: IndexArray) -> IndexArray:
        """Slots of cells, adding the tiles that they need.

        Parameters
        ----------
        rows, columns : (n,) integer arrays
            Of the cells, of either sign.
        """
        tile_rows, tile_columns = rows // TILE_SIDE, columns // TILE_SIDE
        self._cover(tile_rows, tile_columns)
        first_row, first_column = self._directory_origin
        tiles = self._directory[tile_rows - first_row, tile_columns - first_column]
        inside = (rows % TILE_SIDE) * TILE_SIDE + columns % TILE_SIDE
        slots: IndexArray = tiles * TILE_CELLS + inside
        return slots

    def cover(self, top: int, bottom: int, left: int, right: int) -> None:
        """Make all tiles from one row and column of tiles to others, which are left out."""
        first_row, first_column = self._directory_origin
        rows, columns = self._directory.shape
        low, start = top - first_row, left - first_column
        high, end = bottom - first_row, right - first_column
        is_inside = low >= 0 and start >= 0 and high <= rows and end <= columns
        if is_inside and (self._directory[low:high, start:end] >= 0).all():
            return
        grid = np.meshgrid(np.arange(top, bottom), np.arange(left, right), indexing="ij")
        self._cover(grid[0].ravel(), grid[1].ravel())

    def cells(self, chosen: NDArray[np.bool_]) -> tuple[IndexArray, IndexArray, IndexArray]:
        """Rows, columns and slots of the chosen cells.

        Parameters
        ----------
        chosen : (slots,) bool array
            By slot, of the length of a layer.
        """
        slots = np.flatnonzero(chosen[: self._tile_count * TILE_CELLS])
        tile_rows, tile_columns = np.nonzero(self._directory >= 0)
        tiles = self._directory[tile_rows, tile_columns]
        row_of = np.empty(self._tile_count, dtype=np.intp)
        column_of = np.empty(self._tile_count, dtype=np.intp)
        row_of[tiles] = (tile_rows + self._directory_origin[0]) * TILE_SIDE
        column_of[tiles] = (tile_columns + self._directory_origin[1]) * TILE_SIDE
        tile, inside = np.divmod(slots, TILE_CELLS)
        rows = row_of[tile] + inside // TILE_SIDE
        columns = column_of[tile] + inside % TILE_SIDE
        return rows, columns, slots

    def tiles_around(self, x_m: float, y_m: float, reach_m: float) -> IndexArray:
        """Numbers of the tiles that there are within a square of half the side `reach_m`."""
        side_m = TILE_SIDE * self.resolution_m
        (top, bottom), (left, right) = (
            (
                max(math.floor((middle_m - reach_m) / side_m) - first, 0),
                max(math.floor((middle_m + reach_m) / side_m) - first + 1, 0),
            )
            for middle_m, first in zip((y_m, x_m), self._directory_origin, strict=True)
        )
        within = self._directory[top:bottom, left:right]
        tiles: IndexArray = within[within >= 0]
        return tiles

    def is_finite(self, names: Iterable[str], tiles: IndexArray) -> bool:
        """Whether some layers of some tiles hold finite numbers only."""
        return all(_is_finite(self._pools[name][tile]) for name in names for tile in tiles)

    def mend(self) -> int:
        """Make cells unknown, in all layers, of which any holds a number that is not finite.

        Returns
        -------
        cells : int
            How many there were.
        """
        broken = np.zeros(self._tile_count * TILE_CELLS, dtype=np.bool_)
        for pool in self._pools.values():
            by_cell = pool[: self._tile_count].reshape(len(broken), -1)
            broken |= ~np.isfinite(by_cell).all(axis=1)
        if broken.any():
            for name, pool in self._pools.items():
                by_cell = pool[: self._tile_count].reshape(len(broken), -1)
                by_cell[broken] = self._defaults[name]
        return int(np.count_nonzero(broken))

    def _cover(self, tile_rows: IndexArray, tile_columns: IndexArray) -> None:
        """Add the tiles at these places that do not exist yet."""
        if len(tile_rows) == 0:
            return
        self._stretch_directory(
            int(tile_rows.min()),
            int(tile_rows.max()),
            int(tile_columns.min()),
            int(tile_columns.max()),
        )
        rows = tile_rows - self._directory_origin[0]
        columns = tile_columns - self._directory_origin[1]
        missing = self._directory[rows, columns] < 0
        if not missing.any():
            return
        width = self._directory.shape[1]
        places = np.unique(rows[missing] * width + columns[missing])
        self._reserve(self._tile_count + len(places))
        new = np.arange(self._tile_count, self._tile_count + len(places))
        self._directory[places // width, places % width] = new
        self._tile_count += len(places)

    def _stretch_directory(self, top: int, bottom: int, left: int, right: int) -> None:
        """Make the directory cover these tile rows and columns, old ones staying where they are."""
        rows, columns = self._directory.shape
        first_row, first_column = self._directory_origin
        if rows:
            top, left = min(top, first_row), min(left, first_column)
            bottom = max(bottom, first_row + rows - 1)
            right = max(right, first_column + columns - 1)
        shape = (bottom - top + 1, right - left + 1)
        if shape == (rows, columns):
            return
        directory = np.full(shape, -1, dtype=np.intp)
        directory[
            first_row - top : first_row - top + rows,
            first_column - left : first_column - left + columns,
        ] = self._directory if rows else -1
        self._directory, self._directory_origin = directory, (top, left)

    def _reserve(self, tiles: int) -> None:
        """Room for `tiles` tiles; growing by half makes growth cheap on the whole."""
        for name, pool in self._pools.items():
            if tiles > len(pool):
                extra = max(tiles, len(pool) + len(pool) // 2) - len(pool)
                blank = np.full((extra, pool.shape[1]), self._defaults[name], dtype=np.float32)
                self._pools[name] = np.concatenate([pool, blank])


def _is_finite(values: NDArray[np.float32]) -> bool:
    """Whether all numbers are finite: their squares' sum is, or, slower, each of them."""
    return math.isfinite(np.vdot(values, values)) or bool(np.isfinite(values).all())
