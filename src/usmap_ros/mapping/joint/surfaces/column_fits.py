"""A circle through echoes: what a round column returns, and how much likelier it is than others.

A column of radius R about c returns one echo to each ping that looks at it, from range |c - p| - R.
Hits count for it, the more the nearer they are to where they should be and the fewer other echoes
are around, and silence where one would have been loud counts against it.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.circle_descent import (
    LEAST_FITTED,
    TOLERANCE_M,
    WITHIN_STDS,
    descend,
)
from usmap_ros.mapping.joint.visibility.echoes import Echoes, count_between
from usmap_ros.mapping.ping_table import RANGE_STD, PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled, compiled_within

#: A column is heard by such a share of the pings that should hear it; its ranges scatter so much,
#: m, or as the poses do, but for the share of those that are something else's.
HIT_SHARE, RANGE_STD_M, STRAY_SHARE = 0.9, 0.006, 0.1
#: Echoes crowd around a hit within a reach, m; least radius, m, for corners and poles fit as well,
#: but are points.
CROWD_M, LEAST_RADIUS_M = 0.4, 0.1
#: How many more echoes of a ping there may be within `CROWD_M` before a column than behind it: of
#: one thing beside it, but not of the two walls of a corner.
MOST_MORE_BEFORE = 1.2
#: Steps of Gauss and Newton to the point that hits of a column are compared with.
POINT_STEPS = 5
#: The same to two points, each with the hits that it explains better; shares of the hits, from the
#: left, that one of them begins with; and what steps are damped by, over the variance of a range.
TWO_POINT_STEPS, FIRST_SHARES, TWO_POINT_DAMPING = 12, (0.3, 0.5, 0.7), 0.01
#: No surface is nearer to a robot's path than this.
CLEARANCE_M = 0.05


class PingSet(NamedTuple):
    """Pings that may have heard columns."""

    #: Pings.
    table: PingTable
    #: (pings,) integer array: their rows.
    pings: NDArray[np.int64]
    #: Theirs.
    echoes: Echoes
    #: (pings, RAYS, STEPS) uint8 array: by
    #: `usmap_ros.mapping.joint.visibility.ray_casting.cast_rays`.
    left: NDArray[np.uint8]


class LevenbergMarquardt(NamedTuple):
    """How the circle that fits best is gone to, after Gauss, Newton and Levenberg."""

    #: How many.
    steps: int
    #: (3,) array: of the middle and the radius, over the variance of a range.
    damping: FloatArray
    #: What radii are pulled to by their damping.
    usual_radius_m: float | None = None
    #: What they are held between.
    radii_m: tuple[float, float] = (0.04, 0.48)


class Circle(NamedTuple):
    """A circle that fits echoes."""

    #: Its middle and radius.
    x_m: float
    y_m: float
    radius_m: float
    #: (hits,) integer arrays: that heard it, and their echoes of it.
    pings: NDArray[np.int64]
    echoes: NDArray[np.int64]
    #: Pings that should have heard it but did not.
    misses: int
    #: Of the directions that it was heard from: least eigenvalue of the mean of u uᵀ.
    spread: float
    #: Log-likelihood ratio to echoes by chance.
    log_ratio: float
    #: Whether most is heard before it: two walls are heard before their corner.
    is_corner: bool


def fitted_circle(
    ping_set: PingSet, is_open: BoolArray, place: FloatArray, descent: LevenbergMarquardt
) -> Circle | None:
    """The circle near a place, if there is one that may stand there: no robot went through it.

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
    hits, misses = descend(
        table, pings, echoes, is_open, left, place, descent.steps, descent.damping, pull,
        usual_m or 0.0, *descent.radii_m, hit_pings, hit_echoes,
    )  # fmt: skip
    if hits < LEAST_FITTED:
        return None
    # Points, of no radius, may stand anywhere.
    is_column = descent.radii_m[1] > LEAST_RADIUS_M
    if is_column and not LEAST_RADIUS_M < place[2] < _nearest_m(table, pings, place) - CLEARANCE_M:
        return None
    hit_pings, hit_echoes = hit_pings[:hits], hit_echoes[:hits]
    told = _told(table, pings, echoes, place, hit_pings, hit_echoes, misses)
    return Circle(
        float(place[0]), float(place[1]), float(place[2]), hit_pings, hit_echoes, misses, *told
    )


@compiled
def _nearest_m(table: PingTable, pings: NDArray[np.int64], place: FloatArray) -> float:
    """How near to a place any of some pings is from."""
    nearest_m = np.inf
    for ping in pings:
        x_m, y_m = table.numbers[ping, X] - place[0], table.numbers[ping, Y] - place[1]
        nearest_m = min(nearest_m, math.sqrt(x_m * x_m + y_m * y_m))
    return nearest_m


class _Told(NamedTuple):
    """What hits tell of a circle: see `Circle`."""

    spread: float
    log_ratio: float
    is_corner: bool


