"""Points and walls that a robot's echoes show: compiled.

An echo is from a point if points of several pings' arcs meet there, and from a wall if several arcs
have a tangent in common: either is found from two echoes, and tried on all others (RANSAC, Fischler
& Bolles 1981, with all pairs).  Those that explain most are taken first, by how well ranges fit and
by how loud the echoes are, which tells how far off the axis of the beam the landmark is.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.robot_check.sightings import ANGLES, Sightings
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled, compiled_within, inlined

#: Kinds of landmarks; columns of one: its kind, x and y or direction of the normal and distance,
#: the log-likelihood ratio of its echoes, their level at one metre on the axis, dB, and between
#: which places along it they were heard.
POINT, WALL = 0.0, 1.0
KIND, A, B, GAIN, LEVEL, LOW, HIGH, COLUMNS = range(8)
#: Landmarks at the most, and pairs of echoes that are tried for one.
MOST, MOST_PAIRS = 20, 2000
#: How far apart, m, pings must be that show a point, or a wall; and standard deviations of ranges
#: (with those of poses), m, and of levels, dB.
POINT_BASE_M, WALL_BASE_M, RANGE_STD_M, LEVEL_STD_DB = 0.15, 0.25, 0.03, 4.0
#: Echoes that a landmark needs, and what its unknowns cost of log-likelihood.
LEAST_ECHOES, COST = 4, 9.0
#: Probability of hearing it, share of echoes whose level is any, and between which levels, dB.
HEARD, ANY_LEVEL, LEVELS_DB = 0.5, 0.1, 30.0
#: Standard deviations within which an echo may be a landmark's, and within which it is.
WITHIN, SURELY_WITHIN = 3.0, 2.0
#: Steps of a fit, how well each unknown is known beforehand, and candidates that are fitted.
STEPS, KNOWN, FITTED = 4, 0.3, 6
TINY, FAR_M = 1e-9, 1e9
#: Candidates of which the best is kept in mind.
BLOCK = 64


@compiled_within
def wrap(angle: float) -> float:
    """Between -π and π."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@compiled_within
def level_of(mark: FloatArray, heard: Sightings, far_m: float, off: float) -> float:
    """Of an echo from so far, over that from one metre on the axis; `off` in half angles, dB."""
    spread = 40.0 if mark[KIND] == POINT else 20.0
    gain: float = heard.gains_db[int(off * (ANGLES - 1) + 0.5)]
    return gain - spread * math.log10(max(far_m, TINY))


class LandmarkMatches(NamedTuple):
    """Echoes that may be from a landmark, arrays with room for all of them; and beams."""

    #: (pings,) arrays: which way beams look, and the cosine of their half angles, less rounding:
    #: what is farther off their axes they do not hear, which is found out fastest.
    ahead_x: FloatArray
    ahead_y: FloatArray
    edge: FloatArray
    #: Which.
    echo: NDArray[np.int64]
    #: By how many standard deviations it is farther, in which direction the landmark is, and how
    #: far off the axis of the beam, in half angles.
    miss: FloatArray
    angle_rad: FloatArray
    off: FloatArray


@compiled_within
def room_for(heard: Sightings) -> LandmarkMatches:
    """Matches of all echoes, and one that may not be."""
    room = len(heard.ping) + 1
    return LandmarkMatches(
        np.cos(heard.yaw_rad), np.sin(heard.yaw_rad), np.cos(heard.half_rad) - TINY,
        np.zeros(room, np.int64), np.zeros(room), np.zeros(room), np.zeros(room),
    )  # fmt: skip


@compiled_within
def match(mark: FloatArray, heard: Sightings, left: BoolArray, its: LandmarkMatches) -> int:
    """Set which of the echoes that are left may be from a landmark; how many there are."""
    count, angle, is_point = 0, mark[A], mark[KIND] == POINT
    along_x, along_y = math.cos(angle), math.sin(angle)
    for ping in range(len(heard.x_m)):
        ahead_x, ahead_y, edge = its.ahead_x[ping], its.ahead_y[ping], its.edge[ping]
        if is_point:
            to_x, to_y = mark[A] - heard.x_m[ping], mark[B] - heard.y_m[ping]
            far_m = math.sqrt(to_x * to_x + to_y * to_y) + TINY
            is_outside = ahead_x * to_x + ahead_y * to_y < edge * far_m - TINY
        else:
            to_x, to_y = along_x, along_y
            far_m = mark[B] - along_x * heard.x_m[ping] - along_y * heard.y_m[ping]
            is_outside = ahead_x * along_x + ahead_y * along_y < edge
        if is_outside:
            continue
        for echo in range(heard.first[ping], heard.first[ping + 1]):
            miss = (heard.range_m[echo] - far_m) / RANGE_STD_M
            if abs(miss) >= WITHIN or not left[echo]:
                continue
            if is_point:
                angle = math.atan2(to_y, to_x)
            off = abs(wrap(angle - heard.yaw_rad[ping])) / heard.half_rad[ping]
            its.echo[count], its.miss[count] = echo, miss
            its.angle_rad[count], its.off[count] = angle, off
            count += off <= 1.0
    return count


@compiled_within
def votes(mark: FloatArray, heard: Sightings, left: BoolArray, its: LandmarkMatches) -> float:
    """Echoes that may be from a landmark, each by how well it fits."""
    total = 0.0
    for number in range(match(mark, heard, left, its)):
        total += math.exp(-0.5 * its.miss[number] ** 2)
    return total


