"""Projection of scatterers onto the range bins of pings: where each may be heard, how loudly.

One row for each pair of a ping and a scatterer, which is a cell or a quarter of one.  Rows of a
ping lie one behind the other, and in them those of a cell.
"""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.visibility.beams import columns_in_beam, rows_in_reach
from usmap_ros.mapping.joint.visibility.field import QUARTERS, Field
from usmap_ros.mapping.joint.visibility.ray_casting import RAYS, STEPS
from usmap_ros.mapping.ping_bins import GAIN_STEPS
from usmap_ros.mapping.ping_table import (
    ABSORPTION,
    AXIS_X,
    AXIS_Y,
    AXIS_Z,
    BIN_M,
    COS_HALF_ANGLE,
    GREATEST_RANGE,
    HALF_ANGLE,
    HEADING,
    LEAST_RANGE,
    NOISE,
    RANGE_STD,
    RISE,
    PingTable,
    X,
    Y,
)
from usmap_ros.numerics.compiled import compiled, inlined
from usmap_ros.numerics.elementary import atan2_32, exp32

#: A cell hides nothing that lies within so many cells behind it: they answer together.
OWN_DEPTH_CELLS = 3.0
#: What would not reach this share of the noise, with `LOUD_POWER`, is left out.
LEAST_SHARE, LOUD_POWER = 0.03, 0.3
#: Range bins to either side over which a scatterer is blurred at the most.
MOST_BLUR_BINS = 6.0
#: The part of a cell that is all of it: quarters are 0 to 3.
ALL_OF_IT = QUARTERS
#: Middles of parts from that of their cell, and half their sides, in cells.
_RIGHT = np.array([-0.25, 0.25, -0.25, 0.25, 0.0], np.float32)
_UP = np.array([-0.25, -0.25, 0.25, 0.25, 0.0], np.float32)
_HALF_SIDE = np.array([0.25, 0.25, 0.25, 0.25, 0.5], np.float32)
#: Rows that there is room for at first, for each ping.
FIRST_ROWS = 1024


class Scatterers(NamedTuple):
    """What may return echoes, in the order of their cells."""

    #: (scatterers,) int32 array: of which each is a part.
    cell: NDArray[np.int32]
    #: (scatterers,) uint8 array: which quarter of it, or `ALL_OF_IT`.
    part: NDArray[np.uint8]


class Projection(NamedTuple):
    """Rows of some pings."""

    #: (rows,) int32 array: which one.
    scatterer: NDArray[np.int32]
    #: (rows,) float32 array: power in a whole bin, if it scatters with power 1.
    weight: NDArray[np.float32]
    #: (rows,) float32 arrays: range bins, with fractions, between which its power lies; within
    #: those of the ping.
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    #: (rows,) uint8 array: 1 if there is an echo between: silence in the other bins says nothing
    #: then, because what scatters echoes at once.
    heard: NDArray[np.uint8]
    #: (rows,) uint8 arrays: where in the tables of `cast_rays` it is seen what is left of the
    #: sound.
    ray: NDArray[np.uint8]
    step: NDArray[np.uint8]
    #: (pings + 1,) int64 array: first row of each ping, and the end.
    start: NDArray[np.int64]


def project(
    table: PingTable, pings: NDArray[np.int64], field: Field, scatterers: Scatterers
) -> Projection:
    """Project scatterers, without shadows.

    Parameters
    ----------
    table, pings, field
        As in `usmap_ros.mapping.joint.visibility.ray_casting.cast_rays`.
    scatterers : Scatterers
        All that there are.
    """
    first_cells = np.arange(field.rows + 1, dtype=np.int32) * field.columns
    begins = np.searchsorted(scatterers.cell, first_cells).astype(np.int64)
    start = np.zeros(len(pings) + 1, np.int64)
    projection, done = empty_rows(FIRST_ROWS * len(pings) + len(scatterers.cell), start), 0
    while True:
        done = _project(table, pings, field, scatterers, begins, projection, done)
        if done == len(pings):
            return projection
        # As many for all others as for those so far, and room for one that hears everything.
        filled = int(start[done])
        share = 1.1 * len(pings) / max(1, done)
        larger = empty_rows(int(share * filled) + 2 * len(projection.weight), start)
        pairs: Iterable[Any] = zip(projection[:-1], larger[:-1], strict=True)
        for old, new in pairs:
            new[:filled] = old[:filled]
        projection = larger


