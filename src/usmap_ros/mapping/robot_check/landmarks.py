"""Points and walls that a robot's echoes show: compiled.

An echo is from a point if points of several pings' arcs meet there, and from a wall if several arcs
have a tangent in common: either is found from two echoes, and tried on all others (RANSAC, Fischler
& Bolles 1981, with all pairs).  Those that explain most are taken first, by how well ranges fit and
by how loud the echoes are, which tells how far off the axis of the beam the landmark is.
"""

from __future__ import annotations

import math

import numpy as np

from usmap_ros.mapping.robot_check.sightings import ANGLES, Sightings
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled, compiled_within

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
#: Steps of a fit, how well each unknown is known beforehand, and candidates that are fitted.
STEPS, KNOWN, FITTED = 4, 0.3, 6
TINY, FAR_M = 1e-9, 1e9


@compiled_within
def wrap(angle: float) -> float:
    """Between -π and π."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@compiled_within
def seen_from(mark: FloatArray, x_m: float, y_m: float) -> tuple[float, float]:
    """How far a landmark is, and in which direction."""
    if mark[KIND] == POINT:
        to_x, to_y = mark[A] - x_m, mark[B] - y_m
        return math.sqrt(to_x * to_x + to_y * to_y) + TINY, math.atan2(to_y, to_x)
    return mark[B] - math.cos(mark[A]) * x_m - math.sin(mark[A]) * y_m, mark[A]


@compiled_within
def level_of(mark: FloatArray, heard: Sightings, far_m: float, off: float) -> float:
    """Of an echo from so far, over that from one metre on the axis; `off` in half angles, dB."""
    spread = 40.0 if mark[KIND] == POINT else 20.0
    gain: float = heard.gains_db[int(off * (ANGLES - 1) + 0.5)]
    return gain - spread * math.log10(max(far_m, TINY))


@compiled_within
def misses(mark: FloatArray, heard: Sightings, echo: int) -> tuple[float, float, float]:
    """By how many standard deviations an echo is farther, in which direction, how far off."""
    ping = heard.ping[echo]
    far_m, angle = seen_from(mark, heard.x_m[ping], heard.y_m[ping])
    off = abs(wrap(angle - heard.yaw_rad[ping])) / heard.half_rad[ping]
    return (heard.range_m[echo] - far_m) / RANGE_STD_M, angle, off


@compiled_within
def votes(mark: FloatArray, heard: Sightings, left: BoolArray) -> float:
    """Echoes that may be from a landmark."""
    total = 0.0
    for echo in range(len(left)):
        if left[echo]:
            miss, _, off = misses(mark, heard, echo)
            if abs(miss) < 3.0 and off <= 1.0:
                total += math.exp(-0.5 * miss * miss)
    return total


@compiled_within
def fit(mark: FloatArray, heard: Sightings, left: BoolArray) -> None:
    """Move a landmark to where its echoes have it, by least squares."""
    for _ in range(STEPS):
        aa, ab, bb, right_a, right_b = KNOWN, 0.0, KNOWN, 0.0, 0.0
        for echo in range(len(left)):
            if not left[echo]:
                continue
            miss, angle, off = misses(mark, heard, echo)
            if abs(miss) >= 3.0 or off > 1.0:
                continue
            ping, weight = heard.ping[echo], math.exp(-0.5 * miss * miss)
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
def judge(mark: FloatArray, heard: Sightings, left: BoolArray, is_its: BoolArray) -> None:
    """Set what a landmark explains, how loud it is, and which echoes are its."""
    mark[GAIN], mark[LEVEL], mark[LOW], mark[HIGH] = 0.0, 0.0, FAR_M, -FAR_M
    count, within_db = 0, 1e3
    # The mean of levels, and then of those near it.
    for _ in range(4):
        total, sum_db = TINY, 0.0
        count = 0
        for echo in range(len(left)):
            is_its[echo] = False
            if not left[echo]:
                continue
            miss, _, off = misses(mark, heard, echo)
            if abs(miss) >= 3.0 or off > 1.0:
                continue
            is_its[echo] = True
            count += 1
            level_db = heard.level_db[echo] - level_of(mark, heard, heard.range_m[echo], off)
            weight = math.exp(-0.5 * ((level_db - mark[LEVEL]) / within_db) ** 2)
            total += weight
            sum_db += weight * level_db
        mark[LEVEL], within_db = sum_db / total, 2.0 * LEVEL_STD_DB
    if count < LEAST_ECHOES:
        return
    at_peak = HEARD / (math.sqrt(2.0 * math.pi) * RANGE_STD_M * heard.background)
    for echo in range(len(left)):
        if not is_its[echo]:
            continue
        miss, _, off = misses(mark, heard, echo)
        apart_db = heard.level_db[echo] - level_of(mark, heard, heard.range_m[echo], off)
        fits = at_peak * math.exp(-0.5 * miss * miss) * fits_level(apart_db - mark[LEVEL])
        mark[GAIN] += math.log(1.0 + fits)
        ping = heard.ping[echo]
        along_m = math.cos(mark[A]) * heard.y_m[ping] - math.sin(mark[A]) * heard.x_m[ping]
        mark[LOW], mark[HIGH] = min(mark[LOW], along_m), max(mark[HIGH], along_m)
        is_its[echo] = abs(miss) < 2.0


@compiled_within
def fits_level(apart_db: float) -> float:
    """How much likelier a level is than any other."""
    share = LEVELS_DB / (math.sqrt(2.0 * math.pi) * LEVEL_STD_DB)
    fits = share * math.exp(-0.5 * (apart_db / LEVEL_STD_DB) ** 2)
    return ANY_LEVEL + (1.0 - ANY_LEVEL) * fits


@compiled_within
def may_hear(mark: FloatArray, heard: Sightings, echo: int) -> bool:
    """Whether a landmark is in the beam of an echo's ping."""
    return misses(mark, heard, echo)[2] <= 1.0


