"""Points and walls that echoes may be from: which are, where they have them, how loud: compiled.

How loud echoes are tells how far off the axis of the beam a landmark is.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.robot_check.sightings import ANGLES, Sightings
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled_within

#: Kinds of landmarks; columns of one: its kind, x and y or direction of the normal and distance,
#: the log-likelihood ratio of its echoes, their level at one metre on the axis, dB, between which
#: places along a wall they were heard, and the mean of the directions, x and y, in which a point's
#: hearers are.
POINT, WALL = 0.0, 1.0
KIND, A, B, GAIN, LEVEL, LOW, HIGH, HEARER_X, HEARER_Y, COLUMNS = range(10)
#: Standard deviations of ranges (with those of poses), m, and of levels, dB; and share of the
#: former that that of every other echo is, where poses are exact and nothing else is heard beside.
RANGE_STD_M, LEVEL_STD_DB, SHARP = 0.03, 4.0, 0.1
#: Echoes that a landmark needs.
LEAST_ECHOES = 4
#: Probability of hearing it, share of echoes whose level is any, and between which levels, dB.
HEARD, ANY_LEVEL, LEVELS_DB = 0.5, 0.1, 30.0
#: Standard deviations within which an echo may be a landmark's, and within which it is.
WITHIN, SURELY_WITHIN = 3.0, 2.0
#: Steps of a fit, and how well each unknown is known beforehand.
STEPS, KNOWN, UNLIKELY = 8, 0.3, 0.3
TINY, FAR_M = 1e-9, 1e9


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
def fits_range(miss: float) -> float:
    """How likely a range is that is off by so many standard deviations, over that of none."""
    sharp = miss / SHARP
    return 0.5 * math.exp(-0.5 * miss * miss) + 0.5 / SHARP * math.exp(-0.5 * sharp * sharp)


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
    for step in range(STEPS):
        aa, ab, bb, right_a, right_b = KNOWN, 0.0, KNOWN, 0.0, 0.0
        for number in range(match(mark, heard, left, its)):
            miss, angle = its.miss[number], its.angle_rad[number]
            ping, weight = heard.ping[its.echo[number]], math.exp(-0.5 * miss * miss)
            if 2 * step >= STEPS:
                # Sharp ones say most, once it is known which those are.
                sharp = math.exp(-0.5 * (miss / SHARP) ** 2) / SHARP
                weight = (weight + sharp / SHARP**2) / (UNLIKELY + weight + sharp)
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
    mark[HEARER_X], mark[HEARER_Y] = 0.0, 0.0
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
        fits = at_peak * fits_range(miss)
        mark[GAIN] += math.log(1.0 + fits * fits_level(levels_db[number] - mark[LEVEL]))
        along_m = math.cos(mark[A]) * heard.y_m[ping] - math.sin(mark[A]) * heard.x_m[ping]
        mark[LOW], mark[HIGH] = min(mark[LOW], along_m), max(mark[HIGH], along_m)
        mark[HEARER_X] -= math.cos(its.angle_rad[number]) / count
        mark[HEARER_Y] -= math.sin(its.angle_rad[number]) / count
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
