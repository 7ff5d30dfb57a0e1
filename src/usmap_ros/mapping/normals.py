"""In which direction surfaces face: across the line of cells, to where they were heard from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usmap_ros.arrays import BoolArray, FloatArray, IndexArray

#: Cells to either side that tell the direction of a line: a window of 7 by 7.
REACH_CELLS = 3
#: Variance along a line, in squared cells, that three cells in a row do not have, and four have.
LEAST_LENGTH_VARIANCE = 1.0
#: Variance across a line, relative to that along it: what is thicker is a blob, or a corner.
MOST_THICKNESS = 0.25

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
    rows, columns = np.nonzero(believed)
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


def connected_parts(inside: BoolArray) -> IndexArray:
    """Which part each cell is of, where parts hang together by sides or corners.

    Every cell begins as a part of its own; neighbours take over the lower number, and numbers that
    of the cell which they name, until nothing changes.

    Returns
    -------
    numbers : (n,) int array
        Of the cells inside, row by row: equal within a part.
    """
    beside = _Beside(inside, 1)
    pairs = []
    for row, column in _ONWARD:
        neighbour = beside(row, column)
        there = np.flatnonzero(neighbour >= 0)
        pairs.append(np.stack([there, neighbour[there]]))
    first, second = np.concatenate(pairs, axis=1)
    parts = np.arange(np.count_nonzero(inside))
    while (parts[first] != parts[second]).any():
        lower = np.minimum(parts[first], parts[second])
        np.minimum.at(parts, parts[first], lower)
        np.minimum.at(parts, parts[second], lower)
        while (parts[parts] != parts).any():
            parts = parts[parts]
    return parts


class _Beside:
    """Finds the cells beside others, among those inside, which are few of a large map.

    Parameters
    ----------
    inside : (rows, columns) bool array
        The cells.
    reach : int
        How far it looks.
    """

    def __init__(self, inside: BoolArray, reach: int) -> None:
        rows, columns = np.nonzero(inside)
        height, self._width = inside.shape[0] + 2 * reach, inside.shape[1] + 2 * reach
        self._places = (rows + reach) * self._width + columns + reach
        self._numbers = np.full(height * self._width, -1, dtype=np.int32)
        self._numbers[self._places] = np.arange(len(rows))

    def __call__(self, rows: int, columns: int) -> IndexArray:
        """Number of the cell so far from each; -1 where there is none."""
        numbers: IndexArray = self._numbers[self._places + rows * self._width + columns]
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
        Of those.

    Returns
    -------
    moments : (6, n) array
        Of the weight: 1, x, y, x², y², x y, in cells from the one in the middle.
    heard : (2, n) array
        Of the directions from which they were heard.
    """
    parts, beside = connected_parts(believed), _Beside(believed, REACH_CELLS)
    moments, heard = np.zeros((6, len(parts))), np.zeros((2, len(parts)))
    for y in range(-REACH_CELLS, REACH_CELLS + 1):
        for x in range(-REACH_CELLS, REACH_CELLS + 1):
            there = beside(y, x)
            share = weight[there] * ((there >= 0) & (parts[there] == parts))
            moments += share * np.array([[1.0], [x], [y], [x * x], [y * y], [x * y]])
            heard += share * heard_from[there].T
    return moments, heard
