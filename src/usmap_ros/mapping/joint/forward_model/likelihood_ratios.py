"""Inverse sensor model: how much worse each ping would be explained without a cell."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.cell_parts import (
    BEYOND,
    BLOCK_BINS,
    BLOCK_CELLS,
    CELL_BINS,
    Cells,
    Levels,
    Parts,
    add_up,
    divide,
    know_bins,
    neighbours,
    probability_below,
    sum_up,
)
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.visibility.projection import Projection
from usmap_ros.mapping.ping_table import BIN_M, LEAST_RANGE, NOISE, RANGE_STD, PingTable, X, Y
from usmap_ros.numerics.compiled import compiled, inlined
from usmap_ros.numerics.elementary import log32

#: What rounding may make of one.
NEARLY_ONE = 0.999
#: What one range bin says at the most: a single echo may come from elsewhere.
MOST_A_BIN = 3.0
#: What one ping says against a cell at the most, where one missed echo is not one piece of news.
MOST_A_PING = 24.0 * MOST_A_BIN
#: Range bins that are weighed at once: as many as let the compiler have the processor do that.
TOGETHER = 16
#: Echoes within so many metres crowd around a cell's.
CROWD_M = 0.5


class LikelihoodRatios(NamedTuple):
    """What some pings say of cells, a row for each pair; a ping's rows lie one behind the other."""

    #: (rows,) int32 array: which of the `Cells`.
    cell: NDArray[np.int32]
    #: (rows,) float32 array: log-likelihood ratio with the cell to without it, and with its eight
    #: neighbours.
    own: NDArray[np.float32]
    block: NDArray[np.float32]
    #: (rows,) float32 array: largest share of the block's in what is expected of a bin with an
    #: echo.
    share: NDArray[np.float32]
    #: (rows,) float32 array: 1 if there is such a bin.
    asked: NDArray[np.float32]
    #: (rows,) float32 array: echoes around the cell's range.
    crowd: NDArray[np.float32]
    #: (pings + 1,) int64 array: first row of each ping, and the end.
    start: NDArray[np.int64]


@compiled
def weigh_pings(
    table: PingTable,
    pings: NDArray[np.int64],
    rows: Projection,
    power: NDArray[np.float32],
    expected: NDArray[np.float32],
    cells: Cells,
    field: Field,
) -> LikelihoodRatios:
    """What each of some pings says of the cells that it may hear.

    Parameters
    ----------
    table, pings, rows, power, expected
        As in `usmap_ros.mapping.joint.forward_model.power_estimation.expect_powers`, after it.
    cells : Cells
        Of the scatterers; those that are asked are weighed.
    field : Field
        All cells.
    """
    most, size = 1, np.int64(rows.start[-1])
    for index in range(len(pings)):
        most = max(most, rows.start[index + 1] - rows.start[index])
    parts = Parts(
        np.full(len(cells.number) + 1, -1, np.int32), np.empty(most, np.int32),
        np.empty(most, np.int32), np.empty(most, np.int32),
        np.empty((most, CELL_BINS), np.float32), np.empty(most, np.float32),
        np.empty(most, np.float32),
    )  # fmt: skip
    ratios = LikelihoodRatios(
        np.empty(size, np.int32), np.empty(size, np.float32), np.empty(size, np.float32),
        np.empty(size, np.float32), np.empty(size, np.float32), np.empty(size, np.float32),
        np.zeros(len(pings) + 1, np.int64),
    )  # fmt: skip
    bins = expected.shape[1] + BEYOND
    known = Levels(
        np.empty(bins, np.float32), np.empty(bins, np.float32), np.empty(bins, np.float32),
        np.empty(bins, np.float32), np.empty(bins, np.float32), np.empty(bins, np.float32),
        np.empty(bins, np.float32), np.zeros(bins, np.int32),
    )  # fmt: skip
    block = np.empty(BLOCK_BINS + CELL_BINS, np.float32)
    beside = np.empty(BLOCK_CELLS + 1, np.int64)
    for index in range(len(pings)):
        ping, levels, start = pings[index], expected[index], ratios.start[index]
        know_bins(table, ping, levels, known)
        count = divide(table, ping, rows, index, power, cells, parts)
        sum_up(count, known, parts)
        end = _compare(table, ping, cells, count, parts, known, beside, block, start, ratios)
        _count_crowd(table, ping, field, cells, known.echoes, start, end, ratios)
        for entry in range(count):
            parts.place[parts.cell[entry]] = -1
        ratios.start[index + 1] = end
    return ratios


