"""Key pings: so few that each place is still looked at often enough from each side.

Where robots go round and round, most pings say again what others said.  Until it is settled what
hides what, those that add looks are enough; then all count.
"""

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.ping_table import GREATEST_RANGE, HALF_ANGLE, HEADING, PingTable, X, Y
from usmap_ros.numerics.arrays import FloatArray

#: Side of the squares in which looks are counted, and sectors of direction to look from.
SQUARE_M, SECTORS = 0.5, 8
#: Looks that are enough for a square from one sector, and the share of what a ping looks at that
#: must still lack some, for it to be a key ping.
ENOUGH_LOOKS, LACKING_SHARE = 6.0, 0.2
#: Rays across a beam on which squares are counted, and pings whose squares are worked out at once.
RAYS, BATCH = 5, 256


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
    looks = [
        own
        for first in range(0, len(pings), BATCH)
        for own in _looks(numbers[first : first + BATCH], low, columns)
    ]
    counts = np.zeros(1 + max((int(own.max()) for own in looks if len(own)), default=0))
    chosen = []
    for index in _spread(len(pings)):
        own = looks[index]
        if np.count_nonzero(counts[own] < ENOUGH_LOOKS) > LACKING_SHARE * len(own):
            counts[own] += weights[index]
            chosen.append(index)
    return np.sort(np.array(chosen, np.int64))


def _looks(numbers: FloatArray, low: NDArray[np.int64], columns: int) -> list[NDArray[np.int64]]:
    """Numbers of squares, each with a sector, that each of some pings looks at.

    Parameters
    ----------
    numbers : (pings, numbers) array
        Of these pings.
    low : (2,) int64 array
        Column and row of the square from which on they are numbered.
    columns : int
        Squares of a row.
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
    return [np.unique(own[:, heard]) for own, heard in zip(places, inside, strict=True)]


def _spread(count: int) -> list[int]:
    """Numbers up to a count, such that the first ones are spread evenly over all."""
    bits = max(1, (count - 1).bit_length())
    turned = [int(f"{number:0{bits}b}"[::-1], 2) for number in range(1 << bits)]
    return [number for number in turned if number < count]
