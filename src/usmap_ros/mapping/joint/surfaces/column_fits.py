"""A circle through echoes: what a round column returns, and how much likelier it is than others.

A column of radius R about c returns one echo to each ping that looks at it, from range |c - p| - R.
Hits count for it, the more the nearer they are to where they should be and the fewer other echoes
are around, and silence where one would have been loud counts against it.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.visibility.beams import (
    LOOKING_SHARE,
    WITHIN_GREATEST_M,
    WITHIN_LEAST_M,
    amplitude_gain,
    off_axis,
)
from usmap_ros.mapping.joint.visibility.echoes import Echoes, count_between
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
#: A column is heard by such a share of the pings that should hear it; its ranges scatter so much,
#: m, or as the poses do, but for the share of those that are something else's.
HIT_SHARE, RANGE_STD_M, STRAY_SHARE = 0.9, 0.006, 0.1
#: Echoes crowd around a hit within a reach, m; least radius, m, for corners and poles fit as well,
#: but are points.
CROWD_M, LEAST_RADIUS_M = 0.4, 0.1
#: How many more echoes of a ping there may be within `CROWD_M` before a column than behind it: of
#: one thing beside it, but not of the two walls of a corner.
MOST_MORE_BEFORE = 1.2
#: Amplitude reflectivity of the faintest column that a silent ping counts against, how much louder
#: than what would have been reported it would be, and share of the sound that must get there.
FAINTEST, LOUD, CLEAR_SHARE = 0.3, 1.3, 0.6
#: Least amplitude gain of a beam.
LEAST_GAIN = 1e-4
#: Steps of Gauss and Newton to the point that hits of a column are compared with; and the longest
#: step to a circle, m.
POINT_STEPS, LONGEST_STEP_M = 5, 0.05
#: No surface is nearer to a robot's path than this.
CLEARANCE_M = 0.05


class PingSet(NamedTuple):
    """Pings that may have heard columns.

    Parameters
    ----------
    table : PingTable
        Pings.
    pings : (pings,) integer array
        Their rows.
    echoes : Echoes
        Theirs.
    left : (pings, RAYS, STEPS) uint8 array
        By `usmap_ros.mapping.joint.visibility.ray_casting.cast_rays`.
    """

    table: PingTable
    pings: NDArray[np.int64]
    echoes: Echoes
    left: NDArray[np.uint8]


class LevenbergMarquardt(NamedTuple):
    """How the circle that fits best is gone to, after Gauss, Newton and Levenberg.

    Parameters
    ----------
    steps : int
        How many.
    damping : (3,) array
        Of the middle and the radius, over the variance of a range.
    usual_radius_m : float, optional
        What radii are pulled to by their damping.
    radii_m : (float, float)
        What they are held between.
    """

    steps: int
    damping: FloatArray
    usual_radius_m: float | None = None
    radii_m: tuple[float, float] = (0.04, 0.48)


class Circle(NamedTuple):
    """A circle that fits echoes.

    Parameters
    ----------
    x_m, y_m, radius_m : float
        Its middle and radius.
    pings, echoes : (hits,) integer arrays
        That heard it, and their echoes of it.
    misses : int
        Pings that should have heard it but did not.
    spread : float
        Of the directions that it was heard from: least eigenvalue of the mean of u uᵀ.
    log_ratio : float
        Log-likelihood ratio to echoes by chance.
    is_corner : bool
        Whether most is heard before it: two walls are heard before their corner.
    nearest_m : float
        How near to its middle a robot went.
    """

    x_m: float
    y_m: float
    radius_m: float
    pings: NDArray[np.int64]
    echoes: NDArray[np.int64]
    misses: int
    spread: float
    log_ratio: float
    is_corner: bool
    nearest_m: float

    @property
    def may_stand(self) -> bool:
        """Whether it is more than a point, and no robot went through it."""
        return LEAST_RADIUS_M < self.radius_m < self.nearest_m - CLEARANCE_M


def fitted_circle(
    ping_set: PingSet, is_open: BoolArray, place: FloatArray, descent: LevenbergMarquardt
) -> Circle | None:
    """The circle near a place, if there is one.

    Parameters
    ----------
    ping_set : PingSet
        Pings.
    is_open : (echoes,) bool array
        Echoes that may be of it.
    place : (3,) array
        Middle and radius that are begun with, m; replaced.
    descent : LevenbergMarquardt
        From there.
    """
    table, pings, echoes, left = ping_set
    hit_pings, hit_echoes = (np.empty(len(pings), np.int64) for _ in range(2))
    usual_m, pull = descent.usual_radius_m, 0.0
    if usual_m is not None:
        pull = float(descent.damping[2])
    hits, misses = _descend(
        table, pings, echoes, is_open, left, place, descent.steps, descent.damping, pull,
        usual_m or 0.0, *descent.radii_m, hit_pings, hit_echoes,
    )  # fmt: skip
    if hits < LEAST_FITTED:
        return None
    hit_pings, hit_echoes = hit_pings[:hits], hit_echoes[:hits]
    numbers, ranges_m = table.numbers[pings[hit_pings]], echoes.range_m[hit_echoes]
    offsets = place[:2] - numbers[:, [X, Y]]
    across_m = np.hypot(*offsets.T) - place[2]
    directions = offsets / np.linalg.norm(offsets, axis=1)[:, np.newaxis]
    crowd, stds_m = _crowd(echoes, hit_pings, across_m, ranges_m), numbers[:, RANGE_STD]
    return Circle(
        float(place[0]), float(place[1]), float(place[2]), hit_pings, hit_echoes, misses,
        spread=float(np.linalg.eigvalsh(directions.T @ directions / hits)[0]),
        log_ratio=_log_ratio(ranges_m - across_m, stds_m, crowd, misses),
        is_corner=_is_corner(echoes, hit_pings, across_m, stds_m),
        nearest_m=float(np.hypot(*(table.numbers[pings][:, [X, Y]] - place[:2]).T).min()),
    )  # fmt: skip


def log_ratio_of_point(ping_set: PingSet, circle: Circle) -> float:
    """Log-likelihood ratio, to echoes by chance, of the point that fits a circle's hits best.

    Most circles are neither certain nor suspected, and need not be compared with it.
    """
    table, pings, echoes, _ = ping_set
    numbers, ranges_m = table.numbers[pings[circle.pings]], echoes.range_m[circle.echoes]
    place = np.array([circle.x_m, circle.y_m, circle.radius_m])
    across_m = np.hypot(*(place[:2] - numbers[:, [X, Y]]).T) - circle.radius_m
    off_m = _off_point(numbers, ranges_m, place)
    crowd = _crowd(echoes, circle.pings, across_m, ranges_m)
    return _log_ratio(off_m, numbers[:, RANGE_STD], crowd, circle.misses)


def _crowd(
    echoes: Echoes, pings: NDArray[np.int64], across_m: FloatArray, ranges_m: FloatArray
) -> NDArray[np.int64]:
    """How many other echoes of the same ping are within `CROWD_M` of where each should be."""
    around = count_between(echoes, pings, across_m - CROWD_M, across_m + CROWD_M)
    # By poses that are very uncertain, an echo may itself be farther off.
    own: NDArray[np.int64] = around - (np.abs(ranges_m - across_m) < CROWD_M)
    return own


def _tolerance(stds_m: FloatArray) -> FloatArray:
    """How near to where it should be an echo is a column's, m, by how uncertain ranges are."""
    tolerances_m: FloatArray = np.maximum(TOLERANCE_M, WITHIN_STDS * stds_m)
    return tolerances_m


