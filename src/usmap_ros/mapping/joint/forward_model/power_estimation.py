"""Power estimation: what every quarter of a cell scatters, likeliest by all pings together.

The forward model is that of `docs/mapping.md`: range bin b of a ping should
return λ_b = noise + Σ w_qb v_q, and what it returns is exponentially distributed about λ.  Of a
silent bin only a limit is known, and its power counts as expected below that.  The multiplicative
update v ← v · Σ w y/λ² / Σ w/λ climbs to the greatest likelihood ([1]_, with exponent 1: converged
after some sixteen sweeps); quarters that no echo needs vanish.

References
----------
.. [1] Févotte, Bertin & Durrieu, "Nonnegative matrix factorization with the Itakura-Saito
   divergence", Neural Computation 21 (2009) 793-830, equation 4.5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.visibility.projection import Projection
from usmap_ros.mapping.ping_bins import ECHO, SILENCE
from usmap_ros.mapping.ping_table import ABSORPTION, BIN_M, LEAST_RANGE, NOISE, PingTable
from usmap_ros.numerics.compiled import compiled, inlined
from usmap_ros.numerics.elementary import exp32

#: Power that a scatterer starts with, and below which it vanishes, at the most; and both as shares
#: of the power by which a single one would explain a usual echo.
FIRST_POWER, LEAST_POWER, FIRST_SHARE, LEAST_SHARE = 0.02, 1e-3, 0.2, 0.1
#: No update raises a power by more.
MOST_GROWTH = 100.0


class PowerLimits(NamedTuple):
    """Between which powers scatterers are looked for."""

    #: Power that each starts with, and below which it vanishes.
    first: float
    least: float


def power_limits(table: PingTable, pings: NDArray[np.int64]) -> PowerLimits:
    """Powers that are of interest in a place, by how loud its echoes are.

    One wall returns half of the sound to where it comes from, and another, which mirrors most, a
    thousandth; the corners of the latter are as loud as those of any, so that no scale of
    amplitudes makes up for it.

    Parameters
    ----------
    table : PingTable
        Pings.
    pings : (pings,) integer array
        Rows of those that count.

    Returns
    -------
    limits : PowerLimits
        By the median echo; the usual ones where there is none.
    """
    in_bins = np.arange(table.kind.shape[1]) < table.bins[pings, np.newaxis]
    ping, place = np.nonzero((table.kind[pings] == ECHO) & in_bins)
    if not len(ping):
        return PowerLimits(FIRST_POWER, LEAST_POWER)
    numbers = table.numbers[pings[ping]]
    range_m = numbers[:, LEAST_RANGE] + (place + 0.5) * numbers[:, BIN_M]
    spreading = range_m**4 * np.exp(numbers[:, ABSORPTION] * range_m)
    usual = float(np.median(table.power[pings[ping], place] * spreading))
    return PowerLimits(min(FIRST_POWER, FIRST_SHARE * usual), min(LEAST_POWER, LEAST_SHARE * usual))


@inlined
def _expect(
    table: PingTable,
    ping: int,
    rows: Projection,
    index: int,
    power: NDArray[np.float32],
    slope: NDArray[np.float64],
    expected: NDArray[np.float32],
) -> None:
    """Set what one ping is expected to return.

    A row adds a box to the bins between its ends.  What is added up here is how much the bins
    differ from those before them, four numbers a row, however wide it is.

    Parameters
    ----------
    table, ping, rows, index, power
        The ping, and the place of its rows.
    slope : (2 (bins + 2),) array
        Room for differences: of what all bins have, and of what silent bins lack, in turn.
    expected : (bins,) float32 array
        λ; set.
    """
    bins, noise = table.bins[ping], table.numbers[ping, NOISE]
    for place in range(2 * bins + 4):
        slope[place] = 0.0
    for place in range(rows.start[index], rows.start[index + 1]):
        row = np.uint64(place)
        part = np.float64(rows.weight[row] * power[np.uint32(rows.scatterer[row])])
        low, high, heard = rows.low[row], rows.high[row], np.uint32(rows.heard[row])
        first, last = np.uint32(low), np.uint32(high)
        beyond, beyond_end = part * (low - np.float32(first)), part * (high - np.float32(last))
        first, last = np.uint32(2) * first + heard, np.uint32(2) * last + heard
        slope[first] += part - beyond
        slope[first + np.uint32(2)] += beyond
        slope[last] -= part - beyond_end
        slope[last + np.uint32(2)] -= beyond_end
    anywhere, not_silent = 0.0, 0.0
    for b in range(bins):
        anywhere += slope[2 * b]
        not_silent += slope[2 * b + 1]
        level = anywhere if table.kind[ping, b] == SILENCE else anywhere + not_silent
        expected[b] = noise + max(level, 0.0)


@compiled
def expect_powers(
    table: PingTable,
    pings: NDArray[np.int64],
    rows: Projection,
    power: NDArray[np.float32],
    expected: NDArray[np.float32],
) -> None:
    """The forward model: set the power that is expected in each range bin of each ping.

    Parameters
    ----------
    table, pings
        The pings.
    rows : Projection
        Of the scatterers.
    power : (scatterers,) float32 array
        Of each.
    expected : (pings, bins) float32 array
        λ; set.
    """
    slope = np.empty(2 * expected.shape[1] + 4)
    for index in range(len(pings)):
        _expect(table, pings[index], rows, index, power, slope, expected[index])


@compiled
def gather_gradients(
    table: PingTable,
    pings: NDArray[np.int64],
    weights: NDArray[np.float32],
    rows: Projection,
    power: NDArray[np.float32],
    gradients: NDArray[np.float32],
) -> None:
    """Add both parts of the gradient of the log-likelihood with respect to powers.

    Parameters
    ----------
    table, pings, rows, power
        As in `expect_powers`.
    weights : (pings,) float32 array
        How much each ping counts.
    gradients : (scatterers, 2) float32 array
        Σ w y/λ² and Σ w/λ; added to.
    """
    most = table.kind.shape[1]
    slope, expected = np.empty(2 * most + 4), np.empty(most, np.float32)
    # Sums over the bins before each, for rows that no echo is heard of, and for the others.
    sums = np.zeros(4 * (most + 2))
    longest = most
    for index in range(len(pings)):
        longest = max(longest, rows.start[index + 1] - rows.start[index])
    slopes = np.empty((longest, 2), np.float32)
    for index in range(len(pings)):
        _expect(table, pings[index], rows, index, power, slope, expected)
        _sum_slopes(table, pings[index], weights[index], expected, slopes, sums)
        begin, end = rows.start[index], rows.start[index + 1]
        _slope_of_rows(rows, begin, end, sums, slopes)
        for place in range(end - begin):
            scatterer = np.uint32(rows.scatterer[np.uint64(begin + place)])
            gradients[scatterer, 0] += slopes[place, 0]
            gradients[scatterer, 1] += slopes[place, 1]


@inlined
def _slope_of_rows(
    rows: Projection,
    begin: int,
    end: int,
    sums: NDArray[np.float64],
    slopes: NDArray[np.float32],
) -> None:
    """Set both parts of the gradient that some rows of a ping add.

    Parameters
    ----------
    rows, begin, end : Projection, int, int
        Which.
    sums : (4 (bins + 2),) array
        By `_sum_slopes`.
    slopes : (rows, 2) float32 array
        Set.
    """
    for place in range(end - begin):
        row = np.uint64(begin + place)
        low, high, heard = rows.low[row], rows.high[row], np.uint32(2) * np.uint32(rows.heard[row])
        first, last = np.uint32(low), np.uint32(high)
        inside, inside_end = low - np.float32(first), high - np.float32(last)
        first, last = np.uint32(4) * first + heard, np.uint32(4) * last + heard
        raised, lowered = sums[last], sums[last + np.uint32(1)]
        raised += inside_end * (sums[last + np.uint32(4)] - raised)
        lowered += inside_end * (sums[last + np.uint32(5)] - lowered)
        before, before_lowered = sums[first], sums[first + np.uint32(1)]
        raised -= before + inside * (sums[first + np.uint32(4)] - before)
        lowered -= before_lowered + inside * (sums[first + np.uint32(5)] - before_lowered)
        slopes[place, 0] = np.float32(raised) * rows.weight[row]
        slopes[place, 1] = np.float32(lowered) * rows.weight[row]


@inlined
def _sum_slopes(
    table: PingTable,
    ping: int,
    weight: float,
    expected: NDArray[np.float32],
    slopes: NDArray[np.float32],
    sums: NDArray[np.float64],
) -> None:
    """Set sums of y/λ² and 1/λ over the bins before each.

    Parameters
    ----------
    table, ping, weight, expected
        The ping, how much it counts, and what is expected of it.
    slopes : (bins, 2) float32 array
        Room for both of each bin.
    sums : (4 (bins + 2),) array
        Of each bin four: with silent bins, and without.
    """
    bins, count = table.bins[ping], np.float32(weight)
    loud = np.float32(table.numbers[ping, NOISE] * 1.0001)
    none, one = np.float32(0.0), np.float32(1.0)
    # So many at once as the processor can, and then their sums.
    for b in range(bins):
        level, kind, limit = expected[b], table.kind[ping, b], table.limit[ping, b]
        per_level = one / level
        below = _mean_below(limit, level, limit * per_level)
        mean = table.power[ping, b] if kind == ECHO else below
        is_told = (kind == ECHO) | ((kind == SILENCE) & (level > loud))
        lowers = count * per_level
        # Limits of bins that are not judged are beyond all numbers.
        slopes[b, 0] = mean * per_level * lowers if is_told else none
        slopes[b, 1] = lowers if is_told else none
    total, total_lowers, echoes, echoes_lower = 0.0, 0.0, 0.0, 0.0
    for b in range(bins):
        raises, lowers = np.float64(slopes[b, 0]), np.float64(slopes[b, 1])
        is_echo = 1.0 if table.kind[ping, b] == ECHO else 0.0
        total, total_lowers = total + raises, total_lowers + lowers
        echoes, echoes_lower = echoes + is_echo * raises, echoes_lower + is_echo * lowers
        sums[4 * b + 4], sums[4 * b + 5] = total, total_lowers
        sums[4 * b + 6], sums[4 * b + 7] = echoes, echoes_lower
    for which in range(4):
        sums[4 * bins + 4 + which] = sums[4 * bins + which]


@inlined
def _mean_below(limit: np.float32, level: np.float32, ratio: np.float32) -> np.float32:
    """Mean of a power, exponential about a level, that is below a limit; and the limit over it."""
    one, half = np.float32(1.0), np.float32(0.5)
    bounded = min(max(ratio, half), np.float32(30.0))
    # What is left of the difference of two large numbers, and its series where they are alike.
    far = level - limit / (exp32(bounded) - one)
    square = ratio * ratio
    near = limit * (half - ratio * (np.float32(1 / 12) - square * np.float32(1 / 720)))
    return near if ratio < half else far


@compiled
def update_powers(
    power: NDArray[np.float32], gradients: NDArray[np.float32], least_power: float
) -> None:
    """Multiplicative update of all powers; those that are too weak vanish.

    Parameters
    ----------
    power : (scatterers,) float32 array
        Of each; set.
    gradients : (groups, scatterers, 2) float32 array
        By `gather_gradients`, of groups of pings, which are added up in their order.
    least_power : float
        Those below it vanish.
    """
    nothing, most, least = np.float32(0.0), np.float32(MOST_GROWTH), np.float32(least_power)
    for scatterer in range(len(power)):
        raises, lowers = nothing, nothing
        for group in range(len(gradients)):
            raises += gradients[group, scatterer, 0]
            lowers += gradients[group, scatterer, 1]
        ratio = raises / lowers if lowers > nothing else nothing
        updated = power[scatterer] * min(ratio, most)
        power[scatterer] = nothing if updated < least else updated