def empty_rows(size: int, start: NDArray[np.int64]) -> Projection:
    """Room for rows."""
    weight, low, high = (np.empty(size, np.float32) for _ in range(3))
    heard, ray, step = (np.empty(size, np.uint8) for _ in range(3))
    return Projection(np.empty(size, np.int32), weight, low, high, heard, ray, step, start)


class _Near(NamedTuple):
    """Scatterers in the cone of one ping: one float32 number each, but for which they are."""

    scatterer: NDArray[np.int32]
    x: NDArray[np.float32]
    y: NDArray[np.float32]
    squared: NDArray[np.float32]
    ahead: NDArray[np.float32]
    weight: NDArray[np.float32]
    off: NDArray[np.float32]


@compiled
def _project(
    table: PingTable,
    pings: NDArray[np.int64],
    field: Field,
    scatterers: Scatterers,
    begins: NDArray[np.int64],
    rows: Projection,
    first: int,
) -> int:
    """Project onto pings from the first on; returns the first for which there was no room."""
    most = len(scatterers.cell) + 1
    x, y, squared, ahead, weight, off = (
        np.empty(most, np.float32), np.empty(most, np.float32), np.empty(most, np.float32),
        np.empty(most, np.float32), np.empty(most, np.float32), np.empty(most, np.float32),
    )  # fmt: skip
    near = _Near(np.empty(most, np.int32), x, y, squared, ahead, weight, off)
    for index in range(first, len(pings)):
        start = rows.start[index]
        count = _in_cone(table, pings[index], field, scatterers, begins, near)
        if start + count > len(rows.weight):
            return index
        _set_loudness(table, pings[index], count, near)
        rows.start[index + 1] = _place(
            table, pings[index], scatterers, field.resolution_m, count, near, rows, start
        )
    return len(pings)


@inlined
def _in_cone(
    table: PingTable,
    ping: int,
    field: Field,
    scatterers: Scatterers,
    begins: NDArray[np.int64],
    near: _Near,
) -> int:
    """Set where the scatterers are that a ping's cone holds; returns how many."""
    res = field.resolution_m
    x0, y0 = table.numbers[ping, X], table.numbers[ping, Y]
    axis_x, axis_y = (
        np.float32(table.numbers[ping, AXIS_X]),
        np.float32(table.numbers[ping, AXIS_Y]),
    )
    axis_z, rise = table.numbers[ping, AXIS_Z], table.numbers[ping, RISE]
    risen, up = np.float32(rise * rise), np.float32(axis_z * rise)
    cos_half, least, reach = (
        table.numbers[ping, COS_HALF_ANGLE],
        table.numbers[ping, LEAST_RANGE],
        table.numbers[ping, GREATEST_RANGE],
    )
    wide = np.float32(cos_half * abs(cos_half))
    nearest, farthest = np.float32(least * least), np.float32(reach * reach)
    bottom, top = rows_in_reach(table.numbers[ping], field)
    side, count = np.float32(res), 0
    for row in range(bottom, top):
        y_m = (field.first_row + row + 0.5) * res - y0
        first, (left, right) = row * field.columns, columns_in_beam(table.numbers[ping], field, y_m)
        begin = first_from(scatterers.cell, begins[row], begins[row + 1], first + left)
        end = first_from(scatterers.cell, begin, begins[row + 1], first + right)
        cell_y, origin = np.float32(y_m), np.float32((field.first_column + 0.5) * res - x0)
        for scatterer in range(begin, end):
            part = scatterers.part[scatterer]
            column = np.float32(scatterers.cell[scatterer] - first)
            x = origin + (column + _RIGHT[part]) * side
            y = cell_y + _UP[part] * side
            squared = x * x + y * y + risen
            ahead = axis_x * x + axis_y * y + up
            near.scatterer[count], near.x[count], near.y[count] = scatterer, x, y
            near.squared[count], near.ahead[count] = squared, ahead
            is_inside = (squared > nearest) & (squared < farthest)
            count += is_inside & (ahead * abs(ahead) > squared * wide)
    return count


