"""Evidence of each cell: how much worse all pings would be explained without it.

Besides, from where a cell was heard: echoes from one direction leave its place along their rings
open, and so the spread of directions says how well it is known where it is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.field import BIN_M, LEAST_RANGE, NOISE, RANGE_STD, Field, X, Y
from usmap_ros.mapping.joint.projection import Projection
from usmap_ros.mapping.looks import Looks
from usmap_ros.mapping.ping_bins import ECHO, SILENCE, UNJUDGED
from usmap_ros.numerics.compiled import compiled, inlined
from usmap_ros.numerics.elementary import exp32, log32

#: Range bins that a cell, and that a block of nine, may reach into; and cells of a block.
CELL_BINS, BLOCK_BINS, BLOCK_CELLS = 24, 72, 9
#: A contribution below this share of what is expected in a bin neither explains nor contradicts.
LEAST_SHARE = 0.05
#: What one range bin says at the most: a single echo may come from elsewhere.
MOST_A_BIN = 3.0
#: A ping with a log-likelihood ratio beyond this contradicts what speaks for the opposite.
CONTRADICTION = 0.5
#: Echoes within so many metres crowd around a cell's.
CROWD_M = 0.5


class CellEvidence(NamedTuple):
    """Sums over all pings; (cells,) float32 arrays.

    Parameters
    ----------
    own, block : float32 array
        Log-likelihood ratio with the cell to without it, and with its eight neighbours.
    heard : float32 array
        Echoes that the block explains, by its share in each.
    axis_cos, axis_sin : float32 array
        The same times cosine and sine of twice the direction that the cell was heard from.
    from_x, from_y : float32 array
        The same times the unit vector from the cell to who heard it.
    crowd : float32 array
        The same times the number of echoes within `CROWD_M` of each.
    asked : float32 array
        Pings with an echo that may be the block's.
    """

    own: NDArray[np.float32]
    block: NDArray[np.float32]
    heard: NDArray[np.float32]
    axis_cos: NDArray[np.float32]
    axis_sin: NDArray[np.float32]
    from_x: NDArray[np.float32]
    from_y: NDArray[np.float32]
    crowd: NDArray[np.float32]
    asked: NDArray[np.float32]


def no_evidence(field: Field) -> CellEvidence:
    """Evidence before any ping."""
    cells = field.rows * field.columns
    return CellEvidence(*(np.zeros(cells, np.float32) for _ in CellEvidence._fields))


class Cells(NamedTuple):
    """Cells that scatterers belong to.

    Parameters
    ----------
    number : (cells,) int32 array
        Of each in the field.
    of : (scatterers,) int32 array
        Which of them each scatterer belongs to.
    block : (cells, 9) int32 array
        Which of them are each and its eight neighbours; -1: none.
    """

    number: NDArray[np.int32]
    of: NDArray[np.int32]
    block: NDArray[np.int32]


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


class Parts(NamedTuple):
    """What each cell returns of one ping.

    Parameters
    ----------
    place : (all cells,) int32 array
        Where in the others each cell is; -1 if it returns nothing.
    cell, begin, length : (cells,) int32 arrays
        Which cell, the first range bin of what it returns, and how many bins follow.
    power : (cells, CELL_BINS) float32 array
        Expected in each bin from that one on.
    """

    place: NDArray[np.int32]
    cell: NDArray[np.int32]
    begin: NDArray[np.int32]
    length: NDArray[np.int32]
    power: NDArray[np.float32]


def cells_of(scattering: NDArray[np.int32], field: Field) -> Cells:
    """The cells that scatterers belong to.

    Parameters
    ----------
    scattering : (scatterers,) int32 array
        Cell of each, in their order.
    field : Field
        All cells.
    """
    is_next = np.diff(scattering, prepend=np.int32(-1)) > 0
    number, of = scattering[is_next], np.cumsum(is_next) - 1
    # With a rim, so that all cells have neighbours.
    width = field.columns + 2
    place = np.full((field.rows + 2) * width, -1, np.int32)
    rows, columns = np.divmod(number.astype(np.int64), field.columns)
    middle = (rows + 1) * width + columns + 1
    place[middle] = np.arange(len(number), dtype=np.int32)
    around = [up * width + right for up in (-1, 0, 1) for right in (-1, 0, 1)]
    block = place[middle[:, np.newaxis] + np.array(around)]
    return Cells(number, of.astype(np.int32), block)


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
        As in `usmap_ros.mapping.joint.power_estimation.expect_powers`, after it.
    cells : Cells
        Of the scatterers.
    field : Field
        All cells.
    """
    most, size = 1, np.int64(rows.start[-1])
    for index in range(len(pings)):
        most = max(most, rows.start[index + 1] - rows.start[index])
    parts = Parts(
        np.full(len(cells.number), -1, np.int32), np.empty(most, np.int32),
        np.empty(most, np.int32), np.empty(most, np.int32),
        np.empty((most, CELL_BINS), np.float32),
    )  # fmt: skip
    said = Said(
        np.empty(size, np.int32), np.empty(size, np.float32), np.empty(size, np.float32),
        np.empty(size, np.float32), np.empty(size, np.float32), np.empty(size, np.float32),
        np.zeros(len(pings) + 1, np.int64),
    )  # fmt: skip
    blocks = Parts(
        parts.place, parts.cell, np.empty(most, np.int32), np.empty(most, np.int32),
        np.empty((most, BLOCK_BINS), np.float32),
    )  # fmt: skip
    silent = np.empty(expected.shape[1], np.float32)
    echoes = np.zeros(expected.shape[1] + 1, np.int32)
    for index in range(len(pings)):
        ping, levels, start = pings[index], expected[index], said.start[index]
        _count_echoes(looks, ping, levels, silent, echoes)
        count = _divide(looks, ping, rows, index, power, cells, parts)
        _add_blocks(looks, ping, cells, count, parts, blocks)
        _compare(looks, ping, levels, silent, count, parts, start, said.own, said)
        _compare(looks, ping, levels, silent, count, blocks, start, said.block, said)
        _name_cells(looks, ping, field, cells, echoes, count, parts, start, said)
        said.start[index + 1] = start + count
    return said


