"""Candidates: cells that may well have returned echoes, by what pings heard at their distance."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.visibility.beams import columns_in_beam, rows_in_reach
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.ping_bins import GAIN_STEPS, SILENCE
from usmap_ros.mapping.ping_table import (
    ABSORPTION,
    AXIS_X,
    AXIS_Y,
    AXIS_Z,
    BIN_M,
    COS_HALF_ANGLE,
    GREATEST_RANGE,
    LEAST_RANGE,
    RANGE_STD,
    RISE,
    PingTable,
    X,
    Y,
)
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.compiled import compiled, inlined
from usmap_ros.numerics.elementary import exp32
from usmap_ros.processes.threads import for_each

#: Power of a usual object.
USUAL_POWER = 0.1
#: A cell starts with power if it may have returned so many echoes, and these are such a share of
#: the times that something in it would have been heard.
LEAST_HITS, LEAST_HIT_SHARE = 0.9, 0.12
#: Range bins to either side in which an echo may be a cell's, at the most.
MOST_BLUR_BINS = 12.0
#: Rows of cells whose hits one thread counts at a time.
HITS_BAND = 64


class _Row(NamedTuple):
    """Cells of a row as one ping sees them, by column."""

    #: (columns,) int32 arrays: range bins: the first in which an echo may be the cell's, and that
    #: of its middle.
    early: NDArray[np.int32]
    middle: NDArray[np.int32]
    #: (columns,) float32 array: the last in which one may be, with its fraction.
    late: NDArray[np.float32]
    #: (columns,) int32 array: place in the table of power gains.
    entry: NDArray[np.int32]
    #: (columns,) float32 array: power that a usual object returns, but for the beam; 0: the cell is
    #: not in the cone.
    loudness: NDArray[np.float32]


@compiled
def count_hits(
    table: PingTable,
    pings: NDArray[np.int64],
    weights: NDArray[np.float32],
    field: Field,
    hits: NDArray[np.float32],
    misses: NDArray[np.float32],
) -> None:
    """Count, for each cell, echoes that may be its, and silence where it would have been heard.

    Parameters
    ----------
    table, pings, field
        As in `usmap_ros.mapping.joint.visibility.ray_casting.cast_rays`.
    weights : (pings,) float32 array
        How much each counts.
    hits, misses : (rows, columns) float32 arrays
        Added to.
    """
    res, one = field.resolution_m, np.float32(1.0)
    seen = _Row(
        np.empty(field.columns, np.int32), np.empty(field.columns, np.int32),
        np.empty(field.columns, np.float32), np.empty(field.columns, np.int32),
        np.empty(field.columns, np.float32),
    )  # fmt: skip
    for index in range(len(pings)):
        ping, weight = pings[index], weights[index]
        numbers, bins = table.numbers[ping], table.bins[ping]
        bottom, top = rows_in_reach(numbers, field)
        for row in range(bottom, top):
            y_m = (field.first_row + row + 0.5) * res - numbers[Y]
            left, right = columns_in_beam(numbers, field, y_m)
            _see_row(numbers, bins, field, y_m, left, right, seen)
            for column in range(left, right):
                if seen.loudness[column] == 0.0:
                    continue
                if table.next_echo[ping, seen.early[column]] <= seen.late[column]:
                    hits[row, column] += weight
                    continue
                b = seen.middle[column]
                if table.kind[ping, b] == SILENCE:
                    gain = table.power_gain[ping, seen.entry[column]]
                    loud = gain * seen.loudness[column] / table.limit[ping, b]
                    misses[row, column] += weight * loud / (one + loud)


@inlined
def _see_row(
    numbers: FloatArray, bins: int, field: Field, y_m: float, left: int, right: int, seen: _Row
) -> None:
    """Set how a ping sees some cells of a row."""
    res, cos_half, bin_m = field.resolution_m, numbers[COS_HALF_ANGLE], numbers[BIN_M]
    origin = np.float32((field.first_column + left + 0.5) * res - numbers[X])
    side, y, one = np.float32(res), np.float32(y_m), np.float32(1.0)
    axis_x, risen = np.float32(numbers[AXIS_X]), np.float32(y_m * y_m + numbers[RISE] ** 2)
    up = np.float32(numbers[AXIS_Y] * y_m + numbers[AXIS_Z] * numbers[RISE])
    wide, to_entry = np.float32(cos_half * abs(cos_half)), np.float32(GAIN_STEPS / (1.0 - cos_half))
    least, reach = np.float32(numbers[LEAST_RANGE]), np.float32(numbers[GREATEST_RANGE])
    per_m, half_side = np.float32(1.0 / bin_m), np.float32(0.5 * res / bin_m)
    blur, most = np.float32(3.0 * (numbers[RANGE_STD] / bin_m) ** 2), np.float32(MOST_BLUR_BINS)
    absorption, nothing = np.float32(-numbers[ABSORPTION]), np.float32(0.0)
    for place in range(right - left):
        x = origin + np.float32(place) * side
        squared, ahead = x * x + risen, axis_x * x + up
        is_inside = (squared > least * least) & (squared < reach * reach)
        is_inside &= ahead * abs(ahead) > squared * wide
        squared = max(squared, least * least)
        distance = np.sqrt(squared)
        half_bins = half_side * (abs(x) + abs(y)) / distance
        middle = (distance - least) * per_m
        blurred = min(np.sqrt(half_bins * half_bins + blur), most)
        column = left + place
        seen.early[column] = min(int(max(middle - blurred, nothing)), bins)
        seen.middle[column] = min(int(middle), bins - 1)
        seen.late[column] = middle + blurred
        entry = int((one - ahead / distance) * to_entry)
        seen.entry[column] = min(max(entry, 0), GAIN_STEPS)
        loudness = np.float32(USUAL_POWER) / (squared * squared) * exp32(absorption * distance)
        seen.loudness[column] = loudness if is_inside else nothing


def count_all_hits(
    table: PingTable, pings: NDArray[np.int64], weights: NDArray[np.float32], field: Field
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Hits and misses of all cells; see `count_hits`."""
    hits, misses = (np.zeros(field.shape, np.float32) for _ in range(2))
    for_each(
        lambda band: count_hits(table, pings, weights, band[1], hits[band[0]], misses[band[0]]),
        field.bands(HITS_BAND),
    )
    return hits, misses


def candidates(hits: NDArray[np.float32], misses: NDArray[np.float32]) -> NDArray[np.int32]:
    """Cells that may well have returned echoes."""
    is_candidate = (hits >= LEAST_HITS) & (hits > LEAST_HIT_SHARE * (hits + misses))
    return np.flatnonzero(is_candidate).astype(np.int32)
