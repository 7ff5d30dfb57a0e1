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
CELL_BINS, BLOCK_BINS, BLOCK_CELLS = 32, 72, 9
#: Range bins of a cell begin at multiples of so many, so that what is added up lies as the
#: processor takes it: as many at once.
AT_ONCE = 8
#: A contribution below this share of what is expected in a bin neither explains nor contradicts.
LEAST_SHARE = 0.05
#: More than any; and what rounding may make of one.
NEVER, NEARLY_ONE = 1e30, 0.999
#: What one range bin says at the most: a single echo may come from elsewhere.
MOST_A_BIN = 3.0
#: What one ping says against a cell at the most, where one missed echo is not one piece of news.
MOST_A_PING = 24.0 * MOST_A_BIN
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
    place : (all cells + 1,) int32 array
        Where in the others each cell is; -1 if it returns nothing, and for what is no cell.
    cell, begin, length : (cells,) int32 arrays
        Which cell, the first range bin of what it returns, and how many bins follow.
    power : (cells, CELL_BINS) float32 array
        Expected in each bin from that one on; 0 beyond.
    largest : (cells,) float32 array
        The largest of them, in units of what says anything in its bin.
    echoes : (cells,) float32 array
        Sum of those in bins with an echo.
    """

    place: NDArray[np.int32]
    cell: NDArray[np.int32]
    begin: NDArray[np.int32]
    length: NDArray[np.int32]
    power: NDArray[np.float32]
    largest: NDArray[np.float32]
    echoes: NDArray[np.float32]


class Levels(NamedTuple):
    """What is known of each range bin of one ping; (bins,) float32 arrays, but for `echoes`.

    Parameters
    ----------
    least : float32 array
        Least contribution that says anything.
    per_least : (bins + CELL_BINS,) float32 array
        1 over it; 0 where nothing does.
    silent : float32 array
        Logarithm of the probability of silence, by all that is expected.
    is_echo : (bins + CELL_BINS,) float32 array
        1 if there is an echo, else 0.
    echoes : (bins + 1,) int32 array
        Echoes before each.
    """

    least: NDArray[np.float32]
    per_least: NDArray[np.float32]
    silent: NDArray[np.float32]
    is_echo: NDArray[np.float32]
    echoes: NDArray[np.int32]


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
        _know_bins(looks, ping, levels, known)
        count = _divide(looks, ping, rows, index, power, cells, parts)
        _sum_up(count, known, parts)
        found = _pair(looks, ping, cells, count, parts, known, beside, block, start, said, pairs)
        _compare(looks, ping, levels, known, count, found, start, said, pairs)
        _name_cells(looks, ping, field, cells, known.echoes, count, parts, start, said)
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
def _below(ratio: np.float32) -> np.float32:
    """Probability that a power is below a limit, by the limit over its exponential mean."""
    series = ratio * (np.float32(1.0) - np.float32(0.5) * ratio)
    below = series if ratio < np.float32(1e-3) else np.float32(1.0) - exp32(-ratio)
    return max(below, np.float32(1e-12))


@inlined
def _log_silent(limit: np.float32, level: np.float32) -> np.float32:
    """Logarithm of the probability that a power, exponential about a level, is below a limit."""
    return log32(_below(limit / level))


@inlined
def _know_bins(looks: Looks, ping: int, levels: NDArray[np.float32], known: Levels) -> None:
    """Set what is known of the bins of a ping by what is expected of them."""
    bins, least, never = looks.bins[ping], np.float32(LEAST_SHARE), np.float32(NEVER)
    for b in range(bins):
        kind = looks.kind[ping, b]
        known.least[b] = never if kind == UNJUDGED else least * levels[b]
        known.is_echo[b] = np.float32(1.0) if kind == ECHO else np.float32(0.0)
        known.silent[b] = _log_silent(looks.limit[ping, b], levels[b])
        known.per_least[b] = 0.0 if kind == UNJUDGED else np.float32(1.0) / known.least[b]
    known.per_least[bins : bins + CELL_BINS] = known.is_echo[bins : bins + CELL_BINS] = 0.0
    for b in range(bins):
        known.echoes[b + 1] = known.echoes[b] + (1 if looks.kind[ping, b] == ECHO else 0)


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
            parts.begin[count], parts.length[count] = max(0, int(low) - 4) // AT_ONCE * AT_ONCE, 0
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
def _sum_up(count: int, known: Levels, parts: Parts) -> None:
    """Set the largest contribution of each cell, and the sum of those to bins with an echo."""
    for entry in range(count):
        first, largest, echoes = parts.begin[entry], np.float32(0.0), np.float32(0.0)
        for place in range(CELL_BINS):
            part = parts.power[entry, place]
            largest = max(largest, part * known.per_least[first + place])
            echoes += part * known.is_echo[first + place]
        parts.largest[entry], parts.echoes[entry] = largest, echoes


@inlined
def _neighbours(
    numbers: NDArray[np.int32], places: NDArray[np.int32], beside: NDArray[np.int64]
) -> int:
    """Set the places of a block's cells that return something; returns how many do."""
    near = 0
    for which in range(BLOCK_CELLS):
        # The last place is that of no cell, whose number is -1.
        beside[near] = places[numbers[which]]
        near += beside[near] >= 0
    return near


@inlined
def _add_up(
    parts: Parts, near: int, beside: NDArray[np.int64], block: NDArray[np.float32]
) -> tuple[int, int]:
    """Set what a block returns; returns its first range bin and the end."""
    first, end = parts.begin[beside[0]], 0
    for which in range(near):
        first = min(first, parts.begin[beside[which]])
        end = max(end, parts.begin[beside[which]] + parts.length[beside[which]])
    block[:] = np.float32(0.0)
    for which in range(near):
        place = beside[which]
        shift = parts.begin[place] - first
        if shift <= BLOCK_BINS:
            # All of them, so that as many as the processor can are added at once.
            for b in range(CELL_BINS):
                block[shift + b] += parts.power[place, b]
    return first, end


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
        near = _neighbours(cells.block[parts.cell[entry]], parts.place, beside)
        of_echoes, largest = np.float32(0.0), np.float32(0.0)
        for which in range(near):
            of_echoes += parts.echoes[beside[which]]
            largest += parts.largest[beside[which]]
        said.asked[start + entry] = 1.0 if of_echoes > 0.0 else 0.0
        if largest < one:
            continue
        first, end = _add_up(parts, near, beside, block)
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
        below = _below(looks.limit[ping, b] / without)
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
