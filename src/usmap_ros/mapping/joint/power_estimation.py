"""Power estimation: what every quarter of a cell scatters, likeliest by all pings together.

The forward model is that of `usmap_ros.mapping.superposition.powers`: range bin b of a ping should
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

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.field import NOISE, Field
from usmap_ros.mapping.joint.projection import Projection
from usmap_ros.mapping.superposition.cells import QUARTERS
from usmap_ros.mapping.superposition.ping_bins import ECHO, GAIN_STEPS, SILENCE
from usmap_ros.mapping.superposition.window import Looks
from usmap_ros.numerics.compiled import compiled

#: Power that a quarter starts with, below which it vanishes, and of a usual object.
FIRST_POWER, LEAST_POWER, USUAL_POWER = 0.02, 1e-3, 0.1
#: No update raises a power by more.
MOST_GROWTH = 100.0
#: A cell starts with power if it may have returned so many echoes, and these are such a share of
#: the times that something in it would have been heard.
LEAST_HITS, LEAST_HIT_SHARE = 0.9, 0.12


@compiled
def count_hits(
    looks: Looks,
    pings: NDArray[np.int64],
    weights: NDArray[np.float32],
    field: Field,
    hits: NDArray[np.float32],
    misses: NDArray[np.float32],
) -> None:
    """Count, for each cell, echoes that may be its, and silence where it would have been heard.

    Parameters
    ----------
    looks, pings, field
        As in `usmap_ros.mapping.joint.ray_casting.cast_rays`.
    weights : (pings,) float32 array
        How much each counts.
    hits, misses : (rows, columns) float32 arrays
        Added to.
    """
    res = field.resolution_m
    for index in range(len(pings)):
        ping = pings[index]
        numbers, bins = looks.numbers[ping], looks.bins[ping]
        x0, y0, axis_x, axis_y, axis_z, rise = numbers[:6]
        cos_half, least, greatest, absorption = numbers[8:12]
        range_std, bin_m = numbers[12:14]
        wide, blur = cos_half * abs(cos_half), 3.0 * (range_std / bin_m) ** 2
        bottom = max(0, math.floor((y0 - greatest) / res) - field.first_row)
        top = min(field.rows, math.ceil((y0 + greatest) / res) - field.first_row + 1)
        left = max(0, math.floor((x0 - greatest) / res) - field.first_column)
        right = min(field.columns, math.ceil((x0 + greatest) / res) - field.first_column + 1)
        for row in range(bottom, top):
            y = (field.first_row + row + 0.5) * res - y0
            for column in range(left, right):
                x = (field.first_column + column + 0.5) * res - x0
                ahead = axis_x * x + axis_y * y + axis_z * rise
                if cos_half > 0.0 and ahead <= 0.0:
                    continue
                squared = x * x + y * y + rise * rise
                if squared <= least * least or squared >= greatest * greatest:
                    continue
                if ahead * abs(ahead) <= squared * wide:
                    continue
                distance = math.sqrt(squared)
                middle = (distance - least) / bin_m
                depth = 0.5 * res / bin_m * (abs(x) + abs(y)) / distance
                blurred = min(math.sqrt(depth * depth + blur), 12.0)
                earliest = min(int(max(middle - blurred, 0.0)), bins)
                if looks.next_echo[ping, earliest] <= middle + blurred:
                    hits[row, column] += weights[index]
                    continue
                b = min(int(middle), bins - 1)
                if looks.kind[ping, b] == SILENCE:
                    entry = (1.0 - ahead / distance) / (1.0 - cos_half) * GAIN_STEPS
                    gain = looks.power_gain[ping, min(max(int(entry), 0), GAIN_STEPS)]
                    loud = USUAL_POWER * gain / squared**2 * math.exp(-absorption * distance)
                    loud /= looks.limit[ping, b]
                    misses[row, column] += weights[index] * loud / (1.0 + loud)


def first_powers(hits: NDArray[np.float32], misses: NDArray[np.float32]) -> NDArray[np.float32]:
    """Powers to start from: of all cells that may well have returned echoes."""
    is_candidate = (hits >= LEAST_HITS) & (hits > LEAST_HIT_SHARE * (hits + misses))
    start = np.where(is_candidate, np.float32(FIRST_POWER), np.float32(0.0))
    return np.repeat(start.ravel(), QUARTERS)


@compiled
def expect_powers(
    looks: Looks,
    pings: NDArray[np.int64],
    rows: Projection,
    power: NDArray[np.float32],
    expected: NDArray[np.float32],
) -> None:
    """The forward model: set the power that is expected in each range bin of each ping.

    Parameters
    ----------
    looks, pings
        The pings.
    rows : Projection
        Of the quarters.
    power : (quarters,) float32 array
        Of each.
    expected : (pings, bins) float32 array
        λ; set.
    """
    for index in range(len(pings)):
        ping = pings[index]
        bins = looks.bins[ping]
        for b in range(bins):
            expected[index, b] = looks.numbers[ping, NOISE]
        for row in range(rows.start[index], rows.start[index + 1]):
            v = power[rows.quarter[row]]
            if v <= 0.0:
                continue
            part, low, high = rows.weight[row] * v, rows.low[row], rows.high[row]
            for b in range(max(0, int(low)), min(bins - 1, int(high)) + 1):
                if rows.heard[row] and looks.kind[ping, b] == SILENCE:
                    continue
                expected[index, b] += part * (min(high, b + 1.0) - max(low, float(b)))


@compiled
def gather_gradients(
    looks: Looks,
    pings: NDArray[np.int64],
    weights: NDArray[np.float32],
    rows: Projection,
    power: NDArray[np.float32],
    expected: NDArray[np.float32],
    raises: NDArray[np.float32],
    lowers: NDArray[np.float32],
) -> None:
    """Add both parts of the gradient of the log-likelihood with respect to powers.

    Parameters
    ----------
    looks, pings, rows, power, expected
        As in `expect_powers`, after it.
    weights : (pings,) float32 array
        How much each ping counts.
    raises, lowers : (quarters,) float32 arrays
        Σ w y/λ² and Σ w/λ; added to.
    """
    up, down = np.zeros((2, expected.shape[1])), np.zeros((2, expected.shape[1]))
    for index in range(len(pings)):
        ping = pings[index]
        bins, noise = looks.bins[ping], looks.numbers[ping, NOISE]
        for b in range(bins):
            level, kind = expected[index, b], looks.kind[ping, b]
            up[0, b] = up[1, b] = down[0, b] = down[1, b] = 0.0
            if kind == ECHO:
                up[0, b] = up[1, b] = looks.power[ping, b] / (level * level)
                down[0, b] = down[1, b] = 1.0 / level
            elif kind == SILENCE and level > noise * 1.0001:
                limit = looks.limit[ping, b]
                ratio, mean = limit / level, level
                if ratio < 1e-3:
                    mean = 0.5 * limit
                elif ratio < 30.0:
                    mean = level - limit / (math.exp(ratio) - 1.0)
                up[0, b], down[0, b] = mean / (level * level), 1.0 / level
        for row in range(rows.start[index], rows.start[index + 1]):
            quarter = rows.quarter[row]
            if power[quarter] <= 0.0:
                continue
            low, high, heard = rows.low[row], rows.high[row], rows.heard[row]
            raised, lowered = 0.0, 0.0
            for b in range(max(0, int(low)), min(bins - 1, int(high)) + 1):
                part = min(high, b + 1.0) - max(low, float(b))
                raised += part * up[heard, b]
                lowered += part * down[heard, b]
            scale = rows.weight[row] * weights[index]
            raises[quarter] += raised * scale
            lowers[quarter] += lowered * scale


def update_powers(
    power: NDArray[np.float32], raises: NDArray[np.float32], lowers: NDArray[np.float32]
) -> None:
    """Multiplicative update of all powers; those that are too weak vanish."""
    ratio = np.divide(raises, lowers, out=np.zeros_like(raises), where=lowers > 0.0)
    power *= np.minimum(ratio, np.float32(MOST_GROWTH))
    power[power < LEAST_POWER] = 0.0
