"""Evidence of each cell: how much worse all pings would be explained without it.

Besides, from where a cell was heard: echoes from one direction leave its place along their rings
open, and so the spread of directions says how well it is known where it is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.field import BIN_M, LEAST_RANGE, NOISE, Field
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


@compiled
def gather_evidence(  # noqa: C901, PLR0912, PLR0913, PLR0915, PLR0917
    looks: Looks,
    pings: NDArray[np.int64],
    weights: NDArray[np.float32],
    rows: Projection,
    power: NDArray[np.float32],
    expected: NDArray[np.float32],
    field: Field,
    forgetting: float,
    evidence: CellEvidence,
) -> None:
    """Add what all pings, in the order of their stamps, say of all cells with any power.

    Parameters
    ----------
    looks, pings, weights, rows, power, expected
        As in `usmap_ros.mapping.joint.power_estimation.gather_gradients`.
    field : Field
        The cells.
    forgetting : float
        Share of what speaks for a cell that is forgotten with a ping that contradicts it.
    evidence : CellEvidence
        Added to.
    """
    columns = field.columns
    place = np.full(field.rows * columns, -1, np.int32)
    most = 0
    for index in range(len(pings)):
        most = max(most, rows.start[index + 1] - rows.start[index])
    parts = np.zeros((most + 1, CELL_BINS), np.float32)
    begin, cells = np.zeros(most + 1, np.int64), np.zeros(most + 1, np.int64)
    silent = np.zeros(expected.shape[1])
    used = np.zeros(most + 1, np.int64)
    block, crowd = np.zeros(BLOCK_BINS), np.zeros(expected.shape[1] + 1, np.int32)
    for index in range(len(pings)):
        ping = pings[index]
        bins, noise = looks.bins[ping], looks.numbers[ping, NOISE]
        x0, y0 = looks.numbers[ping, 0], looks.numbers[ping, 1]
        least, bin_m = looks.numbers[ping, LEAST_RANGE], looks.numbers[ping, BIN_M]
        around = int(CROWD_M / bin_m)
        for b in range(bins):
            silent[b] = 0.0
            if looks.kind[ping, b] == SILENCE:
                silent[b] = log_silent(looks.limit[ping, b], expected[index, b])
            crowd[b + 1] = crowd[b] + (1 if looks.kind[ping, b] == ECHO else 0)
        count, last = 0, -1
        for row in range(rows.start[index], rows.start[index + 1]):
            v = power[rows.quarter[row]]
            if v <= 0.0:
                continue
            cell = rows.quarter[row] // QUARTERS
            low, high = rows.low[row], rows.high[row]
            if cell != last:
                last, cells[count], place[cell] = cell, cell, count
                begin[count], used[count] = max(0, int(low) - 4), 0
                for column in range(CELL_BINS):
                    parts[count, column] = 0.0
                count += 1
            part, first = rows.weight[row] * v, begin[count - 1]
            end = min(bins - 1, int(high), first + CELL_BINS - 1) + 1
            used[count - 1] = max(used[count - 1], end - first)
            for b in range(max(first, int(low)), end):
                if rows.heard[row] and looks.kind[ping, b] == SILENCE:
                    continue
                parts[count - 1, b - first] += part * (min(high, b + 1.0) - max(low, float(b)))
        for entry in range(count):
            cell = cells[entry]
            ratio = 0.0
            for column in range(used[entry]):
                b, part = begin[entry] + column, parts[entry, column]
                level, kind = expected[index, b], looks.kind[ping, b]
                if kind != UNJUDGED and part >= LEAST_SHARE * level:
                    without = max(level - part, noise)
                    ratio += bin_ratio(looks, ping, b, level, without, silent[b])
            evidence.own[cell] = added(evidence.own[cell], ratio, weights[index], forgetting)
            row_c, column_c = cell // columns, cell % columns
            first, end = begin[entry], begin[entry] + used[entry]
            for up in range(max(row_c - 1, 0), min(row_c + 2, field.rows)):
                for right in range(max(column_c - 1, 0), min(column_c + 2, columns)):
                    beside = place[up * columns + right]
                    if beside >= 0:
                        first = min(first, begin[beside])
                        end = max(end, begin[beside] + used[beside])
            end = min(end - first, BLOCK_BINS)
            for column in range(end):
                block[column] = 0.0
            for up in range(max(row_c - 1, 0), min(row_c + 2, field.rows)):
                for right in range(max(column_c - 1, 0), min(column_c + 2, columns)):
                    beside = place[up * columns + right]
                    if beside < 0:
                        continue
                    shift = begin[beside] - first
                    for column in range(min(used[beside], BLOCK_BINS - shift)):
                        if parts[beside, column] > 0.0:
                            block[shift + column] += parts[beside, column]
            ratio, share, asked = 0.0, 0.0, 0.0
            for column in range(min(end, bins - first)):
                b, part = first + column, block[column]
                level, kind = expected[index, b], looks.kind[ping, b]
                if kind == ECHO and part > 0.0:
                    asked = 1.0
                if kind != UNJUDGED and part >= LEAST_SHARE * level:
                    without = max(level - part, noise)
                    ratio += bin_ratio(looks, ping, b, level, without, silent[b])
                    if kind == ECHO:
                        share = max(share, part / level)
            evidence.block[cell] = added(evidence.block[cell], ratio, weights[index], forgetting)
            evidence.asked[cell] += asked * weights[index]
            if share > LEAST_SHARE:
                x = (field.first_column + column_c + 0.5) * field.resolution_m - x0
                y = (field.first_row + row_c + 0.5) * field.resolution_m - y0
                squared = x * x + y * y
                distance, share = math.sqrt(squared), share * weights[index]
                middle = int((distance - least) / bin_m)
                near, far = min(bins, max(0, middle - around)), min(bins, max(0, middle + around))
                evidence.heard[cell] += share
                evidence.axis_cos[cell] += share * (x * x - y * y) / squared
                evidence.axis_sin[cell] += share * 2.0 * x * y / squared
                evidence.from_x[cell] -= share * x / distance
                evidence.from_y[cell] -= share * y / distance
                evidence.crowd[cell] += share * (crowd[far] - crowd[near])
        for entry in range(count):
            place[cells[entry]] = -1
