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


#: How far off the line of a wall points are looked for that explain what it does, m.
POINTS_OFF_M = np.linspace(-0.06, 0.06, 7)
#: Of any wall, and of one that faces as the others of the place do.
ANY, USUAL = MirrorCriteria(6, 5.0, 4, 0.3, 3.0, 0.6), MirrorCriteria(4, 3.5, 2, 0.2, 0.0, 1.0)


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
        if _tells_direction(bar, hits.along_m):
            return _judged(search, bar, normal_rad, distance_m, hits)
        # Who stands or turns in one place hears a line often there, and it may go on elsewhere.
        is_open = search.is_open.copy()
        is_open[hits.echo] = False
        search = search._replace(is_open=is_open)


def _tells_direction(bar: MirrorCriteria, feet_m: FloatArray) -> bool:
    """Whether feet are spread as far as those of a wall must be."""
    low_m, high_m = np.percentile(feet_m, [5, 95])
    places = len(np.unique(np.round(feet_m / 0.1)))
    return bool(high_m - low_m >= bar.stretch_m and places >= bar.places)


def _judged(
    search: MirrorSearch, bar: MirrorCriteria, normal_rad: float, distance_m: float, hits: Feet
) -> MirrorWall | None:
    """The wall that has some hits, if it is one."""
    log_mirror = float(np.median(hits.log_mirror))
    deviation = float(np.median(np.abs(hits.log_mirror - log_mirror)))
    if deviation > MOST_DEVIATION:
        return None
    feet_m = hits.along_m
    numbers = search.table.numbers[search.pings[hits.ping]]
    across_m = distance_m - (
        numbers[:, X] * math.cos(normal_rad) + numbers[:, Y] * math.sin(normal_rad)
    )
    ranges_m = search.echoes.range_m[hits.echo]
    wall, point = _residuals(feet_m, across_m, ranges_m)
    stds_m = numbers[:, RANGE_STD]
    by_poses = float((stds_m**2).sum())
    wandering = WANDERING_SHARE * float((np.minimum(stds_m, MOST_WANDERING_M) ** 2).sum())
    if 0.5 * len(feet_m) * math.log((point + wandering) / (wall + wandering)) < bar.over_point:
        return None
    if wall > max(bar.point_share * point, POSES_SHARE * by_poses):
        return None
    point = _point_misfit(search.echoes, hits.ping, across_m, feet_m)
    over_point = 0.5 * len(feet_m) * math.log((point + wandering) / (wall + wandering))
    before, following = (
        float(count_between(search.echoes, hits.ping, across_m + begin_m, across_m + end_m).mean())
        for begin_m, end_m in (BEFORE_M, FOLLOWING_M)
    )
    return MirrorWall(
        normal_rad, distance_m, float(feet_m.min()), float(feet_m.max()),
        hits.ping, hits.echo, following, before, log_mirror, deviation, over_point,
    )  # fmt: skip


def _residuals(
    feet_m: FloatArray, across_m: FloatArray, ranges_m: FloatArray
) -> tuple[float, float]:
    """Of a wall, and of the point on it that explains its ranges best."""
    points_m = np.linspace(feet_m.min(), feet_m.max(), 25)[:, np.newaxis]
    off_points_m = ranges_m - np.hypot(across_m, feet_m - points_m)
    off_points_m -= np.median(off_points_m, axis=1, keepdims=True)
    wall, point = _misfits(ranges_m - across_m), _misfits(off_points_m).min()
    return max(float(wall), 1e-12), max(float(point), 1e-12)


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
    along_m, off_m = np.meshgrid(np.linspace(feet_m.min(), feet_m.max(), 25), POINTS_OFF_M)
    expected_m = np.hypot(across_m + off_m.reshape(-1, 1), feet_m - along_m.reshape(-1, 1))
    nearest_m = np.full(expected_m.shape, np.inf)
    for each_m in ranges_m.T:
        np.minimum(nearest_m, np.abs(each_m - expected_m), out=nearest_m)
    return max(float(_misfits(nearest_m).min()), 1e-12)


def _misfits(residuals_m: FloatArray) -> FloatArray:
    """Sum of squares, each no more than that of 2 cm, over the last axis."""
    sums: FloatArray = np.minimum(residuals_m**2, 4e-4).sum(axis=-1)
    return sums
