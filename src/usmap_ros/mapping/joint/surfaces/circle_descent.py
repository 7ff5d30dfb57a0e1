"""The descent to a circle through echoes: looks at it and steps of Gauss and Newton, in turn."""

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.visibility.beams import (
    LOOKING_SHARE,
    WITHIN_GREATEST_M,
    WITHIN_LEAST_M,
    amplitude_gain,
    is_beside,
    off_axis,
)
from usmap_ros.mapping.joint.visibility.echoes import Echoes
from usmap_ros.mapping.joint.visibility.ray_casting import RAYS, STEPS, WHOLE
from usmap_ros.mapping.ping_bins import SILENCE
from usmap_ros.mapping.ping_table import (
    BIN_M,
    GREATEST_RANGE,
    HALF_ANGLE,
    LEAST_RANGE,
    RANGE_STD,
    PingTable,
    X,
    Y,
)
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled, inlined

#: An echo is a column's if it is so near to where it should be, m, or within so many standard
#: deviations of the range by the ping's pose.
TOLERANCE_M, WITHIN_STDS = 0.03, 2.5
#: Hits that a circle is fitted to.
LEAST_FITTED = 6
#: Amplitude reflectivity of the faintest column that a silent ping counts against, how much louder
#: than what would have been reported it would be, and share of the sound that must get there.
FAINTEST, LOUD, CLEAR_SHARE = 0.3, 1.3, 0.6
#: Least amplitude gain of a beam.
LEAST_GAIN = 1e-4
#: Longest step to a circle, m; and how far it goes before pings that may see it are found anew.
LONGEST_STEP_M, AROUND_M = 0.05, 0.2


@compiled
def descend(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    table: PingTable,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    left: NDArray[np.uint8],
    place: FloatArray,
    steps: int,
    damping: FloatArray,
    pull: float,
    usual_radius_m: float,
    least_radius_m: float,
    most_radius_m: float,
    hit_pings: NDArray[np.int64],
    hit_echoes: NDArray[np.int64],
) -> tuple[int, int]:
    """Go from a place to the circle that fits its hits best; returns its hits and misses.

    Ends early where there are fewer hits than a circle can be fitted to.  The first ones may be
    twice as far off as the usual tolerance.
    """
    hits, misses, count, near = 0, 0, 0, np.empty(len(pings), np.int64)
    from_x, from_y = np.inf, np.inf
    for step in range(steps + 1):
        tolerance = 2.0 if step == 0 else 1.0
        if math.hypot(place[0] - from_x, place[1] - from_y) > AROUND_M:
            from_x, from_y = place[0], place[1]
            count = _near(table, pings, place, most_radius_m, near)
        hits, misses = _look_at(
            table, pings, echoes, is_open, left, place, tolerance, near[:count], hit_pings,
            hit_echoes,
        )  # fmt: skip
        if hits < LEAST_FITTED or step == steps:
            break
        _step(
            table, pings, echoes, place, damping, pull * (usual_radius_m - place[2]),
            hit_pings[:hits], hit_echoes,
        )  # fmt: skip
        place[2] = min(max(place[2], least_radius_m), most_radius_m)
    return hits, misses


@inlined
def _near(
    table: PingTable,
    pings: NDArray[np.int64],
    place: FloatArray,
    most_radius_m: float,
    near: NDArray[np.int64],
) -> int:
    """Set the pings that may see a circle around a place; returns how many there are."""
    count = 0
    for index in range(len(pings)):
        numbers = table.numbers[pings[index]]
        x, y = place[0] - numbers[X], place[1] - numbers[Y]
        far = numbers[GREATEST_RANGE] + most_radius_m + AROUND_M
        near[count] = index
        count += x * x + y * y < far * far and not is_beside(numbers, x, y, AROUND_M)
    return count