@compiled
def add_said(
    looks: Looks,
    pings: NDArray[np.int64],
    weights: NDArray[np.float32],
    said: Said,
    cells: Cells,
    field: Field,
    forgetting: float,
    evidence: CellEvidence,
) -> None:
    """Add what some pings say, one after the other, to what was said before.

    Parameters
    ----------
    looks, pings, said, cells, field
        As in `weigh_pings`.
    weights : (pings,) float32 array
        How much each ping counts.
    forgetting : float
        Share of what speaks for a cell that is forgotten with a ping that contradicts it.
    evidence : CellEvidence
        Added to.
    """
    for index in range(len(pings)):
        weight, numbers = weights[index], looks.numbers[pings[index]]
        for row in range(said.start[index], said.start[index + 1]):
            cell = cells.number[said.cell[row]]
            evidence.own[cell] = _added(evidence.own[cell], said.own[row], weight, forgetting)
            evidence.block[cell] = _added(evidence.block[cell], said.block[row], weight, forgetting)
            evidence.asked[cell] += said.asked[row] * weight
            if said.share[row] <= LEAST_SHARE:
                continue
            # From where the cell is heard, and how many echoes crowd around its own.
            share, (up, right) = said.share[row] * weight, divmod(cell, field.columns)
            x = (field.first_column + right + 0.5) * field.resolution_m - numbers[X]
            y = (field.first_row + up + 0.5) * field.resolution_m - numbers[Y]
            squared = x * x + y * y
            distance = math.sqrt(squared)
            evidence.heard[cell] += share
            evidence.axis_cos[cell] += share * (x * x - y * y) / squared
            evidence.axis_sin[cell] += share * 2.0 * x * y / squared
            evidence.from_x[cell] -= share * x / distance
            evidence.from_y[cell] -= share * y / distance
            evidence.crowd[cell] += share * said.crowd[row]


@inlined
def _added(sum_so_far: float, ratio: float, weight: float, forgetting: float) -> float:
    """A sum of evidence with one more ping, of which contradictions make it forget."""
    if ratio < -CONTRADICTION and sum_so_far > 0.0:
        sum_so_far *= 1.0 - forgetting
    return sum_so_far + ratio * weight


@inlined
def _log_silent(limit: float, level: float) -> np.float32:
    """Logarithm of the probability that a power, exponential about a level, is below a limit."""
    ratio = np.float32(limit / level)
    series = ratio * (np.float32(1.0) - np.float32(0.5) * ratio)
    below = series if ratio < np.float32(1e-3) else np.float32(1.0) - exp32(-ratio)
    return log32(max(below, np.float32(1e-12)))


@inlined
def _count_echoes(
    looks: Looks,
    ping: int,
    levels: NDArray[np.float32],
    silent: NDArray[np.float32],
    echoes: NDArray[np.int32],
) -> None:
    """Set `_log_silent` of silent bins; count the echoes before each."""
    for b in range(looks.bins[ping]):
        silent[b] = 0.0
        if looks.kind[ping, b] == SILENCE:
            silent[b] = _log_silent(looks.limit[ping, b], levels[b])
        echoes[b + 1] = echoes[b] + (1 if looks.kind[ping, b] == ECHO else 0)


