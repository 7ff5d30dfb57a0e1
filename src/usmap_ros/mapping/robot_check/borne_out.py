"""How well one robot's pings bear out the landmarks of another: compiled."""

import math

import numpy as np

from usmap_ros.mapping.robot_check.landmarks import (
    HEARD,
    HEARER_X,
    HEARER_Y,
    HIGH,
    KIND,
    LEVEL,
    LOW,
    TINY,
    WALL,
    A,
    B,
    fits_level,
    fits_range,
    level_of,
    wrap,
)
from usmap_ros.mapping.robot_check.sightings import Sightings
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.compiled import compiled, compiled_within

#: Standard deviations of ranges between robots, m; by how much louder than the limit an echo is
#: sure to be heard, dB; what a landmark counts that is not heard where it should be, each time; and
#: what it counts at the least and at the most.
STD_M, SURE_DB, NOT_HEARD, LEAST, MOST = 0.05, 6.0, -0.7, -4.0, 6.0
#: Least range, m; how far beyond where they were heard walls may go on, m; and share of the beam
#: that is sure.
NEAREST_M, BEYOND_M, INSIDE = 0.2, 0.1, 0.9
#: Standard deviations within which an echo may be a landmark's.
WITHIN = 4.0
#: A point was heard from one side if its hearers' directions have so long a mean; it may be a piece
#: of a wall, whose other side need not answer: only who looks from where that mean has so long a
#: part is sure to hear it.
ONE_SIDE, SAME_SIDE = 0.5, 0.25


@compiled_within
def evidence_of_ping(
    mark: FloatArray, heard: Sightings, ping: int, far_m: float, off: float
) -> float:
    """What a ping says of a landmark so far away, and so far off its axis."""
    at_peak = HEARD / (math.sqrt(2.0 * math.pi) * STD_M * heard.background)
    level_db, best, is_hidden = mark[LEVEL] + level_of(mark, heard, far_m, off), 0.0, False
    for echo in range(heard.first[ping], heard.first[ping + 1]):
        miss = (heard.range_m[echo] - far_m) / STD_M
        is_hidden = is_hidden or miss < WITHIN
        if abs(miss) < WITHIN:
            fits = at_peak * fits_range(miss)
            fits *= fits_level(heard.level_db[echo] - level_db)
            best = max(best, math.log(1.0 - HEARD + HEARD * fits))
    if best > 0.0:
        return best
    is_missing = not is_hidden and level_db > heard.limit_db[ping] + SURE_DB
    return NOT_HEARD if is_missing else 0.0


@compiled_within
def is_from_its_side(mark: FloatArray, to_x: float, to_y: float) -> bool:
    """Whether who looks at a point in such a direction is where it was heard from."""
    long = math.hypot(mark[HEARER_X], mark[HEARER_Y])
    towards = -(mark[HEARER_X] * to_x + mark[HEARER_Y] * to_y)
    return long < ONE_SIDE or towards > SAME_SIDE * math.hypot(to_x, to_y)


@compiled
def borne_out(marks: FloatArray, heard: Sightings, shifts: FloatArray, out: FloatArray) -> None:
    """Add how well a robot's pings bear out another one's landmarks, if these were elsewhere.

    Parameters
    ----------
    marks : (landmarks, COLUMNS) array
        Of one robot.
    heard : Sightings
        Of another one.
    shifts : (n, 2) array
        By how much the landmarks are moved, m.
    out : (n,) array
        Log-likelihood ratios are added.
    """
    said = np.zeros(len(shifts))
    for mark in marks:
        said[:] = 0.0
        for ping in range(len(heard.x_m)):
            add_evidence(mark, heard, ping, shifts, said)
        for number in range(len(shifts)):
            out[number] += min(max(said[number], LEAST), MOST)


@compiled_within
def add_evidence(
    mark: FloatArray, heard: Sightings, ping: int, shifts: FloatArray, said: FloatArray
) -> None:
    """Add what a ping says of a landmark in each of some places."""
    is_wall, edge = mark[KIND] == WALL, INSIDE * heard.half_rad[ping]
    along_x, along_y = math.cos(mark[A]), math.sin(mark[A])
    ahead_x, ahead_y = math.cos(heard.yaw_rad[ping]), math.sin(heard.yaw_rad[ping])
    to_x, to_y = along_x, along_y
    off_rad = abs(wrap(mark[A] - heard.yaw_rad[ping]))
    if is_wall and off_rad > edge:
        return
    # Rounding may leave what is on the edge to be looked at.
    least = math.cos(edge) - TINY
    for number in range(len(shifts)):
        x_m, y_m = heard.x_m[ping] - shifts[number, 0], heard.y_m[ping] - shifts[number, 1]
        if is_wall:
            far_m, along_m = mark[B] - along_x * x_m - along_y * y_m, along_x * y_m - along_y * x_m
            if along_m < mark[LOW] - BEYOND_M or along_m > mark[HIGH] + BEYOND_M:
                continue
        else:
            to_x, to_y = mark[A] - x_m, mark[B] - y_m
            far_m = math.sqrt(to_x * to_x + to_y * to_y)
            if ahead_x * to_x + ahead_y * to_y < least * far_m:
                continue
            off_rad = abs(wrap(math.atan2(to_y, to_x) - heard.yaw_rad[ping]))
        if NEAREST_M <= far_m <= heard.reach_m[ping] and off_rad <= edge:
            off = off_rad / heard.half_rad[ping]
            speaks = evidence_of_ping(mark, heard, ping, far_m, off)
            if speaks > 0.0 or is_wall or is_from_its_side(mark, to_x, to_y):
                said[number] += speaks
