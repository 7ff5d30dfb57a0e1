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

from usmap_ros.mapping.joint.field import NOISE, Field
from usmap_ros.mapping.joint.ray_casting import RAYS, STEPS, WHOLE
from usmap_ros.mapping.superposition.cells import QUARTERS
from usmap_ros.mapping.superposition.ping_bins import GAIN_STEPS
from usmap_ros.mapping.superposition.window import Looks
from usmap_ros.numerics.compiled import compiled

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


@compiled
def _project(  # noqa: C901, PLR0912, PLR0915
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
        ping, count = pings[index], rows.start[index]
        numbers, bins = looks.numbers[ping], looks.bins[ping]
        x0, y0, axis_x, axis_y, axis_z, rise = numbers[:6]
        heading, half, cos_half, least, greatest, absorption = numbers[6:12]
        range_std, bin_m, noise = numbers[12:15]
        cosine, sine, wide = math.cos(heading), math.sin(heading), cos_half * abs(cos_half)
        blur, to_depth = 3.0 * (range_std / bin_m) ** 2, 0.25 * res / bin_m
        faintest = LEAST_SHARE * noise / LOUD_POWER
        to_ray, to_step = RAYS / (2.0 * half), STEPS / greatest
        bottom = max(0, math.floor((y0 - greatest) / res) - field.first_row)
        top = min(field.rows, math.ceil((y0 + greatest) / res) - field.first_row + 1)
        for row in range(bottom, top):
            cell_y = (field.first_row + row + 0.5) * res - y0
            for place in range(begins[row], begins[row + 1]):
                column = cell_columns[place]
                cell_x = (field.first_column + column + 0.5) * res - x0
                if cell_x < -greatest - res or (
                    cos_half > 0.0 and axis_x * cell_x + axis_y * cell_y < -res
                ):
                    continue
                if cell_x > greatest + res:
                    break
                if count + QUARTERS > len(rows.quarter):
                    return index
                for part in range(QUARTERS):
                    quarter = (row * field.columns + column) * QUARTERS + part
                    if power[quarter] <= 0.0:
                        continue
                    x = cell_x + (0.25 * res if part & 1 else -0.25 * res)
                    y = cell_y + (0.25 * res if part & 2 else -0.25 * res)
                    squared = x * x + y * y + rise * rise
                    ahead = axis_x * x + axis_y * y + axis_z * rise
                    if squared <= least * least or squared >= greatest * greatest:
                        continue
                    if ahead * abs(ahead) <= squared * wide:
                        continue
                    distance = math.sqrt(squared)
                    entry = (1.0 - ahead / distance) / (1.0 - cos_half) * GAIN_STEPS
                    at = min(max(int(entry), 0), GAIN_STEPS - 1)
                    low_gain, high_gain = looks.power_gain[ping, at], looks.power_gain[ping, at + 1]
                    weight = (low_gain + (high_gain - low_gain) * (entry - at)) / squared**2
                    weight *= math.exp(-absorption * distance)
                    if weight < faintest:
                        continue
                    off = math.atan2(cosine * y - sine * x, cosine * x + sine * y)
                    depth = to_depth * (abs(x) + abs(y)) / distance
                    middle = (distance - least) / bin_m
                    blurred = max(min(math.sqrt(depth * depth + blur), MOST_BLUR_BINS), depth)
                    earliest = min(int(max(middle - blurred, 0.0)), bins)
                    heard = looks.next_echo[ping, earliest] <= middle + blurred
                    reach = blurred if heard else depth
                    if heard:
                        echo = looks.next_echo[ping, earliest]
                        fit = looks.bearing_weight[ping, echo]
                        if fit > 0.0:
                            weight *= math.exp(-fit * (off - looks.bearing[ping, echo]) ** 2)
                            if weight < faintest:
                                continue
                    rows.quarter[count], rows.weight[count] = quarter, 0.5 * weight / depth
                    rows.low[count], rows.high[count] = middle - reach, middle + reach
                    rows.heard[count] = 1 if heard else 0
                    rows.ray[count] = min(max(int((off + half) * to_ray), 0), RAYS - 1)
                    step = int((distance - OWN_DEPTH_CELLS * res) * to_step)
                    rows.step[count] = min(max(step, 0), STEPS - 1)
                    count += 1
        rows.start[index + 1] = count
    return len(pings)