@inlined
def _divide(
    looks: Looks,
    ping: int,
    rows: Projection,
    index: int,
    power: NDArray[np.float32],
    cells: Cells,
    parts: Parts,
) -> int:
    """Set what each cell returns of a ping; returns how many there are."""
    bins, count, last = looks.bins[ping], 0, -1
    for row in range(rows.start[index], rows.start[index + 1]):
        v = power[rows.scatterer[row]]
        if v <= 0.0:
            continue
        cell, low, high = cells.of[rows.scatterer[row]], rows.low[row], rows.high[row]
        if cell != last:
            last, parts.cell[count], parts.place[cell] = cell, cell, count
            parts.begin[count], parts.length[count] = max(0, int(low) - 4), 0
            for place in range(CELL_BINS):
                parts.power[count, place] = 0.0
            count += 1
        scale, first = rows.weight[row] * v, parts.begin[count - 1]
        end = min(bins - 1, int(high), first + CELL_BINS - 1) + 1
        parts.length[count - 1] = max(parts.length[count - 1], end - first)
        for b in range(max(first, int(low)), end):
            if not rows.heard[row] or looks.kind[ping, b] != SILENCE:
                inside = min(high, np.float32(b + 1)) - max(low, np.float32(b))
                parts.power[count - 1, b - first] += scale * inside
    return count


@inlined
def _add_blocks(
    looks: Looks, ping: int, cells: Cells, count: int, parts: Parts, blocks: Parts
) -> None:
    """Set what each cell returns together with its neighbours."""
    bins = looks.bins[ping]
    for entry in range(count):
        cell = parts.cell[entry]
        first, end = parts.begin[entry], parts.begin[entry] + parts.length[entry]
        for near in range(BLOCK_CELLS):
            number = cells.block[cell, near]
            beside = parts.place[number] if number >= 0 else -1
            if beside >= 0:
                first = min(first, parts.begin[beside])
                end = max(end, parts.begin[beside] + parts.length[beside])
        length = min(end - first, BLOCK_BINS, bins - first)
        blocks.begin[entry], blocks.length[entry] = first, length
        for place in range(length):
            blocks.power[entry, place] = 0.0
        for near in range(BLOCK_CELLS):
            number = cells.block[cell, near]
            beside = parts.place[number] if number >= 0 else -1
            if beside >= 0:
                shift = parts.begin[beside] - first
                for place in range(min(parts.length[beside], length - shift)):
                    blocks.power[entry, shift + place] += parts.power[beside, place]


@inlined
def _compare(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    looks: Looks,
    ping: int,
    levels: NDArray[np.float32],
    silent: NDArray[np.float32],
    count: int,
    parts: Parts,
    start: int,
    ratios: NDArray[np.float32],
    said: Said,
) -> None:
    """Weigh what is expected of a ping with some cells against what is expected without them.

    Parameters
    ----------
    looks, ping, levels, silent
        The ping, what is expected of its bins, and `_log_silent` of that.
    count : int
        How many cells.
    parts : Parts
        What they return.
    start : int
        Row of the first.
    ratios : (rows,) float32 array
        Log-likelihood ratios; set.
    said : Said
        Shares and whether there was an echo are set.
    """
    noise, least = np.float32(looks.numbers[ping, NOISE]), np.float32(LEAST_SHARE)
    most, nothing = np.float32(MOST_A_BIN), np.float32(0.0)
    # One echo that is missed is missed in several bins: where ranges are uncertain, that is one
    # piece of news, for it may have come from beside them.
    is_blurred = looks.numbers[ping, RANGE_STD] > looks.numbers[ping, BIN_M]
    lowest = -most if is_blurred else -most * np.float32(CELL_BINS)
    for entry in range(count):
        total, share, asked = np.float32(0.0), np.float32(0.0), np.float32(0.0)
        for place in range(parts.length[entry]):
            part, b = parts.power[entry, place], parts.begin[entry] + place
            level, kind = levels[b], looks.kind[ping, b]
            if part <= nothing or kind == UNJUDGED:
                continue
            if kind == ECHO:
                asked = np.float32(1.0)
            if part < least * level:
                continue
            without = max(level - part, noise)
            if kind == ECHO:
                share = max(share, part / level)
                power = looks.power[ping, b]
                ratio = power / without - power / level + log32(without / level)
            else:
                ratio = silent[b] - _log_silent(looks.limit[ping, b], without)
            total += min(max(ratio, -most), most)
        ratios[start + entry] = max(total, lowest)
        said.share[start + entry] = share
        said.asked[start + entry] = asked


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