@inlined
def _compare(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    table: PingTable,
    ping: int,
    cells: Cells,
    count: int,
    parts: Parts,
    known: Levels,
    beside: NDArray[np.int64],
    block: NDArray[np.float32],
    start: int,
    ratios: LikelihoodRatios,
) -> int:
    """Weigh what is expected with cells, and with blocks of nine, against that without them.

    Parameters
    ----------
    table, ping, cells, count, parts
        The ping, and what each of so many cells returns.
    known : Levels
        Of the ping.
    beside, block : (BLOCK_CELLS + 1,) int64 array, (BLOCK_BINS + CELL_BINS,) float32 array
        Room for the places of a block's cells, and for what it returns.
    start, ratios : int, LikelihoodRatios
        Row of the first cell that is asked; cells, ratios, shares and whether there are echoes are
        set.

    Returns
    -------
    end : int
        Row after that of the last one.
    """
    numbers, one, none = table.numbers[ping], np.float32(NEARLY_ONE), np.float32(0.0)
    noise = np.float32(numbers[NOISE])
    # One echo that is missed is missed in several bins: where ranges are uncertain, that is one
    # piece of news, for it may have come from beside them.
    is_blurred = numbers[RANGE_STD] > numbers[BIN_M]
    lowest = -np.float32(MOST_A_BIN) if is_blurred else -np.float32(MOST_A_PING)
    row = start
    for entry in range(count):
        cell, own, whole, share = parts.cell[entry], none, none, none
        if not cells.are_asked[cell]:
            continue
        if parts.largest[entry] >= one:
            begin, length = parts.begin[entry], parts.length[entry]
            own = _weigh(parts.power[entry], begin, length, noise, known)
        near = neighbours(cells.block[cell], parts.place, beside)
        of_echoes, largest = none, none
        for which in range(near):
            of_echoes += parts.echoes[beside[which]]
            largest += parts.largest[beside[which]]
        if largest >= one:
            first, end = add_up(parts, near, beside, block)
            length = min(end - first, BLOCK_BINS)
            whole = _weigh(block, first, length, noise, known)
            share = _largest_share(block, first, length, known) if of_echoes > none else none
        ratios.own[row], ratios.block[row] = max(own, lowest), max(whole, lowest)
        ratios.share[row], ratios.asked[row] = share, 1.0 if of_echoes > none else 0.0
        ratios.cell[row] = cell
        row += 1
    return row


@inlined
def _weigh(
    parts: NDArray[np.float32], first: int, length: int, noise: np.float32, known: Levels
) -> np.float32:
    """Log-likelihood ratio with contributions to range bins to without.

    Parameters
    ----------
    parts : (length,) float32 array
        Contributions, 0 up to the next multiple of `TOGETHER`.
    first, length : int
        First bin, and how many follow.
    noise, known : float, Levels
        Of the ping.
    """
    most, one, none = np.float32(MOST_A_BIN), np.float32(1.0), np.float32(0.0)
    total = none
    for begin in range(0, length, TOGETHER):
        for place in range(TOGETHER):
            # Without a sign, they need not be compared with zero.
            own, b = np.uint64(begin + place), np.uint64(first + begin + place)
            part, level, is_echo = parts[own], known.level[b], known.is_echo[b] > none
            without = max(level - part, noise)
            per_level, per_rest = one / level, one / without
            below = probability_below(known.limit[b] * per_rest)
            logarithm = log32(without * per_level if is_echo else below)
            of_echo = known.power[b] * (per_rest - per_level) + logarithm
            ratio = of_echo if is_echo else known.silent[b] - logarithm
            ratio = min(max(ratio, -most), most)
            total += ratio if part >= known.least[b] else none
    return total


@inlined
def _largest_share(
    parts: NDArray[np.float32], first: int, length: int, known: Levels
) -> np.float32:
    """Largest share of contributions in what is expected of a bin with an echo; as `_weigh`."""
    none = np.float32(0.0)
    largest = none
    for place in range(length):
        own, b = np.uint64(place), np.uint64(first + place)
        share = parts[own] * known.is_echo[b] / known.level[b]
        largest = max(largest, share if parts[own] >= known.least[b] else none)
    return largest


@inlined
def _count_crowd(
    table: PingTable,
    ping: int,
    field: Field,
    cells: Cells,
    echoes: NDArray[np.int32],
    start: int,
    end: int,
    ratios: LikelihoodRatios,
) -> None:
    """Set how many echoes crowd around the ranges of the cells in some rows."""
    numbers, bins = table.numbers[ping], table.bins[ping]
    around = int(CROWD_M / numbers[BIN_M])
    for entry in range(start, end):
        row, column = divmod(cells.number[ratios.cell[entry]], field.columns)
        x = (field.first_column + column + 0.5) * field.resolution_m - numbers[X]
        y = (field.first_row + row + 0.5) * field.resolution_m - numbers[Y]
        middle = int((math.sqrt(x * x + y * y) - numbers[LEAST_RANGE]) / numbers[BIN_M])
        near, far = min(bins, max(0, middle - around)), min(bins, max(0, middle + around))
        ratios.crowd[entry] = echoes[far] - echoes[near]
