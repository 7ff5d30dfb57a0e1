"""Inverse sensor model: how much worse each ping would be explained without a cell."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.cell_parts import (
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
from usmap_ros.mapping.joint.visibility.field import (
    BIN_M,
    LEAST_RANGE,
    NOISE,
    RANGE_STD,
    Field,
    X,
    Y,
)
from usmap_ros.mapping.joint.visibility.projection import Projection
from usmap_ros.mapping.looks import Looks
from usmap_ros.numerics.compiled import compiled, inlined
from usmap_ros.numerics.elementary import log32

#: What rounding may make of one.
NEARLY_ONE = 0.999
#: What one range bin says at the most: a single echo may come from elsewhere.
MOST_A_BIN = 3.0
#: What one ping says against a cell at the most, where one missed echo is not one piece of news.
MOST_A_PING = 24.0 * MOST_A_BIN
#: Echoes within so many metres crowd around a cell's.
CROWD_M = 0.5


class Said(NamedTuple):
    """What some pings say of cells, a row for each pair; rows of a ping lie one behind the other.

    Parameters
    ----------
    cell : (rows,) int32 array
        Which of the `Cells`.
    own, block : (rows,) float32 array
        Log-likelihood ratio with the cell to without it, and with its eight neighbours.
    share : (rows,) float32 array
        Largest share of the block's in what is expected of a bin with an echo.
    asked : (rows,) float32 array
        1 if there is such a bin.
    crowd : (rows,) float32 array
        Echoes around the cell's range.
    start : (pings + 1,) int64 array
        First row of each ping, and the end.
    """

    cell: NDArray[np.int32]
    own: NDArray[np.float32]
    block: NDArray[np.float32]
    share: NDArray[np.float32]
    asked: NDArray[np.float32]
    crowd: NDArray[np.float32]
    start: NDArray[np.int64]


class Pairs(NamedTuple):
    """Contributions to range bins of one ping that say something of who makes them.

    Parameters
    ----------
    bin, of : (pairs,) int32 arrays
        Which bin, and which sum: two for each cell, its own and its block's.
    part, ratio : (pairs,) float32 arrays
        Power, and log-likelihood ratio with it to without it.
    total : (2 cells,) float32 array
        Sums of them.
    """

    bin: NDArray[np.int32]
    of: NDArray[np.int32]
    part: NDArray[np.float32]
    ratio: NDArray[np.float32]
    total: NDArray[np.float32]


@compiled
def weigh_pings(
    looks: Looks,
    pings: NDArray[np.int64],
    rows: Projection,
    power: NDArray[np.float32],
    expected: NDArray[np.float32],
    cells: Cells,
    field: Field,
) -> Said:
    """What each of some pings says of the cells that it may hear.

    Parameters
    ----------
    looks, pings, rows, power, expected
        As in `usmap_ros.mapping.joint.forward_model.power_estimation.expect_powers`, after it.
    cells : Cells
        Of the scatterers.
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
    said = Said(
        np.empty(size, np.int32), np.empty(size, np.float32), np.empty(size, np.float32),
        np.empty(size, np.float32), np.empty(size, np.float32), np.empty(size, np.float32),
        np.zeros(len(pings) + 1, np.int64),
    )  # fmt: skip
    bins = expected.shape[1]
    known = Levels(
        np.empty(bins, np.float32), np.empty(bins + CELL_BINS, np.float32),
        np.empty(bins, np.float32), np.empty(bins + CELL_BINS, np.float32),
        np.zeros(bins + 1, np.int32),
    )  # fmt: skip
    room = most * (CELL_BINS + BLOCK_BINS)
    pairs = Pairs(
        np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room, np.float32),
        np.empty(room, np.float32), np.empty(2 * most, np.float32),
    )  # fmt: skip
    block = np.empty(BLOCK_BINS + CELL_BINS, np.float32)
    beside = np.empty(BLOCK_CELLS + 1, np.int64)
    for index in range(len(pings)):
        ping, levels, start = pings[index], expected[index], said.start[index]
        know_bins(looks, ping, levels, known)
        count = divide(looks, ping, rows, index, power, cells, parts)
        sum_up(count, known, parts)
        found = _pair(looks, ping, cells, count, parts, known, beside, block, start, said, pairs)
        _compare(looks, ping, levels, known, count, found, start, said, pairs)
        _name_cells(looks, ping, field, cells, known.echoes, count, parts, start, said)
        said.start[index + 1] = start + count
    return said


