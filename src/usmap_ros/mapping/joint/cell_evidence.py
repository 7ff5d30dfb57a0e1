"""Evidence of each cell: how much worse all pings would be explained without it.

Besides, from where a cell was heard: echoes from one direction leave its place along their rings
open, and so the spread of directions says how well it is known where it is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.field import BIN_M, LEAST_RANGE, NOISE, Field, X, Y
from usmap_ros.mapping.joint.projection import Projection
from usmap_ros.mapping.superposition.cells import QUARTERS
from usmap_ros.mapping.superposition.ping_bins import ECHO, SILENCE, UNJUDGED
from usmap_ros.mapping.superposition.window import Looks
from usmap_ros.numerics.compiled import compiled, inlined

#: Range bins that a cell, and that a block of nine, may reach into.
CELL_BINS, BLOCK_BINS = 24, 72
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


@inlined
def log_silent(limit: float, level: float) -> float:
    """Logarithm of the probability that a power, exponential about a level, is below a limit."""
    return math.log(max(1e-12, -math.expm1(-limit / level)))


@inlined
def bin_ratio(
    looks: Looks, ping: int, b: int, level: float, without: float, silent: float
) -> float:
    """Bounded log-likelihood ratio of a range bin, expecting one level to expecting another.

    Parameters
    ----------
    looks, ping, b
        The bin.
    level, without : float
        Power that is expected, and without a contribution to it.
    silent : float
        `log_silent` of the level.
    """
    if looks.kind[ping, b] == ECHO:
        power = float(looks.power[ping, b])
        ratio = power / without - power / level + math.log(without / level)
    else:
        ratio = silent - log_silent(looks.limit[ping, b], without)
    return min(max(ratio, -MOST_A_BIN), MOST_A_BIN)


@inlined
def added(sum_so_far: float, ratio: float, weight: float, forgetting: float) -> float:
    """A sum of evidence with one more ping, of which contradictions make it forget."""
    if ratio < -CONTRADICTION and sum_so_far > 0.0:
        sum_so_far *= 1.0 - forgetting
    return sum_so_far + ratio * weight


class Parts(NamedTuple):
    """What each cell returns of one ping.

    Parameters
    ----------
    place : (all cells,) int32 array
        Where in the others each cell is; -1 if it returns nothing.
    cell, begin, length : (cells,) integer arrays
        Which cell, the first range bin of what it returns, and how many bins follow.
    power : (cells, CELL_BINS) float32 array
        Expected in each bin from that one on.
    """

    place: NDArray[np.int32]
    cell: NDArray[np.int64]
    begin: NDArray[np.int64]
    length: NDArray[np.int64]
    power: NDArray[np.float32]


@compiled
def gather_evidence(
    looks: Looks,
    pings: NDArray[np.int64],
    weights: NDArray[np.float32],
    rows: Projection,
    power: NDArray[np.float32],
    expected: NDArray[np.float32],
    field: Field,
    forgetting: float,
) -> CellEvidence:
    """What all pings, in the order of their stamps, say of all cells with any power.

    Parameters
    ----------
    looks, pings, weights, rows, power, expected
        As in `usmap_ros.mapping.joint.power_estimation.gather_gradients`.
    field : Field
        The cells.
    forgetting : float
        Share of what speaks for a cell that is forgotten with a ping that contradicts it.
    """
    cells, most = field.rows * field.columns, 1
    for index in range(len(pings)):
        most = max(most, rows.start[index + 1] - rows.start[index])
    sums = np.zeros((9, cells), np.float32)
    evidence = CellEvidence(
        sums[0], sums[1], sums[2], sums[3], sums[4], sums[5], sums[6], sums[7], sums[8]
    )
    parts = Parts(
        np.full(cells, -1, np.int32), np.zeros(most, np.int64), np.zeros(most, np.int64),
        np.zeros(most, np.int64), np.zeros((most, CELL_BINS), np.float32),
    )  # fmt: skip
    levels = np.zeros((2, expected.shape[1]))
    block, echoes = np.zeros(BLOCK_BINS), np.zeros(expected.shape[1] + 1, np.int32)
    for index in range(len(pings)):
        ping, weight = pings[index], weights[index]
        bins = looks.bins[ping]
        _count_echoes(looks, ping, expected[index], levels, echoes)
        count = _divide(looks, ping, rows, index, power, parts)
        for entry in range(count):
            cell, first = parts.cell[entry], parts.begin[entry]
            ratio, share, asked = _compare(
                looks, ping, levels, parts.power[entry], first, parts.length[entry]
            )
            evidence.own[cell] = added(evidence.own[cell], ratio, weight, forgetting)
            first, length = _add_neighbours(field, parts, entry, block)
            ratio, share, asked = _compare(
                looks, ping, levels, block, first, min(length, bins - first)
            )
            evidence.block[cell] = added(evidence.block[cell], ratio, weight, forgetting)
            evidence.asked[cell] += asked * weight
            if share > LEAST_SHARE:
                _point_back(looks, ping, field, cell, share * weight, echoes, evidence)
        for entry in range(count):
            parts.place[parts.cell[entry]] = -1
    return evidence


@inlined
def _count_echoes(
    looks: Looks,
    ping: int,
    expected: NDArray[np.float32],
    levels: NDArray[np.float64],
    echoes: NDArray[np.int32],
) -> None:
    """Set what is expected of each bin, with `log_silent` of silent ones; count echoes before."""
    for b in range(looks.bins[ping]):
        levels[0, b], levels[1, b] = expected[b], 0.0
        if looks.kind[ping, b] == SILENCE:
            levels[1, b] = log_silent(looks.limit[ping, b], expected[b])
        echoes[b + 1] = echoes[b] + (1 if looks.kind[ping, b] == ECHO else 0)


@inlined
def _divide(
    looks: Looks,
    ping: int,
    rows: Projection,
    index: int,
    power: NDArray[np.float32],
    parts: Parts,
) -> int:
    """Set what each cell returns of a ping; returns how many there are."""
    bins, count, last = looks.bins[ping], 0, -1
    for row in range(rows.start[index], rows.start[index + 1]):
        v = power[rows.quarter[row]]
        if v <= 0.0:
            continue
        cell, low, high = rows.quarter[row] // QUARTERS, rows.low[row], rows.high[row]
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
                inside = min(high, b + 1.0) - max(low, float(b))
                parts.power[count - 1, b - first] += scale * inside
    return count


@inlined
def _compare(
    looks: Looks,
    ping: int,
    levels: NDArray[np.float64],
    own: NDArray[np.float32] | NDArray[np.float64],
    first: int,
    bins: int,
) -> tuple[float, float, float]:
    """Weigh what is expected of a ping with some cells against what is expected without them.

    Returns
    -------
    ratio : float
        Log-likelihood ratio.
    share : float
        Largest share of theirs in what is expected of a bin with an echo.
    asked : float
        1 if there is such a bin.
    """
    noise, ratio, share, asked = looks.numbers[ping, NOISE], 0.0, 0.0, 0.0
    for place in range(bins):
        b, part = first + place, own[place]
        level, kind = levels[0, b], looks.kind[ping, b]
        if kind == ECHO and part > 0.0:
            asked = 1.0
        if kind != UNJUDGED and part >= LEAST_SHARE * level:
            without = max(level - part, noise)
            ratio += bin_ratio(looks, ping, b, level, without, levels[1, b])
            if kind == ECHO:
                share = max(share, part / level)
    return ratio, share, asked


@inlined
def _add_neighbours(
    field: Field, parts: Parts, entry: int, block: NDArray[np.float64]
) -> tuple[int, int]:
    """Set what a cell and its neighbours return; returns its first range bin, and the length."""
    row, column = divmod(parts.cell[entry], field.columns)
    first, end = parts.begin[entry], parts.begin[entry] + parts.length[entry]
    for up in range(max(row - 1, 0), min(row + 2, field.rows)):
        for right in range(max(column - 1, 0), min(column + 2, field.columns)):
            beside = parts.place[up * field.columns + right]
            if beside >= 0:
                first = min(first, parts.begin[beside])
                end = max(end, parts.begin[beside] + parts.length[beside])
    length = min(end - first, BLOCK_BINS)
    for place in range(length):
        block[place] = 0.0
    for up in range(max(row - 1, 0), min(row + 2, field.rows)):
        for right in range(max(column - 1, 0), min(column + 2, field.columns)):
            beside = parts.place[up * field.columns + right]
            if beside >= 0:
                shift = parts.begin[beside] - first
                for place in range(min(parts.length[beside], BLOCK_BINS - shift)):
                    block[shift + place] += parts.power[beside, place]
    return first, length


@inlined
def _point_back(
    looks: Looks,
    ping: int,
    field: Field,
    cell: int,
    share: float,
    echoes: NDArray[np.int32],
    evidence: CellEvidence,
) -> None:
    """Add from where a cell is heard, and how many echoes crowd around its own."""
    numbers, bins = looks.numbers[ping], looks.bins[ping]
    row, column = divmod(cell, field.columns)
    x = (field.first_column + column + 0.5) * field.resolution_m - numbers[X]
    y = (field.first_row + row + 0.5) * field.resolution_m - numbers[Y]
    squared = x * x + y * y
    distance, around = math.sqrt(squared), int(CROWD_M / numbers[BIN_M])
    middle = int((distance - numbers[LEAST_RANGE]) / numbers[BIN_M])
    near, far = min(bins, max(0, middle - around)), min(bins, max(0, middle + around))
    evidence.heard[cell] += share
    evidence.axis_cos[cell] += share * (x * x - y * y) / squared
    evidence.axis_sin[cell] += share * 2.0 * x * y / squared
    evidence.from_x[cell] -= share * x / distance
    evidence.from_y[cell] -= share * y / distance
    evidence.crowd[cell] += share * (echoes[far] - echoes[near])
