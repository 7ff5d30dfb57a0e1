"""Walls that answer as mirrors do: where struck squarely, at the foot of the perpendicular.

A wall with unit normal n at distance ρ from the origin returns one echo to each ping whose beam
holds the perpendicular on it, from range ρ - p·n.  Echoes that no reliable cell explains vote for
(direction of n, ρ); the best stretch of feet, where hits count for the wall and loud misses
against it, is the wall.  A rough wall looks the same at its nearest point, but many echoes of it
follow: a mirror is followed by few.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.mirror_fits import MirrorSearch, candidates, fit
from usmap_ros.mapping.joint.surfaces.mirrors import (
    MirrorWall,
    are_square,
    face_usually,
    squared,
    without_doubles,
)
from usmap_ros.mapping.joint.surfaces.multiple_reflections import images, reflected, seen_directly
from usmap_ros.mapping.joint.visibility.echoes import Echoes, count_between, mirror_levels
from usmap_ros.mapping.ping_table import ABSORPTION, RANGE_STD, PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.processes.threads import in_turn

#: Amplitude reflectivities that a mirror may have, over what the loudest echo of one ping in ten
#: means, for most pings hear nothing squarely, but a floor; and where ranges alone are known.
LEAST_MIRROR, MOST_MIRROR, LOUD_PINGS, OF_RANGES = 0.3, 2.0, 0.1, (0.25, 1.6)
#: Mirrors that are found at the most.
MOST_WALLS = 60
#: Largest median deviation of the logarithm of one's reflectivity from its median.
MOST_DEVIATION = 0.45
#: Stretch behind an echo in which others of a rough wall would follow, m, and how many on the
#: mean a mirror may have there.
FOLLOWING_M, MOST_FOLLOWING = (0.05, 0.6), 3.2
#: One whose loudness varies less than this, as a median deviation of its logarithm, is a mirror
#: whatever follows, for a wall that mirrors most may scatter the rest: sums of what many places of
#: a rough wall return vary by 0.25 as a rule, and by less than this along few lines only.
STEADY = 0.07
#: One that so many heard steadily is a mirror whatever stands beside it: chance lines up 16 such
#: echoes of rough walls.
CERTAIN_HITS = 35
#: Some that are as loud as each other, parallel or square, and vary by less than this, are mirrors
#: whatever follows, if they are so many and have such a share of all hits: among rough walls no two
#: are so, and one has 0.15 of the hits; two may be what is left beside cells that explain the rest.
NEARLY_STEADY, LEAST_SQUARE, SQUARE_SHARE = 0.16, 3, 0.3
#: Share of the hits of all candidates that such mirrors must have: chance finds some anywhere.
LEAST_SHARE = 0.6
#: Walls of one place are mostly alike: logarithms of reflectivities that differ by less, and share
#: of all hits that the most of those have (chance: 0.1 to 0.23), and how many hits.
ALIKE, LEAST_ALIKE, LEAST_HITS_ALIKE = 0.1, 0.33, 15
#: Logarithm of reflectivity by which single echoes of a place's mirrors differ from the usual one.
BAND = 0.4
#: Sum of squares of what errors of poses explain, over that of their standard deviations; and of
#: what they are off from one ping of a wall to the next, for they wander slowly; whatever is
#: stated, odometry does not jump by more than a share of so much, m.
POSES_SHARE, WANDERING_SHARE, MOST_WANDERING_M = 2.25, 0.05, 0.1


class MirrorCriteria(NamedTuple):
    """What a wall must have.

    Parameters
    ----------
    hits : int
        Pings that heard it.
    score : float
        Hits less loud misses.
    places : int
        A decimetre apart, that feet have.
    stretch_m : float
        In which they are.
    over_point : float
        By how much likelier its ranges are than by the point that explains them best: logarithm,
        with residuals as large as they are.
    point_share : float
        Its residuals over those of that point, at the most, where errors of poses explain less.
    """

    hits: int
    score: float
    places: int
    stretch_m: float
    over_point: float
    point_share: float


#: How far off the line of a wall points are looked for that explain what it does, m.
POINTS_OFF_M = np.linspace(-0.06, 0.06, 7)
#: Of any wall, and of one that faces as the others of the place do.
ANY, USUAL = MirrorCriteria(6, 5.0, 4, 0.3, 3.0, 0.6), MirrorCriteria(4, 3.5, 2, 0.2, 0.0, 1.0)


def mirror_walls(
    table: PingTable,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_explained: BoolArray,
    is_usable: BoolArray,
    first_only: BoolArray,
) -> list[MirrorWall]:
    """Mirrors of a place that has some.

    Echoes that nothing else explains tell whether there are any, and of which reflectivity; then
    all echoes tell where.

    Parameters
    ----------
    table : PingTable
        Pings.
    pings : (pings,) integer array
        Their rows.
    echoes : Echoes
        Theirs.
    is_explained : (echoes,) bool array
        Whether reliable cells explain an echo.
    is_usable : (echoes,) bool array
        Whether a mirror may explain an echo.
    first_only : (pings,) bool array
        Pings of sensors that report the first thing only.
    """
    among = perpendicular_walls(table, pings, echoes, ~is_explained, first_only)
    places_m = table.numbers[pings][:, [X, Y]]
    usual = _usual_mirror(among, places_m)
    if usual is None:
        return []
    faintest, loudest = math.exp(usual - BAND), math.exp(usual + BAND)
    search = MirrorSearch(table, pings, echoes, is_usable, faintest, loudest)
    walls = _likelier_than_points(seen_directly(without_doubles(_found(search, ANY)), places_m))
    is_left = is_usable & ~reflected(walls, table, pings, echoes)
    for wall in walls:
        is_left[wall.echoes] = False
    more = _found(search._replace(is_open=is_left), USUAL)
    faces_usually = face_usually(more, walls)
    walls += [wall for wall, is_usual in zip(more, faces_usually, strict=True) if is_usual]
    return squared(seen_directly(without_doubles(walls), places_m), places_m, echoes)


def _likelier_than_points(walls: list[MirrorWall]) -> list[MirrorWall]:
    """Walls but for those that points explain as well, unless they face as many do."""
    pairs = zip(walls, face_usually(walls, walls), strict=True)
    return [wall for wall, is_usual in pairs if is_usual or wall.over_point > 0.0]


def _usual_mirror(found: list[MirrorWall], places_m: FloatArray) -> float | None:
    """Logarithm of the reflectivity of most mirrors among what was heard squarely, if any are.

    Nothing that scatters is added to what comes over several mirrors: that is the steadier, and
    fainter, and proves those in which it stands.  What scatters beside a mirror is its double.
    """
    found = without_doubles(found)
    if not found:
        return None
    hits = np.array([len(wall.echoes) for wall in found])
    logs = np.array([wall.log_mirror for wall in found])
    are_alike = np.abs(logs - logs[:, np.newaxis]) < ALIKE
    is_steady = np.array([wall.deviation < STEADY for wall in found])
    are_mirrors = is_steady | np.array([wall.following < MOST_FOLLOWING for wall in found])
    # One that was heard steadily by many is a mirror, whatever stands beside it.
    are_certain, is_image = is_steady & (hits >= CERTAIN_HITS), images(found, places_m)
    are_direct = ~is_image.any(axis=1)
    are_certain = is_image[are_certain].any(axis=0) | (are_certain & are_direct)
    if are_certain.any():
        are_mirrors, hits = are_certain, np.where(are_certain, hits, 0)
    elif hits[are_mirrors].sum() < LEAST_SHARE * hits.sum():
        is_nearly = are_direct & np.array([wall.deviation < NEARLY_STEADY for wall in found])
        are_mirrors = _most_square(found, are_alike & is_nearly & is_nearly[:, np.newaxis])
        if hits[are_mirrors].sum() < SQUARE_SHARE * hits[are_direct].sum():
            return None
    alike = are_alike & are_mirrors
    most = int(np.argmax(alike @ hits))
    if alike[most] @ hits < max(LEAST_ALIKE * hits.sum(), LEAST_HITS_ALIKE):
        return None
    return float(np.average(logs[alike[most]], weights=hits[alike[most]]))


def _most_square(found: list[MirrorWall], are_alike: BoolArray) -> BoolArray:
    """Of walls that are alike in pairs, the most that are parallel or square; none if few are."""
    hits = np.array([len(wall.echoes) for wall in found])
    groups = are_alike & are_square(found, found)
    groups &= (groups.sum(axis=1) >= LEAST_SQUARE)[:, np.newaxis]
    most: BoolArray = groups[int(np.argmax(groups @ hits))]
    return most


def perpendicular_walls(
    table: PingTable,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    first_only: BoolArray,
) -> list[MirrorWall]:
    """Walls that are heard at the feet of perpendiculars, whether or not from elsewhere, too.

    Parameters
    ----------
    table, pings, echoes, first_only
        As in `mirror_walls`.
    is_open : (echoes,) bool array
        Whether an echo may be one's.
    """
    search = MirrorSearch(
        table, pings, echoes, is_open, *_loudness(table, pings, echoes, is_open, first_only)
    )
    return _found(search, ANY)


def _loudness(
    table: PingTable,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    first_only: BoolArray,
) -> tuple[float, float]:
    """Amplitude reflectivities that mirrors may have, by what pings' loudest open echoes mean."""
    ping = np.repeat(np.arange(len(pings)), np.diff(echoes.start))
    is_open = is_open & ~first_only[ping]
    level = mirror_levels(echoes, table.numbers[pings[ping], ABSORPTION])
    loudest = np.zeros(len(pings))
    np.maximum.at(loudest, ping[is_open], level[is_open])
    if not loudest.any():
        return OF_RANGES
    loud = float(np.quantile(loudest[loudest > 0.0], 1.0 - LOUD_PINGS))
    return LEAST_MIRROR * loud, MOST_MIRROR * loud


