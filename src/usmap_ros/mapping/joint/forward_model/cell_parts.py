"""What each cell returns of a ping, and what its range bins say."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.visibility.projection import Projection
from usmap_ros.mapping.ping_bins import ECHO, SILENCE, UNJUDGED
from usmap_ros.mapping.ping_table import PingTable
from usmap_ros.numerics.arrays import BoolArray
from usmap_ros.numerics.compiled import inlined
from usmap_ros.numerics.elementary import exp32, log32

#: Range bins that a cell, and that a block of nine, may reach into; and cells of a block.
CELL_BINS, BLOCK_BINS, BLOCK_CELLS = 32, 72, 9
#: Range bins that nearly all cells reach into at the most: the others need not be looked at.
FEW_BINS = 16
#: Range bins of a cell begin at multiples of so many, so that what is added up lies as the
#: processor takes it.  Range bins beyond a ping's that it may take, too.
ALIGNED, BEYOND = 4, BLOCK_BINS + CELL_BINS
#: A contribution below this share of what is expected in a bin neither explains nor contradicts.
LEAST_SHARE = 0.05
#: More than any.
NEVER = 1e30


class Cells(NamedTuple):
    """Cells that scatterers belong to."""

    #: (cells,) int32 array: of each in the field.
    number: NDArray[np.int32]
    #: (scatterers,) int32 array: which of them each scatterer belongs to.
    of: NDArray[np.int32]
    #: (cells, 9) int32 array: which of them are each and its eight neighbours; -1: none.
    block: NDArray[np.int32]
    #: (cells,) bool array: of which it is asked what pings say.
    are_asked: BoolArray


class Parts(NamedTuple):
    """What each cell returns of one ping."""

    #: (all cells + 1,) int32 array: where in the others each cell is; -1 if it returns nothing, and
    #: for what is no cell.
    place: NDArray[np.int32]
    #: (cells,) int32 arrays: which cell, the first range bin of what it returns, and how many bins
    #: follow.
    cell: NDArray[np.int32]
    begin: NDArray[np.int32]
    length: NDArray[np.int32]
    #: (cells, CELL_BINS) float32 array: expected in each bin from that one on; 0 beyond.
    power: NDArray[np.float32]
    #: (cells,) float32 array: the largest of them, in units of what says anything in its bin.
    largest: NDArray[np.float32]
    #: (cells,) float32 array: sum of those in bins with an echo.
    echoes: NDArray[np.float32]


class Levels(NamedTuple):
    """What is known of each range bin of one ping, and of `BEYOND` bins of which nothing is."""

    #: (bins + BEYOND,) float32 arrays: power that is expected, that came back, and that would have
    #: been reported.
    level: NDArray[np.float32]
    power: NDArray[np.float32]
    limit: NDArray[np.float32]
    #: (bins + BEYOND,) float32 array: least contribution that says anything.
    least: NDArray[np.float32]
    #: (bins + BEYOND,) float32 array: 1 over it; 0 where nothing does.
    per_least: NDArray[np.float32]
    #: (bins + BEYOND,) float32 array: logarithm of the probability of silence, by all that is
    #: expected.
    silent: NDArray[np.float32]
    #: (bins + BEYOND,) float32 array: 1 if there is an echo, else 0.
    is_echo: NDArray[np.float32]
    #: (bins + 1,) int32 array: echoes before each.
    echoes: NDArray[np.int32]


def cells_of(
    scattering: NDArray[np.int32], field: Field, are_asked: BoolArray | None = None
) -> Cells:
    """The cells that scatterers belong to.

    Parameters
    ----------
    scattering : (scatterers,) int32 array
        Cell of each, in their order.
    field : Field
        All cells.
    are_asked : (rows * columns,) bool array, optional
        Cells of which it is asked what pings say; all by default.
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
    asked = np.ones(len(number), bool) if are_asked is None else are_asked[number]
    return Cells(number, of.astype(np.int32), block, asked)


@inlined
def probability_below(ratio: np.float32) -> np.float32:
    """Probability that a power is below a limit, by the limit over its exponential mean."""
    series = ratio * (np.float32(1.0) - np.float32(0.5) * ratio)
    below = series if ratio < np.float32(1e-3) else np.float32(1.0) - exp32(-ratio)
    return max(below, np.float32(1e-12))


