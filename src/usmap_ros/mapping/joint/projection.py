"""Projection of cells onto the range bins of pings: where each may be heard, and how loudly.

One row for each pair of a ping and a quarter of a cell that may hold something.  Rows of a ping lie
one behind the other, and in them those of a cell.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.field import NOISE, Field, X, Y
from usmap_ros.mapping.joint.ray_casting import RAYS, STEPS, WHOLE
from usmap_ros.mapping.superposition.cells import QUARTERS
from usmap_ros.mapping.superposition.ping_bins import GAIN_STEPS
from usmap_ros.mapping.superposition.window import Looks
from usmap_ros.numerics.compiled import compiled, inlined

#: A cell hides nothing that lies within so many cells behind it: they answer together.
OWN_DEPTH_CELLS = 3.0
#: What would not reach this share of the noise, with `LOUD_POWER`, is left out.
LEAST_SHARE, LOUD_POWER = 0.01, 0.3
#: Range bins to either side over which a quarter is blurred at the most.
MOST_BLUR_BINS = 6.0


class Projection(NamedTuple):
    """Rows of all pings.

    Parameters
    ----------
    quarter : (rows,) int32 array
        Which quarter.
    weight : (rows,) float32 array
        Power in a whole bin, if the quarter scatters with power 1.
    low, high : (rows,) float32 arrays
        Range bins, with fractions, between which its power lies.
    heard : (rows,) uint8 array
        1 if there is an echo between: silence in the other bins says nothing then, because what
        stands in a quarter echoes at once.
    ray, step : (rows,) uint8 arrays
        Where in the tables of `cast_rays` it is seen what is left of the sound.
    start : (pings + 1,) int64 array
        First row of each ping, and the end.
    """

    quarter: NDArray[np.int32]
    weight: NDArray[np.float32]
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    heard: NDArray[np.uint8]
    ray: NDArray[np.uint8]
    step: NDArray[np.uint8]
    start: NDArray[np.int64]


def project(
    looks: Looks, pings: NDArray[np.int64], field: Field, power: NDArray[np.float32]
) -> Projection:
    """Project all quarters that have any power, without shadows.

    Parameters
    ----------
    looks, pings, field
        As in `usmap_ros.mapping.joint.ray_casting.cast_rays`.
    power : (quarters,) float32 array
        Of each.
    """
    alive = (power.reshape(-1, QUARTERS) > 0.0).any(axis=1).reshape(field.shape)
    cell_rows, cell_columns = np.nonzero(alive)
    begins = np.searchsorted(cell_rows, np.arange(field.rows + 1)).astype(np.int64)
    start = np.zeros(len(pings) + 1, np.int64)
    size = 1024 * len(pings) + 1024
    projection, done = _empty(size, start), 0
    while True:
        done = _project(looks, pings, field, cell_columns, begins, power, projection, done)
        if done == len(pings):
            return projection
        size *= 2
        larger = _empty(size, start)
        pairs: Iterable[Any] = zip(projection[:-1], larger[:-1], strict=True)
        for old, new in pairs:
            new[: len(old)] = old
        projection = larger


def _empty(size: int, start: NDArray[np.int64]) -> Projection:
    weight, low, high = (np.empty(size, np.float32) for _ in range(3))
    heard, ray, step = (np.empty(size, np.uint8) for _ in range(3))
    return Projection(np.empty(size, np.int32), weight, low, high, heard, ray, step, start)


def cast_shadows(
    rows: Projection,
    power: NDArray[np.float32],
    left: NDArray[np.uint8],
    faintest: NDArray[np.float32],
) -> Projection:
    """The rows that are heard past what is in the way.

    Parameters
    ----------
    rows : Projection
        Of all quarters; those without any power are left out of it, too, from now on.
    power : (quarters,) float32 array
        Of each.
    left : (pings, RAYS, STEPS) uint8 array
        By `usmap_ros.mapping.joint.ray_casting.cast_rays`.
    faintest : (pings,) float32 array
        Weight below which nothing of a row is heard, of each ping.
    """
    heard = _empty(int(rows.start[-1]), np.zeros_like(rows.start))
    _cast_shadows(rows, power, left, faintest, heard)
    return heard


@compiled
def _cast_shadows(
    rows: Projection,
    power: NDArray[np.float32],
    left: NDArray[np.uint8],
    faintest: NDArray[np.float32],
    heard: Projection,
) -> None:
    """Set `heard`, and compact `rows`."""
    kept, begin, count = 0, 0, 0
    for index in range(len(rows.start) - 1):
        end = rows.start[index + 1]
        for row in range(begin, end):
            if power[rows.quarter[row]] <= 0.0:
                continue
            rows.quarter[kept], rows.weight[kept] = rows.quarter[row], rows.weight[row]
            rows.low[kept], rows.high[kept] = rows.low[row], rows.high[row]
            rows.heard[kept] = rows.heard[row]
            rows.ray[kept], rows.step[kept] = rows.ray[row], rows.step[row]
            weight = rows.weight[kept] * (left[index, rows.ray[kept], rows.step[kept]] / WHOLE)
            if weight >= faintest[index]:
                heard.quarter[count], heard.weight[count] = rows.quarter[kept], weight
                heard.low[count], heard.high[count] = rows.low[kept], rows.high[kept]
                heard.heard[count] = rows.heard[kept]
                count += 1
            kept += 1
        begin, rows.start[index + 1], heard.start[index + 1] = end, kept, count


def faintest_weights(looks: Looks, pings: NDArray[np.int64]) -> NDArray[np.float32]:
    """Weights below which nothing is heard of a quarter, of each ping."""
    weights: NDArray[np.float32] = (LEAST_SHARE / LOUD_POWER * looks.numbers[pings, NOISE]).astype(
        np.float32
    )
    return weights


class _Beam(NamedTuple):
    """What it takes to place a quarter in one ping; positions are from the transducer, m."""

    ping: int
    axis_x: float
    axis_y: float
    axis_z: float
    rise: float
    cosine: float
    sine: float
    half: float
    cos_half: float
    least: float
    greatest: float
    absorption: float
    bin_m: float
    faintest: float
    blur: float
    resolution_m: float


@compiled
def _project(
    looks: Looks,
    pings: NDArray[np.int64],
    field: Field,
    cell_columns: NDArray[np.int64],
    begins: NDArray[np.int64],
    power: NDArray[np.float32],
    rows: Projection,
    first: int,
) -> int:
    """Project onto pings from the first on; returns the first for which there was no room."""
    res = field.resolution_m
    for index in range(first, len(pings)):
        count, beam = rows.start[index], _beam(looks, pings[index], res)
        x0, y0, reach = looks.numbers[beam.ping, X], looks.numbers[beam.ping, Y], beam.greatest
        bottom = max(0, math.floor((y0 - reach) / res) - field.first_row)
        top = min(field.rows, math.ceil((y0 + reach) / res) - field.first_row + 1)
        for row in range(bottom, top):
            cell_y = (field.first_row + row + 0.5) * res - y0
            for place in range(begins[row], begins[row + 1]):
                cell_x = (field.first_column + cell_columns[place] + 0.5) * res - x0
                is_behind = beam.axis_x * cell_x + beam.axis_y * cell_y < -res
                if cell_x < -reach - res or (beam.cos_half > 0.0 and is_behind):
                    continue
                if cell_x > reach + res:
                    break
                if count + QUARTERS > len(rows.quarter):
                    return index
                for part in range(QUARTERS):
                    quarter = (row * field.columns + cell_columns[place]) * QUARTERS + part
                    if power[quarter] <= 0.0:
                        continue
                    x = cell_x + (0.25 * res if part & 1 else -0.25 * res)
                    y = cell_y + (0.25 * res if part & 2 else -0.25 * res)
                    weight, low, high, heard, ray, step = _placed(looks, beam, x, y)
                    if weight > 0.0:
                        rows.quarter[count], rows.weight[count] = quarter, weight
                        rows.low[count], rows.high[count], rows.heard[count] = low, high, heard
                        rows.ray[count], rows.step[count] = ray, step
                        count += 1
        rows.start[index + 1] = count
    return len(pings)


@inlined
def _beam(looks: Looks, ping: int, resolution_m: float) -> _Beam:
    """A ping, to place quarters in it."""
    _, _, axis_x, axis_y, axis_z, rise, heading, half = looks.numbers[ping, :8]
    cos_half, least, greatest, absorption, range_std, bin_m, noise = looks.numbers[ping, 8:15]
    return _Beam(
        ping, axis_x, axis_y, axis_z, rise, math.cos(heading), math.sin(heading), half, cos_half,
        least, greatest, absorption, bin_m, LEAST_SHARE * noise / LOUD_POWER,
        3.0 * (range_std / bin_m) ** 2, resolution_m,
    )  # fmt: skip


@inlined
def _placed(
    looks: Looks, beam: _Beam, x: float, y: float
) -> tuple[float, float, float, int, int, int]:
    """Where a quarter is in a ping: its row of a `Projection`, but for which quarter it is.

    The weight is 0 where nothing of it can be heard.
    """
    squared = x * x + y * y + beam.rise * beam.rise
    ahead = beam.axis_x * x + beam.axis_y * y + beam.axis_z * beam.rise
    is_inside = beam.least * beam.least < squared < beam.greatest * beam.greatest
    if not is_inside or ahead * abs(ahead) <= squared * beam.cos_half * abs(beam.cos_half):
        return 0.0, 0.0, 0.0, 0, 0, 0
    distance = math.sqrt(squared)
    entry = (1.0 - ahead / distance) / (1.0 - beam.cos_half) * GAIN_STEPS
    at = min(max(int(entry), 0), GAIN_STEPS - 1)
    low_gain, high_gain = looks.power_gain[beam.ping, at], looks.power_gain[beam.ping, at + 1]
    weight = (low_gain + (high_gain - low_gain) * (entry - at)) / squared**2
    weight *= math.exp(-beam.absorption * distance)
    if weight < beam.faintest:
        return 0.0, 0.0, 0.0, 0, 0, 0
    off = math.atan2(beam.cosine * y - beam.sine * x, beam.cosine * x + beam.sine * y)
    depth = 0.25 * beam.resolution_m / beam.bin_m * (abs(x) + abs(y)) / distance
    middle = (distance - beam.least) / beam.bin_m
    blurred = max(min(math.sqrt(depth * depth + beam.blur), MOST_BLUR_BINS), depth)
    earliest = min(int(max(middle - blurred, 0.0)), looks.bins[beam.ping])
    echo = looks.next_echo[beam.ping, earliest]
    heard = 1 if echo <= middle + blurred else 0
    if heard and looks.bearing_weight[beam.ping, echo] > 0.0:
        beside = off - looks.bearing[beam.ping, echo]
        weight *= math.exp(-looks.bearing_weight[beam.ping, echo] * beside * beside)
        if weight < beam.faintest:
            return 0.0, 0.0, 0.0, 0, 0, 0
    reach = blurred if heard else depth
    ray = min(max(int((off + beam.half) * RAYS / (2.0 * beam.half)), 0), RAYS - 1)
    step = int((distance - OWN_DEPTH_CELLS * beam.resolution_m) * STEPS / beam.greatest)
    step = min(max(step, 0), STEPS - 1)
    return 0.5 * weight / depth, middle - reach, middle + reach, heard, ray, step
