"""Key pings: so few that each place is still looked at often enough from each side.

Where robots go round and round, most pings say again what others said.  Until it is settled what
hides what, those that add looks are enough; then all count.
"""

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.ping_table import GREATEST_RANGE, HALF_ANGLE, HEADING, PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled

#: Side of the squares in which looks are counted, and sectors of direction to look from.
SQUARE_M, SECTORS = 0.5, 8
#: Looks that are enough for a square from one sector, and the share of what a ping looks at that
#: must still lack some, for it to be a key ping.
ENOUGH_LOOKS, LACKING_SHARE = 6.0, 0.2
#: Rays across a beam on which squares are counted.
RAYS = 5


def key_pings(
    table: PingTable, pings: NDArray[np.int64], weights: NDArray[np.float32]
) -> NDArray[np.int64]:
    """Places of pings that together look at everything often enough.

    Parameters
    ----------
    table : PingTable
        Pings.
    pings : (pings,) integer array
        Rows of those that count.
    weights : (pings,) float32 array
        How many looks each is.

    Returns
    -------
    chosen : (key pings,) integer array
        Which of them, in their order.
    """
    numbers = table.numbers[pings]
    # Squares are numbered from the lowest that any of them may look at.
    places_m, farthest_m = numbers[:, [X, Y]], numbers[:, GREATEST_RANGE].max() + SQUARE_M
    low = np.floor((places_m.min(axis=0) - farthest_m) / SQUARE_M).astype(np.int64)
    high = np.floor((places_m.max(axis=0) + farthest_m) / SQUARE_M).astype(np.int64)
    columns = int(high[0] - low[0]) + 1
    looks = _looks(numbers, low, columns)
    return np.flatnonzero(_are_chosen(looks, weights, _spread(len(pings)), int(looks.max())))


@compiled
def _are_chosen(
    looks: NDArray[np.int64], weights: NDArray[np.float32], order: NDArray[np.int64], last: int
) -> BoolArray:
    """Which pings look at something that lacks looks when it is their turn.

    Parameters
    ----------
    looks : (pings, looks) int64 array
        By `_looks`.
    weights : (pings,) float32 array
        How many looks each is.
    order : (pings,) int64 array
        Whose turn it is.
    last : int
        Number of the last square.
    """
    counts, seen_by = np.zeros(last + 1), np.full(last + 1, -1, np.int64)
    are_chosen = np.zeros(len(looks), np.bool_)
    for index in order:
        squares, lacking = 0, 0
        for square in looks[index]:
            if square >= 0 and seen_by[square] != index:
                seen_by[square] = index
                squares += 1
                lacking += counts[square] < ENOUGH_LOOKS
        are_chosen[index] = lacking > LACKING_SHARE * squares
        if are_chosen[index]:
            for square in looks[index]:
                # Each counts once, however many rays cross it.
                if square >= 0 and seen_by[square] == index:
                    seen_by[square] = -1
                    counts[square] += weights[index]
    return are_chosen


def _looks(numbers: FloatArray, low: NDArray[np.int64], columns: int) -> NDArray[np.int64]:
    """Numbers of squares, each with a sector, that rays of pings cross; -1 beyond their ends.

    Parameters
    ----------
    numbers : (pings, numbers) array
        Of the pings.
    low : (2,) int64 array
        Column and row of the square from which on they are numbered.
    columns : int
        Squares of a row.

    Returns
    -------
    looks : (pings, looks) int64 array
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
    places = ((row - low[1]) * columns + column - low[0]) * SECTORS + sector
    inside = ranges_m <= np.maximum(reach_m, SQUARE_M)[:, np.newaxis]
    return np.where(inside[:, np.newaxis], places, -1).reshape(len(numbers), -1)


def _spread(count: int) -> NDArray[np.int64]:
    """Numbers up to a count, such that the first ones are spread evenly over all."""
    bits = max(1, (count - 1).bit_length())
    turned = [int(f"{number:0{bits}b}"[::-1], 2) for number in range(1 << bits)]
    return np.array([number for number in turned if number < count], np.int64)
