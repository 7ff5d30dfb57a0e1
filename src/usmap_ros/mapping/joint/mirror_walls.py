"""Walls that answer as mirrors do: where struck squarely, at the foot of the perpendicular.

A wall with unit normal n at distance ρ from the origin returns one echo to each ping whose beam
holds the perpendicular on it, from range ρ - p·n.  Echoes that no reliable cell explains vote for
(direction of n, ρ); the best stretch of feet, where hits count for the wall and loud misses
against it, is the wall.  A rough wall looks the same at its nearest point, but many echoes of it
follow: a mirror is followed by few.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.field import (
    BIN_M,
    GREATEST_RANGE,
    HALF_ANGLE,
    HEADING,
    LEAST_RANGE,
    Field,
    X,
    Y,
)
from usmap_ros.mapping.looks import Looks
from usmap_ros.mapping.ping_bins import GAIN_STEPS
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled

#: Directions of normals that are voted for, and width of a step of ρ, m.
DIRECTIONS, STEP_M = 180, 0.025
#: Candidates that are looked at, and mirrors that are found, at the most.
MOST_CANDIDATES, MOST_TRIES, MOST_WALLS = 6000, 600, 60
#: Share of the half angle within which the foot must be, for votes and for looks.
VOTING_SHARE, LOOKING_SHARE = 0.9, 0.93
#: An echo is a wall's if it is so near to where it should be: first, and after refinement.
TOLERANCES_M = (0.04, 0.03, 0.03)
#: Amplitude reflectivities that a mirror may have.
LEAST_MIRROR, MOST_MIRROR = 0.25, 1.6
#: A silent ping counts as a miss if the faintest mirror would have been so many times as loud as
#: what would have been reported.
LOUD = 1.3
#: Widest gap between feet, m; least score, hits, and stretch, m; largest median deviation of
#: the logarithm of reflectivity from its median.
GAP_M, LEAST_SCORE, LEAST_HITS, LEAST_STRETCH_M, MOST_DEVIATION = 0.6, 5.0, 6, 0.3, 0.45
#: A point would explain the ranges nearly as well: residuals of the wall over those of the best
#: point, from which on it is not a wall; and places, a decimetre apart, that feet must have.
POINT_SHARE, LEAST_PLACES = 0.6, 4
#: Stretch behind an echo in which others of a rough wall would follow, m, and how many on the
#: mean a mirror may have there.
FOLLOWING_M, MOST_FOLLOWING = (0.05, 0.6), 3.2
#: Share of the hits of all candidates that such mirrors must have: chance finds some anywhere.
LEAST_SHARE = 0.6
#: Walls of one place are mostly alike: logarithms of reflectivities that differ by less, and share
#: of all hits that the most of those have (chance: 0.1 to 0.23), and how many hits.
ALIKE, LEAST_ALIKE, LEAST_HITS_ALIKE = 0.1, 0.33, 15
#: Refinement of a direction at the most, rad.
MOST_TURN = 0.05


class Echoes(NamedTuple):
    """Echoes of all pings.

    Parameters
    ----------
    start : (pings + 1,) int64 array
        First of each ping, and the end.
    range_m, amplitude : (echoes,) float64 arrays
        Of each.
    """

    start: NDArray[np.int64]
    range_m: FloatArray
    amplitude: FloatArray


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
    """

    normal_rad: float
    distance_m: float
    begin_m: float
    end_m: float
    pings: NDArray[np.int64]
    echoes: NDArray[np.int64]
    following: float
    log_mirror: float

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
    looks: Looks, pings: NDArray[np.int64], echoes: Echoes, is_explained: BoolArray
) -> list[MirrorWall]:
    """Mirrors that explain echoes which nothing else does.

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
    """
    is_open = ~is_explained
    candidates = _candidates(looks, pings, echoes, is_open)
    found: list[MirrorWall] = []
    for normal_rad, distance_m in candidates:
        if len(found) == MOST_WALLS:
            break
        wall = _fitted(looks, pings, echoes, is_open, normal_rad, distance_m)
        if wall is not None:
            found.append(wall)
            is_open[wall.echoes] = False
    hits = np.array([len(wall.echoes) for wall in found])
    are_mirrors = np.array([wall.following < MOST_FOLLOWING for wall in found], bool)
    if not found or hits[are_mirrors].sum() < LEAST_SHARE * hits.sum():
        return []
    logs = np.array([wall.log_mirror for wall in found])
    alike = (np.abs(logs - logs[:, np.newaxis]) < ALIKE) & are_mirrors
    if (alike @ hits).max() < max(LEAST_ALIKE * hits.sum(), LEAST_HITS_ALIKE):
        return []
    return [wall for wall, is_mirror in zip(found, are_mirrors, strict=True) if is_mirror]


