"""How often each place was looked at from each side: in squares, by sectors of direction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.ping_table import GREATEST_RANGE, HALF_ANGLE, HEADING, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled

#: Side of the squares in which looks are counted, and sectors of direction to look from.
SQUARE_M, SECTORS = 0.5, 8
#: Looks that are enough for a square from one sector, and the share of what a ping looks at that
#: lacks some, up to which the ping says again what others said.
ENOUGH_LOOKS, LACKING_SHARE = 6.0, 0.2
#: Rays across a beam on which squares are counted.
RAYS = 5


class Looks(NamedTuple):
    """Looks of some pings; nothing changes the array, which others may have, too."""

    #: Row and column of the first square, counted from the origin.
    first: tuple[int, int]
    #: (rows, columns, SECTORS) array.
    counts: FloatArray

    @classmethod
    def of_none(cls, numbers: FloatArray) -> Looks:
        """No look at any square that some pings may look at.

        Parameters
        ----------
        numbers : (pings, numbers) array
            As in a `PingTable`.
        """
        places_m, farthest_m = numbers[:, [Y, X]], numbers[:, GREATEST_RANGE].max() + SQUARE_M
        first = np.floor((places_m.min(axis=0) - farthest_m) / SQUARE_M).astype(np.int64)
        last = np.floor((places_m.max(axis=0) + farthest_m) / SQUARE_M).astype(np.int64)
        row, column = first.tolist()
        return cls((row, column), np.zeros((*(last - first + 1), SECTORS)))

    def reaching(self, numbers: FloatArray) -> Looks:
        """The same, or where some pings may look at other squares, the same with those."""
        other = Looks.of_none(numbers)
        first = np.minimum(self.first, other.first)
        sizes = [np.add(each.first, each.counts.shape[:2]) for each in (self, other)]
        size = np.maximum(*sizes) - first
        if tuple(size) == self.counts.shape[:2]:
            return self
        counts = np.zeros((*size, SECTORS))
        (row, column), (rows, columns) = self.first - first, self.counts.shape[:2]
        counts[row : row + rows, column : column + columns] = self.counts
        row, column = first.tolist()
        return Looks((row, column), counts)

    def of_all(self, numbers: FloatArray, weights: NDArray[np.float32]) -> Looks:
        """With the looks of some pings.

        Parameters
        ----------
        numbers : (pings, numbers) array
            As in a `PingTable`; all that they look at is among the squares.
        weights : (pings,) float32 array
            How many looks each is.
        """
        return self._with(numbers, weights, np.arange(len(numbers)), np.inf)[1]

    def of_lacking(
        self, numbers: FloatArray, weights: NDArray[np.float32], order: NDArray[np.int64]
    ) -> tuple[BoolArray, Looks]:
        """With the looks of those pings which look at something that lacks looks.

        Parameters
        ----------
        numbers, weights
            As in `of_all`.
        order : (pings,) int64 array
            Whose turn it is.

        Returns
        -------
        are_lacking : (pings,) bool array
            Which do when it is their turn.
        looks : Looks
            With theirs.
        """
        return self._with(numbers, weights, order, ENOUGH_LOOKS)

    def _with(
        self,
        numbers: FloatArray,
        weights: NDArray[np.float32],
        order: NDArray[np.int64],
        enough: float,
    ) -> tuple[BoolArray, Looks]:
        counts = self.counts.copy()
        are_lacking = _take_turns(self._squares(numbers), weights, order, enough, counts.ravel())
        return are_lacking, self._replace(counts=counts)

    def _squares(self, numbers: FloatArray) -> NDArray[np.int64]:
        """Numbers of squares, each with a sector, that rays of pings cross; -1 beyond their ends.

        Returns
        -------
        squares : (pings, squares) int64 array
            Some of them more than once.
        """
        reach_m = numbers[:, GREATEST_RANGE]
        ranges_m = SQUARE_M * np.arange(1, 1 + max(1, int(reach_m.max() / SQUARE_M)))
        across = np.linspace(-1.0, 1.0, RAYS) * numbers[:, HALF_ANGLE, np.newaxis]
        bearings = (numbers[:, HEADING, np.newaxis] + across)[:, :, np.newaxis]
        x_m, y_m = (numbers[:, at, np.newaxis, np.newaxis] for at in (X, Y))
        column = np.floor((x_m + ranges_m * np.cos(bearings)) / SQUARE_M).astype(np.int64)
        row = np.floor((y_m + ranges_m * np.sin(bearings)) / SQUARE_M).astype(np.int64)
        sector = np.floor(bearings * (SECTORS / (2.0 * np.pi))).astype(np.int64) % SECTORS
        of_row = (row - self.first[0]) * self.counts.shape[1]
        squares = (of_row + column - self.first[1]) * SECTORS + sector
        inside = ranges_m <= np.maximum(reach_m, SQUARE_M)[:, np.newaxis]
        return np.where(inside[:, np.newaxis], squares, -1).reshape(len(numbers), -1)


@compiled
def _take_turns(
    squares: NDArray[np.int64],
    weights: NDArray[np.float32],
    order: NDArray[np.int64],
    enough: float,
    counts: FloatArray,
) -> BoolArray:
    """Which pings look at something that lacks looks when it is their turn; theirs are counted.

    Parameters
    ----------
    squares : (pings, squares) int64 array
        That each looks at, by their number; -1 is none.
    weights : (pings,) float32 array
        How many looks each is.
    order : (pings,) int64 array
        Whose turn it is.
    enough : float
        Looks that are.
    counts : (numbers,) array
        Looks at each square so far; added to.
    """
    seen_by, are_lacking = np.full(len(counts), -1, np.int64), np.zeros(len(squares), np.bool_)
    for index in order:
        own, lacking = 0, 0
        for square in squares[index]:
            if square >= 0 and seen_by[square] != index:
                seen_by[square] = index
                own += 1
                lacking += counts[square] < enough
        are_lacking[index] = lacking > LACKING_SHARE * own
        if are_lacking[index]:
            for square in squares[index]:
                # Each counts once, however many rays cross it.
                if square >= 0 and seen_by[square] == index:
                    seen_by[square] = -1
                    counts[square] += weights[index]
    return are_lacking
