"""Where the cells of the map are in memory, and how they are divided."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.grid import TILE_SIDE
from usmap_ros.numerics.compiled import inlined

#: A tile's side as a power of two: to shift is a tenth of the work of a division.
TILE_BITS = TILE_SIDE.bit_length() - 1
_INSIDE = TILE_SIDE - 1
#: Quarters of a cell: what stands in a cell is placed to half its side.
QUARTERS = 4
#: Range bins that a cell can reach into.
CELL_BINS = 16


class Tiles(NamedTuple):
    """Where the cells of a tiled grid are in memory; see `usmap_ros.mapping.grid.TiledGrid`.

    Parameters
    ----------
    directory : (tile rows, tile columns) integer array
        Number of each tile; -1 where there is none.
    first_row, first_column : int
        Of the directory, in tiles.
    resolution_m : float
        Side of a cell.
    """

    directory: NDArray[np.intp]
    first_row: int
    first_column: int
    resolution_m: float


@inlined
def slot_at(row: int, column: int, tiles: Tiles) -> int:
    """Slot of a cell; -1 where there is no tile."""
    tile_row = (row >> TILE_BITS) - tiles.first_row
    tile_column = (column >> TILE_BITS) - tiles.first_column
    if tile_row < 0 or tile_column < 0:
        return -1
    if tile_row >= tiles.directory.shape[0] or tile_column >= tiles.directory.shape[1]:
        return -1
    tile = tiles.directory[tile_row, tile_column]
    if tile < 0:
        return -1
    inside = ((row & _INSIDE) << TILE_BITS) | (column & _INSIDE)
    return int((tile << 2 * TILE_BITS) | inside)


@inlined
def slot_beside(slot: int, row: int, column: int, rows: int, columns: int, tiles: Tiles) -> int:
    """Slot of a cell so many rows and columns, one at the most, from another; -1 if there is none.

    Parameters
    ----------
    slot, row, column : int
        Of the other.
    rows, columns : int
        How far it is.
    tiles : Tiles
        Where the grid's cells are in memory.
    """
    inside_row, inside_column = ((slot >> TILE_BITS) & _INSIDE) + rows, (slot & _INSIDE) + columns
    if 0 <= inside_row < TILE_SIDE and 0 <= inside_column < TILE_SIDE:
        return slot + (rows << TILE_BITS) + columns
    return slot_at(row + rows, column + columns, tiles)
