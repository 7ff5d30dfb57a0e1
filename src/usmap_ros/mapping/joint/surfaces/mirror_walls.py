"""Walls that answer as mirrors do: where struck squarely, at the foot of the perpendicular.

A wall with unit normal n at distance ρ from the origin returns one echo to each ping whose beam
holds the perpendicular on it, from range ρ - p·n.  Echoes that no reliable cell explains vote for
(direction of n, ρ); the best stretch of feet, where hits count for the wall and loud misses
against it, is the wall.  A rough wall looks the same at its nearest point, but many echoes of it
follow: a mirror is followed by few.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.mirror_fits import Search, candidates, fit
from usmap_ros.mapping.joint.surfaces.multiple_reflections import reflected, seen_directly
from usmap_ros.mapping.joint.visibility.echoes import Echoes, count_between
from usmap_ros.mapping.joint.visibility.field import RANGE_STD, Field, X, Y
from usmap_ros.mapping.looks import Looks
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.processes.threads import in_turn

#: Amplitude reflectivities that a mirror may have.
LEAST_MIRROR, MOST_MIRROR = 0.25, 1.6
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
#: Share of the hits of all candidates that such mirrors must have: chance finds some anywhere.
LEAST_SHARE = 0.6
#: Walls of one place are mostly alike: logarithms of reflectivities that differ by less, and share
#: of all hits that the most of those have (chance: 0.1 to 0.23), and how many hits.
ALIKE, LEAST_ALIKE, LEAST_HITS_ALIKE = 0.1, 0.33, 15
#: Logarithm of reflectivity by which single echoes of a place's mirrors differ from the usual one.
BAND = 0.4
#: A wall is another one's double if it is so near to it, m, and as parallel.
DOUBLE_M, DOUBLE_COSINE = 0.2, 0.9
#: Walls are parallel or square to each other up to this sine of twice the angle; they face usual
#: directions if such a share of all that was heard of walls does.
SQUARE, USUAL_SHARE = 0.1, 0.3
#: Walls no longer than this, m, whose direction is off a usual one by less than this, rad, have
#: that: their feet are too close together to tell.
SHORT_M, UNSURE_RAD = 2.0, 0.03

#: Sum of squares of what errors of poses explain, over that of their standard deviations.
POSES_SHARE = 2.25


class Bar(NamedTuple):
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


#: Of any wall, and of one that faces as the others of the place do.
ANY, USUAL = Bar(6, 5.0, 4, 0.3, 3.0, 0.6), Bar(4, 3.5, 2, 0.2, 0.0, 1.0)


@dataclass(frozen=True)
class MirrorWall:
    """A mirror.

    Parameters
    ----------
    normal_rad, distance_m : float
        Direction of the normal, towards the wall, and distance of the wall from the origin.
    begin_m, end_m : float
        Where along the tangent (-sin, cos) its feet begin and end.
    pings, echoes : (hits,) integer arrays
        That heard it, and their echoes of it.
    following : float
        Echoes that follow within `FOLLOWING_M`, on the mean.
    log_mirror : float
        Logarithm of its amplitude reflectivity.
    deviation : float
        Median deviation of what its echoes tell of that.
    """

    normal_rad: float
    distance_m: float
    begin_m: float
    end_m: float
    pings: NDArray[np.int64]
    echoes: NDArray[np.int64]
    following: float
    log_mirror: float
    deviation: float

    def bearing_from(self, x_m: float, y_m: float) -> float:
        """Direction in which a place hears it, rad: the same one everywhere."""
        return self.normal_rad

    def line(self, field: Field) -> FloatArray:
        """The wall on a field, its cells half a cell behind its face."""
        res = field.resolution_m
        nx, ny = math.cos(self.normal_rad), math.sin(self.normal_rad)
        x0, y0 = field.first_column * res, field.first_row * res
        distance = (self.distance_m + 0.5 * res - nx * x0 - ny * y0) / res - 0.5 * (nx + ny)
        shift = (nx * y0 - ny * x0) / res + 0.5 * (nx - ny)
        return np.array([nx, ny, distance, self.begin_m / res - shift, self.end_m / res - shift])


def mirror_walls(
    looks: Looks,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_explained: BoolArray,
    is_usable: BoolArray,
) -> list[MirrorWall]:
    """Mirrors of a place that has some.

    Echoes that nothing else explains tell whether there are any, and of which reflectivity; then
    all echoes tell where.

    Parameters
    ----------
    looks : Looks
        Pings.
    pings : (pings,) integer array
        Their rows.
    echoes : Echoes
        Theirs.
    is_explained : (echoes,) bool array
        Whether reliable cells explain an echo.
    is_usable : (echoes,) bool array
        Whether a mirror may explain an echo.
    """
    usual = _usual_mirror(perpendicular_walls(looks, pings, echoes, ~is_explained))
    if usual is None:
        return []
    faintest, loudest = math.exp(usual - BAND), math.exp(usual + BAND)
    search = Search(looks, pings, echoes, is_usable, faintest, loudest)
    places_m = looks.numbers[pings][:, [X, Y]]
    walls = _directly(_without_doubles(_found(search, ANY)), places_m)
    is_left = is_usable & ~reflected(walls, looks, pings, echoes)
    for wall in walls:
        is_left[wall.echoes] = False
    more = _found(search._replace(is_open=is_left), USUAL)
    faces_usually = face_usually(more, walls)
    walls += [wall for wall, is_usual in zip(more, faces_usually, strict=True) if is_usual]
    return _squared(_directly(_without_doubles(walls), places_m), places_m, echoes)


def _usual_mirror(found: list[MirrorWall]) -> float | None:
    """Logarithm of the reflectivity of most mirrors among what was heard squarely, if any are."""
    if not found:
        return None
    hits = np.array([len(wall.echoes) for wall in found])
    is_steady = np.array([wall.deviation < STEADY for wall in found])
    are_mirrors = is_steady | np.array([wall.following < MOST_FOLLOWING for wall in found])
    # One that was heard steadily by many is a mirror, whatever stands beside it.
    are_certain = is_steady & (hits >= CERTAIN_HITS)
    if are_certain.any():
        are_mirrors, hits = are_certain, np.where(are_certain, hits, 0)
    elif hits[are_mirrors].sum() < LEAST_SHARE * hits.sum():
        return None
    logs = np.array([wall.log_mirror for wall in found])
    alike = (np.abs(logs - logs[:, np.newaxis]) < ALIKE) & are_mirrors
    most = int(np.argmax(alike @ hits))
    if alike[most] @ hits < max(LEAST_ALIKE * hits.sum(), LEAST_HITS_ALIKE):
        return None
    return float(np.average(logs[alike[most]], weights=hits[alike[most]]))


def _directly(walls: list[MirrorWall], places_m: FloatArray) -> list[MirrorWall]:
    """Walls but for those that only stand in others as in mirrors."""
    seen = seen_directly(walls, places_m)
    return [wall for wall, is_seen in zip(walls, seen.tolist(), strict=True) if is_seen]


def perpendicular_walls(
    looks: Looks, pings: NDArray[np.int64], echoes: Echoes, is_open: BoolArray
) -> list[MirrorWall]:
    """Walls that are heard at the feet of perpendiculars, whether or not from elsewhere, too.

    Parameters
    ----------
    looks, pings, echoes
        As in `mirror_walls`.
    is_open : (echoes,) bool array
        Whether an echo may be one's.
    """
    return _found(Search(looks, pings, echoes, is_open, LEAST_MIRROR, MOST_MIRROR), ANY)


def face_usually(walls: list[MirrorWall], among: list[MirrorWall]) -> BoolArray:
    """Whether each of some walls is parallel or square to many of others."""
    hits = np.array([len(wall.echoes) for wall in among], float)
    usual: BoolArray = _square(walls, among) @ hits > USUAL_SHARE * hits.sum()
    return usual


def usual_direction(normals_rad: FloatArray, weights: FloatArray) -> float:
    """Direction, rad, that the most of some walls, by their weights, are parallel or square to."""
    turns_rad = normals_rad - normals_rad[:, np.newaxis]
    is_square = np.abs(np.sin(2.0 * turns_rad)) < SQUARE
    most = int(np.argmax(is_square @ weights))
    mean = np.where(is_square[most], weights, 0.0) @ np.exp(4j * turns_rad[most])
    return float(normals_rad[most] + 0.25 * np.angle(mean))


def _square(walls: list[MirrorWall], others: list[MirrorWall]) -> BoolArray:
    """Whether walls are parallel or square to others, a row for each of the first."""
    normals, across = (np.array([wall.normal_rad for wall in some]) for some in (walls, others))
    square: BoolArray = np.abs(np.sin(2.0 * (normals[:, np.newaxis] - across))) < SQUARE
    return square


def _squared(walls: list[MirrorWall], places_m: FloatArray, echoes: Echoes) -> list[MirrorWall]:
    """Walls, the short ones turned to a usual direction that is near."""
    if not walls:
        return []
    normals_rad = np.array([wall.normal_rad for wall in walls])
    hits = np.array([len(wall.echoes) for wall in walls], float)
    direction, quarter = usual_direction(normals_rad, hits), 0.5 * math.pi
    squared = list[MirrorWall]()
    for wall in walls:
        turn = (direction - wall.normal_rad + 0.5 * quarter) % quarter - 0.5 * quarter
        is_unsure = wall.end_m - wall.begin_m < SHORT_M and abs(turn) < UNSURE_RAD
        squared.append(_turned(wall, turn, places_m, echoes) if is_unsure else wall)
    return squared


def _turned(wall: MirrorWall, turn: float, places_m: FloatArray, echoes: Echoes) -> MirrorWall:
    """The wall that faces otherwise and fits its echoes best."""
    normal_rad, heard_from_m = wall.normal_rad + turn, places_m[wall.pings]
    cosine, sine = math.cos(normal_rad), math.sin(normal_rad)
    distances_m = heard_from_m @ (cosine, sine) + echoes.range_m[wall.echoes]
    feet_m = heard_from_m @ (-sine, cosine)
    return replace(
        wall,
        normal_rad=normal_rad,
        distance_m=float(np.median(distances_m)),
        begin_m=float(feet_m.min()),
        end_m=float(feet_m.max()),
    )


def _found(search: Search, bar: Bar) -> list[MirrorWall]:
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


def _without_doubles(walls: list[MirrorWall]) -> list[MirrorWall]:
    """Walls but for those close beside a heavier one that face the same way: echoes beside it."""
    kept: list[MirrorWall] = []
    for wall in sorted(walls, key=lambda wall: -len(wall.echoes)):
        middle_m = 0.5 * (wall.begin_m + wall.end_m)
        x_m = wall.distance_m * math.cos(wall.normal_rad) - middle_m * math.sin(wall.normal_rad)
        y_m = wall.distance_m * math.sin(wall.normal_rad) + middle_m * math.cos(wall.normal_rad)
        for other in kept:
            cosine, sine = math.cos(other.normal_rad), math.sin(other.normal_rad)
            across_m, along_m = (
                x_m * cosine + y_m * sine - other.distance_m,
                y_m * cosine - x_m * sine,
            )
            if (
                abs(across_m) < DOUBLE_M
                and math.cos(wall.normal_rad - other.normal_rad) > DOUBLE_COSINE
                and other.begin_m < along_m < other.end_m
            ):
                break
        else:
            kept.append(wall)
    return kept


def _fitted(search: Search, bar: Bar, normal_rad: float, distance_m: float) -> MirrorWall | None:
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
    numbers = search.looks.numbers[search.pings[hits.ping]]
    across_m = distance_m - (
        numbers[:, X] * math.cos(normal_rad) + numbers[:, Y] * math.sin(normal_rad)
    )
    ranges_m = search.echoes.range_m[hits.echo]
    wall, point = _residuals(feet_m, across_m, ranges_m)
    if 0.5 * len(feet_m) * math.log(point / wall) < bar.over_point:
        return None
    by_poses = POSES_SHARE * float((numbers[:, RANGE_STD] ** 2).sum())
    if wall > max(bar.point_share * point, by_poses):
        return None
    begin_m, end_m = (across_m + beyond_m for beyond_m in FOLLOWING_M)
    following = count_between(search.echoes, hits.ping, begin_m, end_m).mean()
    return MirrorWall(
        normal_rad, distance_m, float(feet_m.min()), float(feet_m.max()),
        hits.ping, hits.echo, float(following), log_mirror, deviation,
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


def _misfits(residuals_m: FloatArray) -> FloatArray:
    """Sum of squares, each no more than that of 2 cm, over the last axis."""
    sums: FloatArray = np.minimum(residuals_m**2, 4e-4).sum(axis=-1)
    return sums