@inlined
def _step(
    table: PingTable,
    pings: NDArray[np.int64],
    echoes: Echoes,
    place: FloatArray,
    damping: FloatArray,
    pull: float,
    hit_pings: NDArray[np.int64],
    hit_echoes: NDArray[np.int64],
) -> None:
    """One step of Gauss and Newton on |c - p| - R = range, by Cramer's rule."""
    xx, xy, yy, x1, y1 = damping[0], 0.0, damping[1], 0.0, 0.0
    of_x, of_y, of_radius = 0.0, 0.0, pull
    for hit in range(len(hit_pings)):
        numbers = table.numbers[pings[hit_pings[hit]]]
        x, y = place[0] - numbers[X], place[1] - numbers[Y]
        distance = math.sqrt(x * x + y * y)
        off = echoes.range_m[hit_echoes[hit]] - (distance - place[2])
        x, y = x / distance, y / distance
        xx, xy, yy, x1, y1 = xx + x * x, xy + x * y, yy + y * y, x1 - x, y1 - y
        of_x, of_y, of_radius = of_x + x * off, of_y + y * off, of_radius - off
    ones = len(hit_pings) + damping[2]
    minor_x, minor_y, minor_1 = yy * ones - y1 * y1, xy * ones - y1 * x1, xy * y1 - yy * x1
    determinant = xx * minor_x - xy * minor_y + x1 * minor_1
    minor_yy, minor_y1 = xx * ones - x1 * x1, xx * y1 - xy * x1
    steps = (
        (minor_x * of_x - minor_y * of_y + minor_1 * of_radius) / determinant,
        (-minor_y * of_x + minor_yy * of_y - minor_y1 * of_radius) / determinant,
        (minor_1 * of_x - minor_y1 * of_y + (xx * yy - xy * xy) * of_radius) / determinant,
    )
    for axis in range(3):
        place[axis] += min(max(steps[axis], -LONGEST_STEP_M), LONGEST_STEP_M)


@inlined
def _look_at(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    table: PingTable,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    left: NDArray[np.uint8],
    place: FloatArray,
    tolerance: float,
    near: NDArray[np.int64],
    hit_pings: NDArray[np.int64],
    hit_echoes: NDArray[np.int64],
) -> tuple[int, int]:
    """Pings that heard a column, of those that may, and how many should have but did not."""
    hits, misses = 0, 0
    for index in near:
        ping = pings[index]
        numbers = table.numbers[ping]
        x, y = place[0] - numbers[X], place[1] - numbers[Y]
        distance = math.sqrt(x * x + y * y)
        across = distance - place[2]
        least, greatest = (
            numbers[LEAST_RANGE] + WITHIN_LEAST_M, numbers[GREATEST_RANGE] - WITHIN_GREATEST_M,
        )  # fmt: skip
        if across <= least or across >= greatest:
            continue
        off = off_axis(table, ping, math.atan2(y, x))
        half = numbers[HALF_ANGLE]
        if abs(off) >= LOOKING_SHARE * half:
            continue
        ray = min(max(int((off + half) * RAYS / (2.0 * half)), 0), RAYS - 1)
        step = min(max(int((across - 0.15) * STEPS / numbers[GREATEST_RANGE]), 0), STEPS - 1)
        if left[index, ray, step] < CLEAR_SHARE * WHOLE:
            continue
        widest = max(TOLERANCE_M, WITHIN_STDS * numbers[RANGE_STD])
        nearest, nearest_echo, any_echo = tolerance * widest, -1, False
        for echo in range(echoes.start[index], echoes.start[index + 1]):
            away = abs(echoes.range_m[echo] - across)
            any_echo = any_echo or away < 2.0 * tolerance * widest
            if is_open[echo] and away < nearest:
                nearest, nearest_echo = away, echo
        if nearest_echo >= 0:
            hit_pings[hits], hit_echoes[hits] = index, nearest_echo
            hits += 1
            continue
        if any_echo:
            # Somebody else's echo covers it.
            continue
        gain = max(amplitude_gain(table, ping, off), LEAST_GAIN)
        b = min(int((across - numbers[LEAST_RANGE]) / numbers[BIN_M]), table.bins[ping] - 1)
        limit = math.sqrt(table.limit[ping, b])
        if table.kind[ping, b] == SILENCE and FAINTEST * gain / across**2 > LOUD * limit:
            misses += 1
    return hits, misses