@compiled_within
def fit(mark: FloatArray, heard: Sightings, left: BoolArray, its: LandmarkMatches) -> None:
    """Move a landmark to where its echoes have it, by least squares."""
    for _ in range(STEPS):
        aa, ab, bb, right_a, right_b = KNOWN, 0.0, KNOWN, 0.0, 0.0
        for number in range(match(mark, heard, left, its)):
            miss, angle = its.miss[number], its.angle_rad[number]
            ping, weight = heard.ping[its.echo[number]], math.exp(-0.5 * miss * miss)
            by_a, by_b = math.cos(angle), math.sin(angle)
            if mark[KIND] == WALL:
                by_a = math.sin(angle) * heard.x_m[ping] - math.cos(angle) * heard.y_m[ping]
                by_b = 1.0
            aa += weight * by_a * by_a
            ab += weight * by_a * by_b
            bb += weight * by_b * by_b
            right_a += weight * by_a * miss * RANGE_STD_M
            right_b += weight * by_b * miss * RANGE_STD_M
        determinant = aa * bb - ab * ab
        mark[A] += (right_a * bb - right_b * ab) / determinant
        mark[B] += (right_b * aa - right_a * ab) / determinant


@compiled_within
def judge(mark: FloatArray, heard: Sightings, left: BoolArray, its: LandmarkMatches) -> int:
    """Set what a landmark explains, how loud it is, and which echoes are its; how many."""
    mark[GAIN], mark[LEVEL], mark[LOW], mark[HIGH] = 0.0, 0.0, FAR_M, -FAR_M
    count, within_db = match(mark, heard, left, its), 1e3
    levels_db = np.empty(count)
    for number in range(count):
        echo = its.echo[number]
        expected_db = level_of(mark, heard, heard.range_m[echo], its.off[number])
        levels_db[number] = heard.level_db[echo] - expected_db
    # The mean of levels, and then of those near it.
    for _ in range(4):
        total, sum_db = TINY, 0.0
        for level_db in levels_db:
            weight = math.exp(-0.5 * ((level_db - mark[LEVEL]) / within_db) ** 2)
            total += weight
            sum_db += weight * level_db
        mark[LEVEL], within_db = sum_db / total, 2.0 * LEVEL_STD_DB
    if count < LEAST_ECHOES:
        return count
    at_peak = HEARD / (math.sqrt(2.0 * math.pi) * RANGE_STD_M * heard.background)
    for number in range(count):
        miss, ping = its.miss[number], heard.ping[its.echo[number]]
        fits = at_peak * math.exp(-0.5 * miss * miss)
        mark[GAIN] += math.log(1.0 + fits * fits_level(levels_db[number] - mark[LEVEL]))
        along_m = math.cos(mark[A]) * heard.y_m[ping] - math.sin(mark[A]) * heard.x_m[ping]
        mark[LOW], mark[HIGH] = min(mark[LOW], along_m), max(mark[HIGH], along_m)
    return count


@compiled_within
def take(count: int, its: LandmarkMatches, left: BoolArray) -> None:
    """Take from the echoes that are left those that are a landmark's."""
    for number in range(count):
        if abs(its.miss[number]) < SURELY_WITHIN:
            left[its.echo[number]] = False


@compiled_within
def fits_level(apart_db: float) -> float:
    """How much likelier a level is than any other."""
    share = LEVELS_DB / (math.sqrt(2.0 * math.pi) * LEVEL_STD_DB)
    fits = share * math.exp(-0.5 * (apart_db / LEVEL_STD_DB) ** 2)
    return ANY_LEVEL + (1.0 - ANY_LEVEL) * fits


@compiled_within
def pairs(heard: Sightings, wanted: BoolArray, its: LandmarkMatches) -> FloatArray:
    """Landmarks that two echoes have in common, (landmarks, B + 1)."""
    found, out = 0, np.zeros((MOST_PAIRS, B + 1))
    ahead_x, ahead_y, edge = its.ahead_x, its.ahead_y, its.edge
    for one in range(len(wanted)):
        ping, near_m = heard.ping[one], heard.range_m[one]
        for other in range(ping + 1 if wanted[one] else len(heard.x_m), len(heard.x_m)):
            to_x, to_y = heard.x_m[other] - heard.x_m[ping], heard.y_m[other] - heard.y_m[ping]
            base_m = math.hypot(to_x, to_y)
            if base_m < POINT_BASE_M:
                continue
            for two in range(heard.first[other], heard.first[other + 1]):
                far_m = heard.range_m[two]
                for kind in (POINT, WALL):
                    cosine = cosine_between(base_m, near_m, far_m, kind)
                    if not wanted[two] or abs(cosine) >= 1.0:
                        continue
                    sine = math.sqrt(1.0 - cosine * cosine)
                    for side in (-sine, sine):
                        by_x = (to_x * cosine - to_y * side) / base_m
                        by_y = (to_y * cosine + to_x * side) / base_m
                        if by_x * ahead_x[ping] + by_y * ahead_y[ping] < edge[ping]:
                            continue
                        there_x, there_y = by_x, by_y
                        if kind == POINT:
                            there_x = (by_x * near_m - to_x) / far_m
                            there_y = (by_y * near_m - to_y) / far_m
                        if there_x * ahead_x[other] + there_y * ahead_y[other] < edge[other]:
                            continue
                        if found == len(out):
                            out = np.concatenate((out, np.zeros_like(out)))
                        place(out[found], kind, heard, ping, near_m, by_x, by_y)
                        found += 1
    return out[:found]


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