def _found(search: MirrorSearch, bar: MirrorCriteria) -> list[MirrorWall]:
    """Mirrors that explain echoes."""
    search = search._replace(is_open=search.is_open.copy())
    found: list[MirrorWall] = []

    def take(candidate: tuple[float, float], wall: MirrorWall | None) -> bool:
        is_found = wall is not None and len(found) < MOST_WALLS
        while wall is not None and len(found) < MOST_WALLS:
            found.append(wall)
            search.is_open[wall.echoes] = False
            # Farther along the same line there may be more of it.
            wall = _fitted(search, bar, wall.normal_rad, wall.distance_m)
        return is_found

    in_turn(lambda line: _fitted(search, bar, *line), candidates(search, bar.hits), take)
    return found


def _fitted(
    search: MirrorSearch, bar: MirrorCriteria, normal_rad: float, distance_m: float
) -> MirrorWall | None:
    """The wall near a candidate, if it is one."""
    normal_rad, distance_m, score, hits = fit(search, normal_rad, distance_m)
    if score < bar.score or len(hits.echo) < bar.hits:
        return None
    log_mirror = float(np.median(hits.log_mirror))
    deviation = float(np.median(np.abs(hits.log_mirror - log_mirror)))
    if deviation > MOST_DEVIATION:
        return None
    feet_m = hits.along_m
    low_m, high_m = np.percentile(feet_m, [5, 95])
    if high_m - low_m < bar.stretch_m or len(np.unique(np.round(feet_m / 0.1))) < bar.places:
        return None
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
    begin_m, end_m = (across_m + beyond_m for beyond_m in FOLLOWING_M)
    following = count_between(search.echoes, hits.ping, begin_m, end_m).mean()
    return MirrorWall(
        normal_rad, distance_m, float(feet_m.min()), float(feet_m.max()),
        hits.ping, hits.echo, float(following), log_mirror, deviation, over_point,
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
