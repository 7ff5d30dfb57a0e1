"""Islands: pings that cannot see the same cells are problems of their own."""

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.pings.cone import EchoCone

#: Side of the squares by which areas are told apart.
SQUARE_M = 2.0


def squares_of(cone: EchoCone) -> tuple[int, int, int, int]:
    """First and last row, and first and last column, of squares that a ping may reach into."""
    x_m, y_m = (float(value) for value in cone.pose.position_m[:2])
    reach_m = cone.transducer.max_range_m
    first_row, last_row, first_column, last_column = (
        math.floor(edge_m / SQUARE_M)
        for edge_m in (y_m - reach_m, y_m + reach_m, x_m - reach_m, x_m + reach_m)
    )
    return first_row, last_row, first_column, last_column


def joined(squares: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number of the group of each of some rectangles of squares, by which of them overlap.

    Parameters
    ----------
    squares : (rectangles, 4) int64 array
        By `squares_of`.
    """
    first_row, last_row, first_column, last_column = squares.T
    group_of, groups = np.full(len(squares), -1), 0
    for first in range(len(squares)):
        if group_of[first] >= 0:
            continue
        group_of[first], waiting = groups, [first]
        while waiting:
            one = waiting.pop()
            beside = (first_row <= last_row[one]) & (last_row >= first_row[one])
            beside &= (first_column <= last_column[one]) & (last_column >= first_column[one])
            new = np.flatnonzero(beside & (group_of < 0))
            group_of[new] = groups
            waiting += new.tolist()
        groups += 1
    return group_of