@inlined
def _pair(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    looks: Looks,
    ping: int,
    cells: Cells,
    count: int,
    parts: Parts,
    known: Levels,
    beside: NDArray[np.int64],
    block: NDArray[np.float32],
    start: int,
    said: Said,
    pairs: Pairs,
) -> int:
    """Set contributions of cells, and of blocks of nine, that say something; returns how many.

    Parameters
    ----------
    looks, ping, cells, count, parts
        The ping, and what each of so many cells returns.
    known : Levels
        Of the ping.
    beside, block : (BLOCK_CELLS + 1,) int64 array, (BLOCK_BINS + CELL_BINS,) float32 array
        Room for the places of a block's cells, and for what it returns.
    start, said : int, Said
        Row of the first cell; whether there are echoes that may be its block's is set.
    pairs : Pairs
        Set, but for ratios and sums.
    """
    bins, found, one = looks.bins[ping], 0, np.float32(NEARLY_ONE)
    for entry in range(count):
        if parts.largest[entry] >= one:
            for place in range(parts.length[entry]):
                part, b = parts.power[entry, place], parts.begin[entry] + place
                pairs.part[found], pairs.bin[found], pairs.of[found] = part, b, 2 * entry
                found += part >= known.least[b]
        near = neighbours(cells.block[parts.cell[entry]], parts.place, beside)
        of_echoes, largest = np.float32(0.0), np.float32(0.0)
        for which in range(near):
            of_echoes += parts.echoes[beside[which]]
            largest += parts.largest[beside[which]]
        said.asked[start + entry] = 1.0 if of_echoes > 0.0 else 0.0
        if largest < one:
            continue
        first, end = add_up(parts, near, beside, block)
        for place in range(min(end - first, BLOCK_BINS, bins - first)):
            part, b = block[place], first + place
            pairs.part[found], pairs.bin[found], pairs.of[found] = part, b, 2 * entry + 1
            found += part >= known.least[b]
    return found


@inlined
def _compare(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    looks: Looks,
    ping: int,
    levels: NDArray[np.float32],
    known: Levels,
    count: int,
    found: int,
    start: int,
    said: Said,
    pairs: Pairs,
) -> None:
    """Weigh what is expected of a ping with some cells against what is expected without them.

    Parameters
    ----------
    looks, ping, levels, known
        The ping, and what is expected of its bins.
    count, found : int
        How many cells and how many pairs.
    start, said : int, Said
        Row of the first cell; ratios and shares are set.
    pairs : Pairs
        Ratios and sums are set.
    """
    noise, most, one = np.float32(looks.numbers[ping, NOISE]), np.float32(MOST_A_BIN), np.float32(1)
    for pair in range(found):
        b, part = pairs.bin[pair], pairs.part[pair]
        level, is_echo = levels[b], known.is_echo[b] > 0.0
        without = max(level - part, noise)
        below = probability_below(looks.limit[ping, b] / without)
        logarithm = log32(without / level if is_echo else below)
        of_echo = looks.power[ping, b] * (one / without - one / level) + logarithm
        ratio = of_echo if is_echo else known.silent[b] - logarithm
        pairs.ratio[pair] = min(max(ratio, -most), most)
    for entry in range(count):
        pairs.total[2 * entry] = pairs.total[2 * entry + 1] = said.share[start + entry] = 0.0
    for pair in range(found):
        of, b = pairs.of[pair], pairs.bin[pair]
        pairs.total[of] += pairs.ratio[pair]
        if known.is_echo[b] > 0.0 and of & 1:
            row = start + (of >> 1)
            said.share[row] = max(said.share[row], pairs.part[pair] / levels[b])
    # One echo that is missed is missed in several bins: where ranges are uncertain, that is one
    # piece of news, for it may have come from beside them.
    is_blurred = looks.numbers[ping, RANGE_STD] > looks.numbers[ping, BIN_M]
    lowest = -most if is_blurred else -np.float32(MOST_A_PING)
    for entry in range(count):
        said.own[start + entry] = max(pairs.total[2 * entry], lowest)
        said.block[start + entry] = max(pairs.total[2 * entry + 1], lowest)


@inlined
def _name_cells(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    looks: Looks,
    ping: int,
    field: Field,
    cells: Cells,
    echoes: NDArray[np.int32],
    count: int,
    parts: Parts,
    start: int,
    said: Said,
) -> None:
    """Set which cells a ping speaks of, and how many echoes crowd around their ranges."""
    numbers, bins = looks.numbers[ping], looks.bins[ping]
    around = int(CROWD_M / numbers[BIN_M])
    for entry in range(count):
        parts.place[parts.cell[entry]] = -1
        said.cell[start + entry] = parts.cell[entry]
        row, column = divmod(cells.number[parts.cell[entry]], field.columns)
        x = (field.first_column + column + 0.5) * field.resolution_m - numbers[X]
        y = (field.first_row + row + 0.5) * field.resolution_m - numbers[Y]
        middle = int((math.sqrt(x * x + y * y) - numbers[LEAST_RANGE]) / numbers[BIN_M])
        near, far = min(bins, max(0, middle - around)), min(bins, max(0, middle + around))
        said.crowd[start + entry] = echoes[far] - echoes[near]