def _candidates(
    looks: Looks, pings: NDArray[np.int64], echoes: Echoes, is_open: BoolArray
) -> list[tuple[float, float]]:
    """Normals and distances of lines with most votes, the best first, none twice."""
    numbers = looks.numbers[pings]
    reach_m = float(1.5 * np.abs(numbers[:, :2]).max() + numbers[:, GREATEST_RANGE].max() + 1.0)
    votes = np.zeros((DIRECTIONS, int(2.0 * reach_m / STEP_M)), np.int32)
    _vote(numbers, echoes, is_open, reach_m, votes)
    votes[:, 1:] += votes[:, :-1].copy()
    flat = votes.ravel()
    order = np.argsort(-flat, kind="stable")[:MOST_CANDIDATES]
    kept: list[tuple[int, int]] = []
    is_near = np.zeros(votes.shape, bool)
    for place in order[flat[order] >= LEAST_HITS]:
        direction, step = divmod(int(place), votes.shape[1])
        if not is_near[direction, step]:
            kept.append((direction, step))
            around = np.arange(direction - 1, direction + 2) % DIRECTIONS
            is_near[around, max(0, step - 2) : step + 3] = True
        if len(kept) == MOST_TRIES:
            break
    return [(f * 2.0 * math.pi / DIRECTIONS, k * STEP_M - reach_m) for f, k in kept]


@compiled
def _vote(
    numbers: FloatArray,
    echoes: Echoes,
    is_open: BoolArray,
    reach_m: float,
    votes: NDArray[np.int32],
) -> None:
    """Count, for each direction and distance, the pings with an echo from there."""
    last = np.full(votes.shape, -1, np.int32)
    for ping in range(len(numbers)):
        for echo in range(echoes.start[ping], echoes.start[ping + 1]):
            if not is_open[echo]:
                continue
            for f in range(DIRECTIONS):
                normal = f * 2.0 * math.pi / DIRECTIONS
                off = normal - numbers[ping, HEADING]
                off -= 2.0 * math.pi * math.floor((off + math.pi) / (2.0 * math.pi))
                if abs(off) > VOTING_SHARE * numbers[ping, HALF_ANGLE]:
                    continue
                foot = numbers[ping, X] * math.cos(normal) + numbers[ping, Y] * math.sin(normal)
                k = int((foot + echoes.range_m[echo] + reach_m) / STEP_M)
                if 0 <= k < votes.shape[1] and last[f, k] != ping:
                    last[f, k] = ping
                    votes[f, k] += 1


def _fitted(
    looks: Looks,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    normal_rad: float,
    distance_m: float,
) -> MirrorWall | None:
    """The wall near a candidate, if it is one."""
    hit_pings, hit_echoes = (np.empty(len(pings), np.int64) for _ in range(2))
    feet_m = np.empty(len(pings))
    score, hits, normal_rad, distance_m, log_mirror, deviation = _fit(
        looks, pings, echoes, is_open, normal_rad, distance_m, hit_pings, hit_echoes, feet_m
    )
    if score < LEAST_SCORE or hits < LEAST_HITS or deviation > MOST_DEVIATION:
        return None
    own, heard, feet_m = hit_pings[:hits], hit_echoes[:hits], feet_m[:hits]
    low_m, high_m = np.percentile(feet_m, [5, 95])
    if high_m - low_m < LEAST_STRETCH_M or len(np.unique(np.round(feet_m / 0.1))) < LEAST_PLACES:
        return None
    numbers = looks.numbers[pings[own]]
    across_m = distance_m - (
        numbers[:, X] * math.cos(normal_rad) + numbers[:, Y] * math.sin(normal_rad)
    )
    ranges_m = echoes.range_m[heard]
    points_m = np.linspace(feet_m.min(), feet_m.max(), 25)[:, np.newaxis]
    off_points_m = ranges_m - np.hypot(across_m, feet_m - points_m)
    off_points_m -= np.median(off_points_m, axis=1, keepdims=True)
    if _misfits(ranges_m - across_m) > POINT_SHARE * _misfits(off_points_m).min():
        return None
    begin_m, end_m = (across_m + beyond_m for beyond_m in FOLLOWING_M)
    following = count_between(echoes, own, begin_m, end_m).mean()
    return MirrorWall(
        normal_rad, distance_m, float(feet_m.min()), float(feet_m.max()),
        own.copy(), heard.copy(), float(following), float(log_mirror),
    )  # fmt: skip


def _misfits(residuals_m: FloatArray) -> FloatArray:
    """Sum of squares, each no more than that of 2 cm, over the last axis."""
    sums: FloatArray = np.minimum(residuals_m**2, 4e-4).sum(axis=-1)
    return sums


def count_between(
    echoes: Echoes, pings: NDArray[np.int64], near_m: FloatArray, far_m: FloatArray
) -> NDArray[np.int64]:
    """Echoes of some pings, each from a stretch of ranges."""
    first, count = echoes.start[pings], np.diff(echoes.start)[pings]
    of = np.repeat(np.arange(len(pings)), count)
    place = np.arange(len(of)) + np.repeat(first - np.cumsum(count) + count, count)
    ranges_m = echoes.range_m[place]
    inside = (ranges_m > near_m[of]) & (ranges_m < far_m[of])
    return np.bincount(of[inside], minlength=len(pings))