def _is_corner(
    echoes: Echoes, pings: NDArray[np.int64], across_m: FloatArray, stds_m: FloatArray
) -> bool:
    """Whether most is heard before: two walls are heard before their corner, and after columns."""
    near_m = _tolerance(stds_m)
    before = count_between(echoes, pings, across_m - CROWD_M, across_m - near_m)
    behind = count_between(echoes, pings, across_m + near_m, across_m + CROWD_M)
    return bool(before.mean() > behind.mean() + MOST_MORE_BEFORE)


def _off_point(numbers: FloatArray, ranges_m: FloatArray, place: FloatArray) -> FloatArray:
    """How far ranges are off those to the point that fits them best, near a column's surface, m."""
    offsets = place[:2] - numbers[:, [X, Y]]
    towards = (offsets / np.hypot(*offsets.T)[:, np.newaxis]).mean(axis=0)
    point = place[:2] - place[2] * towards
    for _ in range(POINT_STEPS):
        offsets = point - numbers[:, [X, Y]]
        distances = np.hypot(*offsets.T)
        step, *_ = np.linalg.lstsq(offsets / distances[:, np.newaxis], ranges_m - distances, None)
        point = point + step
    off_m: FloatArray = ranges_m - np.hypot(*(point - numbers[:, [X, Y]]).T)
    return off_m


def echoes_per_m(crowd: NDArray[np.int64]) -> FloatArray:
    """How dense echoes are around one, beside which there are so many within `CROWD_M`."""
    density: FloatArray = (crowd.astype(np.float64) + 0.5) / (2.0 * CROWD_M)
    return density


def _log_ratio(
    off_m: FloatArray, stds_m: FloatArray, crowd: NDArray[np.int64], misses: int
) -> float:
    """Log-likelihood ratio of what was heard, with a column to with echoes of anything there.

    Parameters
    ----------
    off_m : (hits,) array
        Distance of each hit from where the column's echo should be.
    stds_m : (hits,) array
        Standard deviation of each range by the ping's pose.
    crowd : (hits,) integer array
        Other echoes of the ping within `CROWD_M` of it.
    misses : int
        Pings that should have heard the column but did not.
    """
    density = echoes_per_m(crowd)
    std_m, width_m = np.maximum(stds_m, RANGE_STD_M), 2.0 * _tolerance(stds_m)
    normal = np.exp(-0.5 * (off_m / std_m) ** 2) / (std_m * math.sqrt(2.0 * math.pi))
    stray = 1.0 / width_m
    of_column = HIT_SHARE * ((1.0 - STRAY_SHARE) * normal + STRAY_SHARE * stray)
    silent = math.exp(-float((width_m * density).mean()))
    missed = misses * math.log((1.0 - HIT_SHARE) / silent)
    return float(np.log(of_column / density).sum() + missed)


@compiled
def _descend(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
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
    hits, misses = 0, 0
    for step in range(steps + 1):
        tolerance = 2.0 if step == 0 else 1.0
        hits, misses = _look_at(
            table, pings, echoes, is_open, left, place, tolerance, hit_pings, hit_echoes
        )
        if hits < LEAST_FITTED or step == steps:
            break
        _step(
            table, pings, echoes, place, damping, pull * (usual_radius_m - place[2]),
            hit_pings[:hits], hit_echoes,
        )  # fmt: skip
        place[2] = min(max(place[2], least_radius_m), most_radius_m)
    return hits, misses


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
    hit_pings: NDArray[np.int64],
    hit_echoes: NDArray[np.int64],
) -> tuple[int, int]:
    """Pings that heard a column, and how many should have but did not."""
    hits, misses = 0, 0
    for index in range(len(pings)):
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
