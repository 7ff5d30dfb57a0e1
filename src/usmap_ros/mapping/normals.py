"""In which direction surfaces face: across the line of cells, to where they were heard from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import BoolArray, FloatArray, IndexArray

#: Cells to either side that tell the direction of a line: a window of 7 by 7.
REACH_CELLS = 3
#: Variance along a line, in squared cells, that three cells in a row do not have, and four have.
LEAST_LENGTH_VARIANCE = 1.0
#: Variance across a line, relative to that along it: what is thicker is a blob, or a corner.
MOST_THICKNESS = 0.25

#: Rows and columns from the middle of a window to its cells, and what moments there are made of:
#: 1, x, y, x², y², x y.
_Y, _X = np.indices((2 * REACH_CELLS + 1,) * 2).reshape(2, -1) - REACH_CELLS
_MONOMIALS = np.array([_X**0, _X, _Y, _X**2, _Y**2, _X * _Y], dtype=np.float64)
#: Cells whose windows are looked at at once.
_AT_ONCE = 4096
#: From a cell to those of its eight neighbours that come after it: rows, columns.
_ONWARD = ((0, 1), (1, -1), (1, 0), (1, 1))


def surface_normals(
    believed: BoolArray, weight: FloatArray, heard_from: FloatArray
) -> NDArray[np.float32]:
    """Direction in which the surface in each cell faces.

    The principal axes of the cells around one that hang together with it tell the direction of
    their line.  Of the two directions across it, the surface faces the one from which it was
    heard.  Where the cells form no line, as those of a lone pole do not, there is none.

    Parameters
    ----------
    believed : (rows, columns) bool array
        Cells that hold something.
    weight : (rows, columns) array
        How much each of them counts.
    heard_from : (rows, columns, 2) array
        Sum of the directions, x before y, from which each cell was heard, by how much that says.

    Returns
    -------
    normal_rad : (rows, columns) float32 array
        From the x axis towards the y axis, above -π and up to π; NaN where it is not known.
    """
    normal_rad = np.full(believed.shape, np.nan, np.float32)
    # NumPy finds places in one dimension ten times as fast as in two.
    rows, columns = np.divmod(np.flatnonzero(believed), believed.shape[1])
    moments, heard = _sums_around(believed, weight[rows, columns], heard_from[rows, columns])
    mass = np.maximum(moments[0], 1e-12)
    mean_x, mean_y = moments[1] / mass, moments[2] / mass
    xx = moments[3] / mass - mean_x**2
    yy = moments[4] / mass - mean_y**2
    xy = moments[5] / mass - mean_x * mean_y
    half_difference = np.hypot(0.5 * (xx - yy), xy)
    along, across = 0.5 * (xx + yy) + half_difference, 0.5 * (xx + yy) - half_difference
    direction = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    x, y = -np.sin(direction), np.cos(direction)
    side = x * heard[0] + y * heard[1]
    known = (along >= LEAST_LENGTH_VARIANCE) & (across <= MOST_THICKNESS * along) & (side != 0.0)
    facing = np.arctan2(y * np.sign(side), x * np.sign(side))
    normal_rad[rows[known], columns[known]] = facing[known]
    return normal_rad


def connected_parts(beside: CellsBeside) -> IndexArray:
    """Which part each cell is of, where parts hang together by sides or corners.

    Every cell begins as a part of its own; neighbours take over the lower number, and numbers that
    of the cell which they name, until nothing changes.

    Parameters
    ----------
    beside : CellsBeside
        Of the cells that make up the parts, with a reach of one cell or more.

    Returns
    -------
    numbers : (n,) int array
        Of the cells inside, row by row: equal within a part.
    """
    pairs = []
    for row, column in _ONWARD:
        neighbour = beside(row, column)
        there = np.flatnonzero(neighbour >= 0)
        pairs.append(np.stack([there, neighbour[there]]))
    first, second = np.concatenate(pairs, axis=1)
    parts = np.arange(len(beside))
    while (parts[first] != parts[second]).any():
        lower = np.minimum(parts[first], parts[second])
        np.minimum.at(parts, parts[first], lower)
        np.minimum.at(parts, parts[second], lower)
        while (parts[parts] != parts).any():
            parts = parts[parts]
    return parts


class CellsBeside:
    """Finds the cells beside others, among those inside, which are few of a large map.

    Parameters
    ----------
    inside : (rows, columns) bool array
        Cells among which neighbours are looked for.
    reach : int
        How far it looks.
    """

    def __init__(self, inside: BoolArray, reach: int) -> None:
        rows, columns = np.divmod(np.flatnonzero(inside), inside.shape[1])
        height, self._width = inside.shape[0] + 2 * reach, inside.shape[1] + 2 * reach
        self._places = (rows + reach) * self._width + columns + reach
        self._numbers = np.full(height * self._width, -1, dtype=np.int32)
        self._numbers[self._places] = np.arange(len(rows))

    def __len__(self) -> int:
        """Count the cells inside."""
        return len(self._places)

    def __call__(self, rows: int, columns: int) -> IndexArray:
        """Number of the cell so far from each; -1 where there is none."""
        numbers: IndexArray = self._numbers[self._places + rows * self._width + columns]
        return numbers

    def window(self, some: slice) -> IndexArray:
        """Numbers of the cells at all places of a window around some, shape (offsets, n)."""
        steps = _Y * self._width + _X
        numbers: IndexArray = self._numbers[self._places[some] + steps[:, np.newaxis]]
        return numbers


def _sums_around(
    believed: BoolArray, weight: FloatArray, heard_from: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Sums over the cells around each that hang together with it.

    Parameters
    ----------
    believed : (rows, columns) bool array
        Of which n are.
    weight, heard_from : (n,) and (n, 2) arrays
        Of each believed cell: its weight, and the direction it was heard from.

    Returns
    -------
    moments : (6, n) array
        Of the weight: 1, x, y, x², y², x y, in cells from the one in the middle.
    heard : (2, n) array
        Of the directions from which they were heard.
    """
    beside = CellsBeside(believed, REACH_CELLS)
    parts = connected_parts(beside)
    moments, heard = np.zeros((6, len(parts))), np.zeros((2, len(parts)))
    # Cells by the thousand: those of a large map, with all around them, would take gigabytes.
    for first in range(0, len(parts), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        there, own = beside.window(some), parts[some]
        offset, middle = np.nonzero((there >= 0) & (parts[there] == own))
        other = there[offset, middle]
        share = weight[other]
        for power, moment in zip(_MONOMIALS, moments, strict=True):
            moment[some] = np.bincount(middle, share * power[offset], len(own))
        for direction, component in zip(heard_from.T, heard, strict=True):
            component[some] = np.bincount(middle, share * direction[other], len(own))
    return moments, heard
