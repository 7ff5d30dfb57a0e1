"""Finds points and walls that a robot's echoes show: compiled.

An echo is from a point if points of several pings' arcs meet there, and from a wall if several arcs
have a tangent in common: either is found from two echoes, and tried on all others (RANSAC, Fischler
& Bolles 1981, with all pairs).  Those that explain most are taken first.
"""

import math

import numpy as np

from usmap_ros.mapping.robot_check.landmarks import (
    COLUMNS,
    FAR_M,
    GAIN,
    KIND,
    LEAST_ECHOES,
    POINT,
    WALL,
    A,
    B,
    LandmarkMatches,
    fit,
    judge,
    room_for,
    take,
    votes,
)
from usmap_ros.mapping.robot_check.sightings import Sightings
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled, compiled_within, inlined

#: Landmarks at the most, pairs of echoes that are tried for one, and landmarks that two echoes may
#: have in common.
MOST, MOST_PAIRS, OF_A_PAIR = 20, 2000, 4
#: How far apart, m, pings must be that show a point, or a wall.
POINT_BASE_M, WALL_BASE_M = 0.15, 0.25
#: What a landmark's unknowns cost of log-likelihood, and candidates that are fitted for one.
COST, FITTED = 9.0, 6
#: Candidates of which the best is kept in mind.
BLOCK = 64


@compiled_within
def pairs(heard: Sightings, wanted: BoolArray, its: LandmarkMatches) -> FloatArray:
    """Landmarks that two echoes have in common, (landmarks, B + 1)."""
    found, out = 0, np.zeros((MOST_PAIRS, B + 1))
    for one in range(len(wanted)):
        ping = heard.ping[one]
        for other in range(ping + 1 if wanted[one] else len(heard.x_m), len(heard.x_m)):
            to_x, to_y = heard.x_m[other] - heard.x_m[ping], heard.y_m[other] - heard.y_m[ping]
            base_m = math.hypot(to_x, to_y)
            if base_m < POINT_BASE_M:
                continue
            for two in range(heard.first[other], heard.first[other + 1]):
                if found + OF_A_PAIR > len(out):
                    out = np.concatenate((out, np.zeros_like(out)))
                if wanted[two]:
                    found = add_common(heard, one, two, (to_x, to_y, base_m), its, out, found)
    return out[:found]


@inlined
def add_common(
    heard: Sightings,
    one: int,
    two: int,
    way: tuple[float, float, float],
    its: LandmarkMatches,
    out: FloatArray,
    found: int,
) -> int:
    """Add landmarks that two echoes have in common to so many; how many there are then.

    `way` leads from the ping of one to that of the other: east, north, and its length, m.
    """
    ping, other, near_m, far_m = (
        heard.ping[one],
        heard.ping[two],
        heard.range_m[one],
        heard.range_m[two],
    )
    to_x, to_y, base_m = way
    for kind in (POINT, WALL):
        cosine = cosine_between(base_m, near_m, far_m, kind)
        if abs(cosine) >= 1.0:
            continue
        sine = math.sqrt(1.0 - cosine * cosine)
        for side in (-sine, sine):
            by_x, by_y = (
                (to_x * cosine - to_y * side) / base_m,
                (to_y * cosine + to_x * side) / base_m,
            )
            there_x, there_y = by_x, by_y
            if kind == POINT:
                there_x, there_y = (by_x * near_m - to_x) / far_m, (by_y * near_m - to_y) / far_m
            if is_heard(its, ping, by_x, by_y) and is_heard(its, other, there_x, there_y):
                place(out[found], kind, heard, ping, near_m, by_x, by_y)
                found += 1
    return found


@inlined
def is_heard(its: LandmarkMatches, ping: int, x: float, y: float) -> bool:
    """Whether a direction is within a ping's beam."""
    heard: bool = x * its.ahead_x[ping] + y * its.ahead_y[ping] >= its.edge[ping]
    return heard


@compiled_within
def place(
    mark: FloatArray, kind: float, heard: Sightings, ping: int, far_m: float, x: float, y: float
) -> None:
    """Set a landmark to where a ping would have it, so far away in some direction."""
    x_m, y_m = heard.x_m[ping] + far_m * x, heard.y_m[ping] + far_m * y
    mark[KIND], mark[A], mark[B] = kind, x_m, y_m
    if kind == WALL:
        mark[A], mark[B] = math.atan2(y, x), x * x_m + y * y_m