@compiled_within
def angle_between(heard: Sightings, one: int, two: int, kind: float) -> tuple[float, float]:
    """From one ping towards another, and from there to a landmark of an echo of each.

    The latter is beyond π if there is none.
    """
    ping, other = heard.ping[one], heard.ping[two]
    to_x, to_y = heard.x_m[other] - heard.x_m[ping], heard.y_m[other] - heard.y_m[ping]
    base_m, near_m, far_m = math.hypot(to_x, to_y), heard.range_m[one], heard.range_m[two]
    if base_m < (POINT_BASE_M if kind == POINT else WALL_BASE_M):
        return 0.0, FAR_M
    cosine = (near_m - far_m) / base_m
    if kind == POINT:
        squares = near_m * near_m + base_m * base_m - far_m * far_m
        cosine = squares / (2.0 * near_m * base_m)
    return math.atan2(to_y, to_x), math.acos(cosine) if abs(cosine) < 1.0 else FAR_M


@compiled_within
def pairs(heard: Sightings, wanted: BoolArray, every: int, out: FloatArray) -> int:
    """Landmarks that two echoes have in common: one of every so many; how many there are."""
    found, last = 0, len(out) - 1
    for one in range(len(wanted)):
        for two in range(one + 1 if wanted[one] else len(wanted), len(wanted)):
            for kind in (POINT, WALL):
                towards, apart = angle_between(heard, one, two, kind)
                if not wanted[two] or apart > math.pi:
                    continue
                for side in (-1.0, 1.0):
                    mark, angle = out[min(found // every, last)], wrap(towards + side * apart)
                    ping, range_m = heard.ping[one], heard.range_m[one]
                    x_m = heard.x_m[ping] + range_m * math.cos(angle)
                    y_m = heard.y_m[ping] + range_m * math.sin(angle)
                    mark[KIND], mark[A], mark[B] = kind, x_m, y_m
                    if kind == WALL:
                        mark[A], mark[B] = angle, math.cos(angle) * x_m + math.sin(angle) * y_m
                    found += may_hear(mark, heard, one) and may_hear(mark, heard, two)
    return found


@compiled
def explain(heard: Sightings, wanted: BoolArray, found: FloatArray) -> tuple[float, int]:
    """Find landmarks that explain echoes, those first that explain most.

    Parameters
    ----------
    heard : Sightings
        Of one robot.
    wanted : (echoes,) bool array
        Those that count.
    found : (MOST, COLUMNS) array
        Set to the landmarks.

    Returns
    -------
    gain : float
        Log-likelihood ratio of the echoes, less what the landmarks cost.
    count : int
        How many landmarks there are.
    """
    tried = np.zeros((MOST_PAIRS + 1, COLUMNS))
    every = pairs(heard, wanted, 1 << 30, tried) // MOST_PAIRS + 1
    number = pairs(heard, wanted, every, tried) // every
    left, is_its = wanted.copy(), np.zeros(len(wanted), np.bool_)
    said, best = np.zeros(number), np.zeros(COLUMNS)
    for one in range(number):
        said[one] = votes(tried[one], heard, left)
    total, count = 0.0, 0
    while count < len(found):
        best[GAIN], fitted = 0.0, 0
        while fitted < FITTED and number:
            one = int(said.argmax())
            if said[one] < LEAST_ECHOES - 1:
                break
            now = votes(tried[one], heard, left)
            if now < said[one] - 0.5:
                said[one] = now
                continue
            # The same again is tried later, if at all.
            said[one] *= 0.8
            mark = tried[one].copy()
            fit(mark, heard, left)
            judge(mark, heard, left, is_its)
            fitted += 1
            if mark[GAIN] > best[GAIN]:
                best[:] = mark
        if best[GAIN] <= COST:
            break
        judge(best, heard, left, is_its)
        found[count] = best
        total, count = total + best[GAIN] - COST, count + 1
        for echo in range(len(left)):
            left[echo] = left[echo] and not is_its[echo]
    return total, count


@compiled
def explained_by(marks: FloatArray, heard: Sightings) -> float:
    """What landmarks that were found elsewhere explain, each moved to where its echoes have it."""
    left, is_its = np.ones(len(heard.ping), np.bool_), np.zeros(len(heard.ping), np.bool_)
    total = 0.0
    for row in range(len(marks)):
        mark = marks[row].copy()
        fit(mark, heard, left)
        judge(mark, heard, left, is_its)
        if mark[GAIN] > COST:
            total += mark[GAIN] - COST
            for echo in range(len(left)):
                left[echo] = left[echo] and not is_its[echo]
    return total