@compiled
def _fit(  # noqa: C901, PLR0912, PLR0913, PLR0915, PLR0917 - a kernel is one loop
    looks: Looks,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    normal_rad: float,
    distance_m: float,
    hit_pings: NDArray[np.int64],
    hit_echoes: NDArray[np.int64],
    feet_m: FloatArray,
) -> tuple[float, int, float, float, float, float]:
    """Refine a candidate twice by the hits of its best stretch.

    Returns
    -------
    score : float
        Hits less loud misses of the best stretch.
    hits : int
        How many of `hit_pings`, `hit_echoes` and `feet_m` are set.
    normal_rad, distance_m : float
        Refined.
    log_mirror, deviation : float
        Logarithm of the reflectivity: its median, and the median deviation from that.
    """
    count = len(pings)
    along, score_of = np.empty(count), np.empty(count)
    echo_of, ping_of = np.empty(count, np.int64), np.empty(count, np.int64)
    log_mirror, chosen = np.empty(count), np.empty(count)
    best, hits = 0.0, 0
    for turn in range(len(TOLERANCES_M)):
        cosine, sine, seen = math.cos(normal_rad), math.sin(normal_rad), 0
        for index in range(count):
            numbers = looks.numbers[pings[index]]
            across = distance_m - (numbers[X] * cosine + numbers[Y] * sine)
            least, greatest = numbers[LEAST_RANGE] + 0.02, numbers[GREATEST_RANGE] - 0.05
            off = normal_rad - numbers[HEADING]
            off -= 2.0 * math.pi * math.floor((off + math.pi) / (2.0 * math.pi))
            half = numbers[HALF_ANGLE]
            if across <= least or across >= greatest or abs(off) >= LOOKING_SHARE * half:
                continue
            entry = int((1.0 - math.cos(off)) / (1.0 - math.cos(half)) * GAIN_STEPS)
            gain = math.sqrt(looks.power_gain[pings[index], min(max(entry, 0), GAIN_STEPS)])
            gain = max(gain, 1e-3)
            nearest, nearest_echo, mirror_of = TOLERANCES_M[turn], -1, 1.0
            for echo in range(echoes.start[index], echoes.start[index + 1]):
                away = abs(echoes.range_m[echo] - across)
                if not is_open[echo] or away >= nearest:
                    continue
                mirror = 2.0 * echoes.amplitude[echo] * echoes.range_m[echo] / gain
                if LEAST_MIRROR < mirror < MOST_MIRROR:
                    nearest, nearest_echo, mirror_of = away, echo, mirror
            b = min(
                int((across - numbers[LEAST_RANGE]) / numbers[BIN_M]), looks.bins[pings[index]] - 1
            )
            limit = math.sqrt(looks.limit[pings[index], b])
            is_loud = LEAST_MIRROR * gain / (2.0 * across) > LOUD * limit
            if nearest_echo >= 0 or is_loud:
                along[seen], echo_of[seen], ping_of[seen] = (
                    numbers[Y] * cosine - numbers[X] * sine, nearest_echo, index,
                )  # fmt: skip
                score_of[seen] = 1.0 if nearest_echo >= 0 else -1.0
                log_mirror[seen] = math.log(mirror_of)
                seen += 1
        order = np.argsort(along[:seen])
        best, first, last, running, begin = 0.0, 0, -1, 0.0, 0
        for k in range(seen):
            if running <= 0.0 or along[order[k]] - along[order[k - 1]] > GAP_M:
                running, begin = 0.0, k
            running += score_of[order[k]]
            if running > best:
                best, first, last = running, begin, k
        hits = 0
        for k in range(first, last + 1):
            at = order[k]
            if echo_of[at] >= 0:
                hit_pings[hits], hit_echoes[hits], feet_m[hits] = (
                    ping_of[at],
                    echo_of[at],
                    along[at],
                )
                chosen[hits] = log_mirror[at]
                hits += 1
        if hits < 3:
            return 0.0, 0, normal_rad, distance_m, 0.0, 9.0
        if turn == len(TOLERANCES_M) - 1:
            break
        t_, tt_, r_, tr_ = 0.0, 0.0, 0.0, 0.0
        for k in range(hits):
            numbers = looks.numbers[pings[hit_pings[k]]]
            across = distance_m - (numbers[X] * cosine + numbers[Y] * sine)
            residual = echoes.range_m[hit_echoes[k]] - across
            t_ -= feet_m[k]
            tt_ += feet_m[k] ** 2
            r_ += residual
            tr_ -= feet_m[k] * residual
        variance = tt_ - t_ * t_ / hits
        slope = (tr_ - t_ * r_ / hits) / variance if variance > 1e-4 else 0.0
        slope = min(max(slope, -MOST_TURN), MOST_TURN)
        distance_m += (r_ - slope * t_) / hits
        normal_rad += slope
    usual = np.median(chosen[:hits])
    deviation = np.median(np.abs(chosen[:hits] - usual))
    return best, hits, normal_rad, distance_m, usual, deviation