@compiled
def _told(
    table: PingTable,
    pings: NDArray[np.int64],
    echoes: Echoes,
    place: FloatArray,
    hit_pings: NDArray[np.int64],
    hit_echoes: NDArray[np.int64],
    misses: int,
) -> _Told:
    """What hits tell of a circle with some middle and radius."""
    hits, cosines, sines = len(hit_pings), 0.0, 0.0
    across_m, ranges_m, stds_m = np.empty(hits), np.empty(hits), np.empty(hits)
    for hit in range(hits):
        numbers = table.numbers[pings[hit_pings[hit]]]
        x_m, y_m = place[0] - numbers[X], place[1] - numbers[Y]
        squared = x_m * x_m + y_m * y_m
        across_m[hit] = math.sqrt(squared) - place[2]
        ranges_m[hit], stds_m[hit] = echoes.range_m[hit_echoes[hit]], numbers[RANGE_STD]
        # Of twice the direction, by which Σ u uᵀ differs from that of all directions alike.
        cosines += (x_m * x_m - y_m * y_m) / squared
        sines += 2.0 * x_m * y_m / squared
    crowd = _crowd(echoes, hit_pings, across_m, ranges_m)
    return _Told(
        0.5 * (1.0 - math.hypot(cosines, sines) / hits),
        _log_ratio(ranges_m - across_m, stds_m, crowd, misses),
        _is_corner(echoes, hit_pings, across_m, stds_m),
    )


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
    return _log_ratio(off_m, numbers[:, RANGE_STD].copy(), crowd, circle.misses)


def log_ratio_of_two_points(ping_set: PingSet, circle: Circle) -> float:
    """Log-likelihood ratio, to echoes by chance, of two points that fit a circle's hits.

    Two poles that are heard from two sides, each from one, pass for what is round.
    """
    table, pings, echoes, _ = ping_set
    numbers, ranges_m = table.numbers[pings[circle.pings]], echoes.range_m[circle.echoes]
    places_m, middle_m = numbers[:, [X, Y]], np.array([circle.x_m, circle.y_m])
    stds_m = numbers[:, RANGE_STD].copy()
    offsets = middle_m - places_m
    away_m = np.hypot(*offsets.T)
    crowd = _crowd(echoes, circle.pings, away_m - circle.radius_m, ranges_m)
    towards = offsets / away_m[:, np.newaxis]
    mean = towards.mean(axis=0)
    to_the_left = towards @ np.array([-mean[1], mean[0]])
    best = -math.inf
    for share in FIRST_SHARES:
        is_second = to_the_left > np.quantile(to_the_left, share)
        if not is_second.any():
            continue
        points = [middle_m - circle.radius_m * towards[own].mean(axis=0)
                  for own in (~is_second, is_second)]  # fmt: skip
        off_m = _off_two_points(places_m, ranges_m, points, is_second)
        best = max(best, _log_ratio(off_m, stds_m, crowd, circle.misses))
    return best


def _off_two_points(
    places_m: FloatArray, ranges_m: FloatArray, points: list[FloatArray], is_second: BoolArray
) -> FloatArray:
    """How far ranges are off those to the nearer of two points that fit them, m."""
    off_m = np.zeros((2, len(ranges_m)))
    for _ in range(TWO_POINT_STEPS):
        for which, own in enumerate((~is_second, is_second)):
            offsets = points[which] - places_m[own]
            distances = np.hypot(*offsets.T)
            towards = offsets / distances[:, np.newaxis]
            matrix = towards.T @ towards + TWO_POINT_DAMPING * np.eye(2)
            points[which] = points[which] + np.linalg.solve(
                matrix, towards.T @ (ranges_m[own] - distances)
            )
            off_m[which] = ranges_m - np.hypot(*(points[which] - places_m).T)
        is_second = np.abs(off_m[1]) < np.abs(off_m[0])
    nearer: FloatArray = np.where(is_second, off_m[1], off_m[0])
    return nearer


@compiled
def _crowd(
    echoes: Echoes, pings: NDArray[np.int64], across_m: FloatArray, ranges_m: FloatArray
) -> NDArray[np.int64]:
    """How many other echoes of the same ping are within `CROWD_M` of where each should be."""
    around = count_between(echoes, pings, across_m - CROWD_M, across_m + CROWD_M)
    # By poses that are very uncertain, an echo may itself be farther off.
    return around - (np.abs(ranges_m - across_m) < CROWD_M)


@compiled_within
def _tolerance(stds_m: FloatArray) -> FloatArray:
    """How near to where it should be an echo is a column's, m, by how uncertain ranges are."""
    return np.maximum(TOLERANCE_M, WITHIN_STDS * stds_m)


@compiled_within
def _is_corner(
    echoes: Echoes, pings: NDArray[np.int64], across_m: FloatArray, stds_m: FloatArray
) -> bool:
    """Whether most is heard before: two walls are heard before their corner, and after columns."""
    near_m = _tolerance(stds_m)
    before = count_between(echoes, pings, across_m - CROWD_M, across_m - near_m)
    behind = count_between(echoes, pings, across_m + near_m, across_m + CROWD_M)
    is_corner: bool = before.mean() > behind.mean() + MOST_MORE_BEFORE
    return is_corner


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


@compiled_within
def echoes_per_m(crowd: NDArray[np.int64]) -> FloatArray:
    """How dense echoes are around one, beside which there are so many within `CROWD_M`."""
    return (crowd.astype(np.float64) + 0.5) / (2.0 * CROWD_M)


@compiled
def _log_ratio(
    off_m: FloatArray, stds_m: FloatArray, crowd: NDArray[np.int64], misses: int
) -> float:
    """Log-likelihood ratio of what was heard, with a column to with echoes of anything there.

    Parameters
    ----------
    off_m : (hits,) array
        Distance of each hit from where the column's echo should be.
    stds_m : (hits,) array
        Standard deviation of each range by the ping's pose; contiguous, or all is compiled anew.
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
    silent = math.exp(-(width_m * density).mean())
    missed = misses * math.log((1.0 - HIT_SHARE) / silent)
    ratio: float = np.log(of_column / density).sum() + missed
    return ratio