@compiled_within
def cosine_between(base_m: float, near_m: float, far_m: float, kind: float) -> float:
    """Of the angle from one ping towards another to a landmark of an echo of each, if there is.

    Otherwise it is no cosine.
    """
    if kind == POINT:
        squares = near_m * near_m + base_m * base_m - far_m * far_m
        return squares / (2.0 * near_m * base_m)
    return (near_m - far_m) / base_m if base_m >= WALL_BASE_M else FAR_M


@compiled_within
def set_top(said: FloatArray, block: int, tops: FloatArray) -> None:
    """Keep the greatest value of a block of many."""
    tops[block] = said[block * BLOCK : (block + 1) * BLOCK].max()


@compiled_within
def top_of(said: FloatArray, tops: FloatArray) -> int:
    """Which of many is the greatest, the first of several, by the greatest of each block."""
    begin = int(tops.argmax()) * BLOCK
    return begin + int(said[begin : begin + BLOCK].argmax())


@inlined
def put(values: FloatArray, where: FloatArray) -> None:
    """Copy values one by one: to assign a slice, Numba compiles texts on shapes that do not fit."""
    for column in range(len(values)):
        where[column] = values[column]


@compiled
def explain(
    heard: Sightings, wanted: BoolArray, found: FloatArray, least: float
) -> tuple[float, int]:
    """Find landmarks that explain echoes, those first that explain most.

    Parameters
    ----------
    heard : Sightings
        Of one robot.
    wanted : (echoes,) bool array
        Those that count.
    found : (MOST, COLUMNS) array
        Set to the landmarks.
    least : float
        What cannot come to so much is given up.

    Returns
    -------
    gain : float
        Log-likelihood ratio of the echoes, less what the landmarks cost; or less than `least`.
    count : int
        How many landmarks there are.
    """
    left, its = wanted.copy(), room_for(heard)
    tried = pairs(heard, wanted, its)
    every = len(tried) // MOST_PAIRS + 1
    tried = tried[every - 1 :: every]
    said, best, mark = np.zeros(len(tried)), np.zeros(COLUMNS), np.zeros(COLUMNS)
    for one in range(len(tried)):
        said[one] = votes(tried[one], heard, left, its)
    tops = np.zeros((len(tried) + BLOCK - 1) // BLOCK)
    for block in range(len(tops)):
        set_top(said, block, tops)
    total, count = 0.0, 0
    while count < len(found):
        best[GAIN], fitted = 0.0, 0
        while fitted < FITTED and len(tried):
            one = top_of(said, tops)
            if said[one] < LEAST_ECHOES - 1:
                break
            now = votes(tried[one], heard, left, its)
            is_less = now < said[one] - 0.5
            # The same again is tried later, if at all.
            said[one] = now if is_less else 0.8 * said[one]
            set_top(said, one // BLOCK, tops)
            if is_less:
                continue
            put(tried[one], mark)
            fit(mark, heard, left, its)
            judge(mark, heard, left, its)
            fitted += 1
            if mark[GAIN] > best[GAIN]:
                put(mark, best)
        if best[GAIN] <= COST:
            break
        take(judge(best, heard, left, its), its, left)
        put(best, found[count])
        total, count = total + best[GAIN] - COST, count + 1
        # Those that follow explain hardly more, each.
        more = min(len(found) - count, int(left.sum()) // LEAST_ECHOES)
        if total + more * (best[GAIN] - COST) < least:
            return total + more * (best[GAIN] - COST), count
    return total, count


@compiled
def explained_by(marks: FloatArray, heard: Sightings, wanted: BoolArray) -> float:
    """What landmarks that were found elsewhere explain, each moved to where its echoes have it."""
    left, its, total = wanted.copy(), room_for(heard), 0.0
    for row in range(len(marks)):
        mark = marks[row].copy()
        fit(mark, heard, left, its)
        count = judge(mark, heard, left, its)
        if mark[GAIN] > COST:
            total += mark[GAIN] - COST
            take(count, its, left)
    return total
