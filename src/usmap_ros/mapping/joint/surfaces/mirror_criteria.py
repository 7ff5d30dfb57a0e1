"""What a line must have to be a wall that answers as mirrors do."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.mirror_fits import Feet, MirrorSearch, fit
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall
from usmap_ros.mapping.joint.visibility.echoes import Echoes, count_between
from usmap_ros.mapping.ping_table import RANGE_STD, X, Y
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.compiled import compiled, compiled_within, inlined
from usmap_ros.numerics.ordering import ascending

#: Largest median deviation of the logarithm of one's reflectivity from its median.
MOST_DEVIATION = 0.45
#: Stretches in which others are counted, before and behind an echo of a wall, m.
BEFORE_M, FOLLOWING_M = (-0.6, -0.03), (0.05, 0.6)
#: Sum of squares of what errors of poses explain, over that of their standard deviations; and of
#: what they are off from one ping of a wall to the next, for they wander slowly; whatever is
#: stated, odometry does not jump by more than a share of so much, m.
POSES_SHARE, WANDERING_SHARE, MOST_WANDERING_M = 2.25, 0.05, 0.1


class MirrorCriteria(NamedTuple):
    """What a wall must have."""

    #: Pings that heard it.
    hits: int
    #: Hits less loud misses.
    score: float
    #: A decimetre apart, that feet have.
    places: int
    #: In which they are.
    stretch_m: float
    #: By how much likelier its ranges are than by the point that explains them best: logarithm,
    #: with residuals as large as they are.
    over_point: float
    #: Its residuals over those of that point, at the most, where errors of poses explain less.
    point_share: float


#: Points along a wall that are looked for which explain what it does, and how far off its line, m.
POINTS, POINTS_OFF_M = 25, np.linspace(-0.06, 0.06, 7)
#: Residuals are counted as no larger, m; and their sum of squares as no less.
MOST_RESIDUAL_M, LEAST_MISFIT = 0.02, 1e-12
#: Of any wall, and of one that faces as the others of the place do.
ANY, USUAL = MirrorCriteria(6, 5.0, 4, 0.3, 3.0, 0.6), MirrorCriteria(4, 3.5, 2, 0.12, 0.0, 1.0)


def fitted(
    search: MirrorSearch, bar: MirrorCriteria, normal_rad: float, distance_m: float
) -> MirrorWall | None:
    """The wall near a candidate, if it is one.

    Parameters
    ----------
    search : MirrorSearch
        Whose open echoes it may explain.
    bar : MirrorCriteria
        What it must have.
    normal_rad, distance_m : float
        The candidate.
    """
    candidate = normal_rad, distance_m
    while True:
        normal_rad, distance_m, score, hits = fit(search, *candidate)
        if score < bar.score or len(hits.echo) < bar.hits:
            return None
        if tells_direction(bar, hits.along_m):
            return _judged(search, bar, normal_rad, distance_m, hits)
        # Who stands or turns in one place hears a line often there, and it may go on elsewhere.
        is_open = search.is_open.copy()
        is_open[hits.echo] = False
        search = search._replace(is_open=is_open)


def tells_direction(bar: MirrorCriteria, feet_m: FloatArray) -> bool:
    """Whether feet, in ascending order, are spread as far as those of a wall must be."""
    stretch_m, places = _spread(feet_m)
    return stretch_m >= bar.stretch_m and places >= bar.places


@compiled
def _spread(feet_m: FloatArray) -> tuple[float, int]:
    """How far apart the 5th and the 95th percentile of ascending feet are, and in how many places.

    Those are decimetres.
    """
    last, places = len(feet_m) - 1, 1
    for foot in range(1, len(feet_m)):
        places += np.rint(feet_m[foot] / 0.1) != np.rint(feet_m[foot - 1] / 0.1)
    return _at(feet_m, 0.95 * last) - _at(feet_m, 0.05 * last), places


@inlined
def _at(ascending_m: FloatArray, place: float) -> float:
    """A number between two of some, by where it is among them."""
    before = int(place)
    after = min(before + 1, len(ascending_m) - 1)
    number: float = ascending_m[before] + (place - before) * (
        ascending_m[after] - ascending_m[before]
    )
    return number


def _judged(
    search: MirrorSearch, bar: MirrorCriteria, normal_rad: float, distance_m: float, hits: Feet
) -> MirrorWall | None:
    """The wall that has some hits, if it is one."""
    told = _told(search, normal_rad, distance_m, hits)
    if told.deviation > MOST_DEVIATION:
        return None
    count, wandering = len(hits.echo), WANDERING_SHARE * told.wandering
    over_point = 0.5 * count * math.log((told.point + wandering) / (told.wall + wandering))
    if over_point < bar.over_point:
        return None
    if told.wall > max(bar.point_share * told.point, POSES_SHARE * told.poses):
        return None
    feet_m, numbers = hits.along_m, search.table.numbers[search.pings[hits.ping]]
    across_m = distance_m - (
        numbers[:, X] * math.cos(normal_rad) + numbers[:, Y] * math.sin(normal_rad)
    )
    point = _point_misfit(search.echoes, hits.ping, across_m, feet_m)
    over_point = 0.5 * count * math.log((point + wandering) / (told.wall + wandering))
    before, following = (
        float(count_between(search.echoes, hits.ping, across_m + begin_m, across_m + end_m).mean())
        for begin_m, end_m in (BEFORE_M, FOLLOWING_M)
    )
    return MirrorWall(
        normal_rad, distance_m, float(feet_m.min()), float(feet_m.max()),
        hits.ping, hits.echo, following, before, told.log_mirror, told.deviation, over_point,
    )  # fmt: skip


class _Told(NamedTuple):
    """What hits tell of a line."""

    #: Logarithm of its reflectivity, and the median deviation of what each tells from that.
    log_mirror: float
    deviation: float
    #: Sums of squares of residuals: of a wall, and of the point on it that explains ranges best.
    wall: float
    point: float
    #: Variances by poses, of all hits, and of what they may wander by.
    poses: float
    wandering: float


@compiled
def _told(search: MirrorSearch, normal_rad: float, distance_m: float, hits: Feet) -> _Told:
    """What some hits tell of a line."""
    count, cosine, sine = len(hits.echo), math.cos(normal_rad), math.sin(normal_rad)
    across_m, ranges_m, off_m = np.empty(count), np.empty(count), np.empty(count)
    wall, poses, wandering = 0.0, 0.0, 0.0
    for hit in range(count):
        numbers = search.table.numbers[search.pings[hits.ping[hit]]]
        across_m[hit] = distance_m - (numbers[X] * cosine + numbers[Y] * sine)
        ranges_m[hit] = search.echoes.range_m[hits.echo[hit]]
        wall += _misfit(ranges_m[hit] - across_m[hit])
        poses += numbers[RANGE_STD] ** 2
        wandering += min(numbers[RANGE_STD], MOST_WANDERING_M) ** 2
    point, first_m, stretch_m = np.inf, hits.along_m[0], hits.along_m[-1] - hits.along_m[0]
    for place in range(POINTS):
        along_m = first_m + stretch_m * place / (POINTS - 1)
        for hit in range(count):
            off_m[hit] = ranges_m[hit] - math.hypot(across_m[hit], hits.along_m[hit] - along_m)
        usual_m, misfit = _median(off_m), 0.0
        for hit in range(count):
            misfit += _misfit(off_m[hit] - usual_m)
        point = min(point, misfit)
    log_mirror = _median(hits.log_mirror)
    deviation = _median(np.abs(hits.log_mirror - log_mirror))
    return _Told(
        log_mirror, deviation, max(wall, LEAST_MISFIT), max(point, LEAST_MISFIT), poses, wandering
    )


@compiled_within
def _median(values: FloatArray) -> float:
    """Median of some numbers."""
    order, middle = ascending(values), len(values) // 2
    other = middle - 1 + len(values) % 2
    median: float = 0.5 * (values[order[middle]] + values[order[other]])
    return median


@inlined
def _misfit(residual_m: float) -> float:
    """Square of a residual, no more than that of `MOST_RESIDUAL_M`."""
    return min(residual_m * residual_m, MOST_RESIDUAL_M * MOST_RESIDUAL_M)


def _point_misfit(
    echoes: Echoes, ping: NDArray[np.int64], across_m: FloatArray, feet_m: FloatArray
) -> float:
    """Of the point on a wall, or so near to it, that explains pings best by any of their echoes.

    A wall has the nearest of many echoes, and so has a point to be compared with it: what comes
    back from a corner is as far away as that, and a wall through it fits some of what follows.
    """
    count = echoes.start[ping + 1] - echoes.start[ping]
    number = np.minimum(np.arange(count.max()), count[:, np.newaxis] - 1)
    ranges_m = echoes.range_m[echoes.start[ping][:, np.newaxis] + number]
    along_m, off_m = np.meshgrid(np.linspace(feet_m.min(), feet_m.max(), POINTS), POINTS_OFF_M)
    expected_m = np.hypot(across_m + off_m.reshape(-1, 1), feet_m - along_m.reshape(-1, 1))
    nearest_m = np.full(expected_m.shape, np.inf)
    for each_m in ranges_m.T:
        np.minimum(nearest_m, np.abs(each_m - expected_m), out=nearest_m)
    misfits = np.minimum(nearest_m**2, MOST_RESIDUAL_M**2).sum(axis=-1)
    return max(float(misfits.min()), LEAST_MISFIT)