@inlined
def first_from(cells: NDArray[np.int32], begin: int, end: int, cell: int) -> int:
    """First place of some with this cell or one behind it."""
    while begin < end:
        middle = (begin + end) >> 1
        if cells[middle] < cell:
            begin = middle + 1
        else:
            end = middle
    return begin


@inlined
def _set_loudness(table: PingTable, ping: int, count: int, near: _Near) -> None:
    """Set weights by range and beam, and angles off the heading, of what is in a cone."""
    numbers = table.numbers[ping]
    cosine, sine = np.float32(math.cos(numbers[HEADING])), np.float32(math.sin(numbers[HEADING]))
    scale = np.float32(GAIN_STEPS / (1.0 - numbers[COS_HALF_ANGLE]))
    absorption, one = np.float32(-numbers[ABSORPTION]), np.float32(1.0)
    # Of numbers of 32 bits the processor takes as many at once as it can, but not from tables.
    for k in range(count):
        squared, x, y = near.squared[k], near.x[k], near.y[k]
        distance = np.sqrt(squared)
        near.weight[k] = exp32(absorption * distance) / (squared * squared)
        near.off[k] = atan2_32(cosine * y - sine * x, cosine * x + sine * y)
        near.ahead[k] = (one - near.ahead[k] / distance) * scale
    gains = table.power_gain[ping]
    for k in range(count):
        entry = near.ahead[k]
        at = np.uint64(min(max(int(entry), 0), GAIN_STEPS - 1))
        near.weight[k] *= gains[at] + (gains[at + 1] - gains[at]) * (entry - np.float32(at))


@inlined
def _place(
    table: PingTable,
    ping: int,
    scatterers: Scatterers,
    resolution_m: float,
    count: int,
    near: _Near,
    rows: Projection,
    start: int,
) -> int:
    """Set the rows of what is in a cone, if anything of it can be heard; returns their end."""
    half, least, reach, bin_m = (
        table.numbers[ping, HALF_ANGLE],
        table.numbers[ping, LEAST_RANGE],
        table.numbers[ping, GREATEST_RANGE],
        table.numbers[ping, BIN_M],
    )
    faintest = np.float32(LEAST_SHARE / LOUD_POWER * table.numbers[ping, NOISE])
    blur = np.float32(3.0 * (table.numbers[ping, RANGE_STD] / bin_m) ** 2)
    bins = table.bins[ping]
    per_m, begin_m = np.float32(1.0 / bin_m), np.float32(least)
    side, most_blur = np.float32(resolution_m / bin_m), np.float32(MOST_BLUR_BINS)
    to_ray, to_step = np.float32(0.5 * RAYS / half), np.float32(STEPS / reach)
    own_m, most = np.float32(OWN_DEPTH_CELLS * resolution_m), np.float32(bins)
    for k in range(count):
        weight = near.weight[k]
        if weight < faintest:
            continue
        distance = np.sqrt(near.squared[k])
        part = scatterers.part[near.scatterer[k]]
        half_bins = _HALF_SIDE[part] * side * (abs(near.x[k]) + abs(near.y[k])) / distance
        middle = (distance - begin_m) * per_m
        blurred = max(min(np.sqrt(half_bins * half_bins + blur), most_blur), half_bins)
        echo = table.next_echo[ping, min(int(max(middle - blurred, np.float32(0.0))), bins)]
        heard = echo <= middle + blurred
        if heard and table.bearing_weight[ping, echo] > 0.0:
            beside = near.off[k] - table.bearing[ping, echo]
            weight *= exp32(-table.bearing_weight[ping, echo] * beside * beside)
            if weight < faintest:
                continue
        around = blurred if heard else half_bins
        low, high = max(middle - around, np.float32(0.0)), min(middle + around, most)
        if low >= high:
            continue
        rows.scatterer[start], rows.heard[start] = near.scatterer[k], heard
        rows.weight[start] = np.float32(0.5) * weight / half_bins
        rows.low[start], rows.high[start] = low, high
        rows.ray[start] = min(max(int((near.off[k] + np.float32(half)) * to_ray), 0), RAYS - 1)
        rows.step[start] = min(max(int((distance - own_m) * to_step), 0), STEPS - 1)
        start += 1
    return start
