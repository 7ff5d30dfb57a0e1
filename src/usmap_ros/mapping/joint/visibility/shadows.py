"""Shadows: which rows of a projection are heard past what is in the way."""

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.visibility.projection import LEAST_SHARE, LOUD_POWER, Projection
from usmap_ros.mapping.joint.visibility.ray_casting import WHOLE
from usmap_ros.mapping.ping_table import NOISE, PingTable
from usmap_ros.numerics.compiled import compiled

#: Until rays are cast again, no power is expected to rise to more than so many times what it is.
MOST_RISE = 3.0


@compiled
def cast_shadows(
    rows: Projection,
    number: NDArray[np.int32],
    power: NDArray[np.float32],
    left: NDArray[np.uint8],
    faintest: NDArray[np.float32],
    heard: Projection,
) -> None:
    """Set the rows that are heard past what is in the way.

    Parameters
    ----------
    rows : Projection
        Of all scatterers; those that are no more are left out of it, too, from now on.
    number : (scatterers,) int32 array
        Which each is from now on; -1: it is no more.
    power : (scatterers,) float32 array
        Of each that there is from now on.
    left : (pings, RAYS, STEPS) uint8 array
        By `usmap_ros.mapping.joint.visibility.ray_casting.cast_rays`; of no pings if nothing is in
        the way.
    faintest : (pings,) float32 array
        Weight below which nothing of a row is heard, of each ping.
    heard : Projection
        Set, but for rays and steps.
    """
    kept, begin, count = 0, 0, 0
    for index in range(len(rows.start) - 1):
        end = rows.start[index + 1]
        for row in range(begin, end):
            scatterer = number[rows.scatterer[row]]
            if scatterer < 0:
                continue
            weight, low, high = rows.weight[row], rows.low[row], rows.high[row]
            is_heard, ray, step = rows.heard[row], rows.ray[row], rows.step[row]
            rows.scatterer[kept], rows.weight[kept] = scatterer, weight
            rows.low[kept], rows.high[kept], rows.heard[kept] = low, high, is_heard
            rows.ray[kept], rows.step[kept] = ray, step
            kept += 1
            if len(left) > 0:
                weight *= left[index, ray, step] * np.float32(1.0 / WHOLE)
            heard.scatterer[count], heard.weight[count] = scatterer, weight
            heard.low[count], heard.high[count], heard.heard[count] = low, high, is_heard
            loud = min(power[scatterer] * np.float32(MOST_RISE / LOUD_POWER), np.float32(1.0))
            count += weight * loud >= faintest[index]
        begin, rows.start[index + 1], heard.start[index + 1] = end, kept, count


def faintest_weights(table: PingTable, pings: NDArray[np.int64]) -> NDArray[np.float32]:
    """Weights below which nothing is heard of a scatterer, of each ping."""
    weights: NDArray[np.float32] = (LEAST_SHARE / LOUD_POWER * table.numbers[pings, NOISE]).astype(
        np.float32
    )
    return weights