@inlined
def _log_silent(limit: np.float32, level: np.float32) -> np.float32:
    """Logarithm of the probability that a power, exponential about a level, is below a limit."""
    return log32(probability_below(limit / level))


@inlined
def know_bins(table: PingTable, ping: int, levels: NDArray[np.float32], known: Levels) -> None:
    """Set what is known of the bins of a ping by what is expected of them."""
    bins, never = table.bins[ping], np.float32(NEVER)
    for b in range(bins):
        kind, level, limit = table.kind[ping, b], levels[b], table.limit[ping, b]
        least = np.float32(LEAST_SHARE) * level
        known.level[b], known.power[b], known.limit[b] = level, table.power[ping, b], limit
        known.least[b] = never if kind == UNJUDGED else least
        known.per_least[b] = 0.0 if kind == UNJUDGED else np.float32(1.0) / least
        known.is_echo[b] = np.float32(1.0) if kind == ECHO else np.float32(0.0)
        known.silent[b] = _log_silent(limit, level)
        known.echoes[b + 1] = known.echoes[b] + (1 if kind == ECHO else 0)
    for b in range(bins, bins + BEYOND):
        known.level[b] = known.limit[b] = np.float32(1.0)
        known.power[b] = known.silent[b] = known.is_echo[b] = known.per_least[b] = 0.0
        known.least[b] = never


@inlined
def divide(
    table: PingTable,
    ping: int,
    rows: Projection,
    index: int,
    power: NDArray[np.float32],
    cells: Cells,
    parts: Parts,
) -> int:
    """Set what each cell returns of a ping; returns how many there are."""
    bins, count, last = table.bins[ping], 0, -1
    for place in range(rows.start[index], rows.start[index + 1]):
        # Places without a sign need not be compared with zero.
        row = np.uint64(place)
        scatterer = np.uint32(rows.scatterer[row])
        v = power[scatterer]
        if v <= 0.0:
            continue
        cell, low, high = cells.of[scatterer], rows.low[row], rows.high[row]
        if cell != last:
            last, parts.cell[count], parts.place[cell] = cell, cell, count
            parts.begin[count], parts.length[count] = max(0, int(low) - 4) // ALIGNED * ALIGNED, 0
            own = parts.power[count]
            for b in range(CELL_BINS):
                own[b] = 0.0
            count += 1
        scale, first = rows.weight[row] * v, parts.begin[count - 1]
        end = min(bins - 1, int(high), first + CELL_BINS - 1) + 1
        parts.length[count - 1] = max(parts.length[count - 1], end - first)
        own, is_heard = parts.power[count - 1], rows.heard[row]
        for b in range(max(first, int(low)), end):
            if not is_heard or table.kind[ping, np.uint64(b)] != SILENCE:
                inside = min(high, np.float32(b + 1)) - max(low, np.float32(b))
                own[np.uint64(b - first)] += scale * inside
    return count


@inlined
def sum_up(count: int, known: Levels, parts: Parts) -> None:
    """Set the largest contribution of each cell, and the sum of those to bins with an echo."""
    for entry in range(count):
        first, largest, echoes = parts.begin[entry], np.float32(0.0), np.float32(0.0)
        for begin in range(0, parts.length[entry], FEW_BINS):
            per_least = known.per_least[first + begin : first + begin + FEW_BINS]
            is_echo = known.is_echo[first + begin : first + begin + FEW_BINS]
            power = parts.power[entry, begin : begin + FEW_BINS]
            for place in range(FEW_BINS):
                largest = max(largest, power[place] * per_least[place])
                echoes += power[place] * is_echo[place]
        parts.largest[entry], parts.echoes[entry] = largest, echoes


@inlined
def neighbours(
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
def add_up(
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
            # So many at a time as let the processor add many at once.
            for begin in range(0, parts.length[place], FEW_BINS):
                some, power = block[shift + begin :], parts.power[place, begin:]
                for b in range(FEW_BINS):
                    some[b] += power[b]
    return first, end
