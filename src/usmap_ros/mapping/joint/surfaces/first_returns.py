"""Whether walls answer sensors that report the first thing only from any side, or as mirrors do.

What such a sensor hears has no loudness that would tell, and nothing is heard behind it.  Where a
wall is in the beam, but not the foot of the perpendicular on it, a surface that scatters is heard
at the edge of the beam; a mirror is not.  Light is scattered by most walls, sound by rough ones.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall
from usmap_ros.mapping.joint.visibility.echoes import Echoes
from usmap_ros.mapping.ping_table import GREATEST_RANGE, HALF_ANGLE, HEADING, PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.geometry import wrapped

#: Angles between a wall's normal and the edge of the beam, and its axis, that count, rad.
LEAST_ASLANT_RAD, MOST_OFF_RAD = math.radians(8.0), math.radians(75.0)
#: How near the first return must be to the wall, and how far beyond its ends a wall may go on, m.
NEAR_M, BEYOND_M = 0.06, 0.3
#: Shares of looks aslant that hear a wall at the edge of the beam, and before half of the way to
#: where its axis meets it, below both of which walls are mirrors.  Of 110 recordings of first
#: echoes, 66 among rough walls, the former alone tells 94 %: rough walls have 0.44 to 0.9, smooth
#: ones 0.1 to 0.65.  Where the edge is not where it is said to be the latter is 0.9 and more.
MOST_AT_EDGE, MOST_MIRRORED = 0.47, 0.87
#: Looks aslant that count before there are any, and how many of them hear a wall: where nobody
#: looks aslant walls may be mirrors.
LOOKS_BEFORE, HEARD_BEFORE = 2.0, 0.8
#: Share of what was heard that is heard squarely of walls, at the least, where these are mirrors:
#: in rooms of mirrors it is 0.1 to 0.7, of light among walls of card board, from poses that are
#: off, 0.07 at the most.
HEARD_SQUARELY = 0.08


def answer_as_mirrors(
    walls: Sequence[MirrorWall], table: PingTable, pings: NDArray[np.int64], echoes: Echoes
) -> bool:
    """Whether some walls answer as mirrors do.

    Parameters
    ----------
    walls : sequence of MirrorWall
        Walls by the feet of perpendiculars.
    table : PingTable
        Pings.
    pings : (pings,) integer array
        Their rows.
    echoes : Echoes
        Theirs.
    """
    numbers = table.numbers[pings]
    nearest_m = np.full(len(pings), np.inf)
    has_any = np.diff(echoes.start) > 0
    nearest_m[has_any] = echoes.range_m[echoes.start[:-1][has_any]]
    looks, at_edge, before_half = LOOKS_BEFORE, HEARD_BEFORE, HEARD_BEFORE
    for wall in walls:
        is_looking, near_m, far_m = _aslant(wall, numbers)
        is_looking &= nearest_m > near_m - NEAR_M
        looks += float(is_looking.sum())
        at_edge += float((is_looking & (nearest_m < near_m + NEAR_M)).sum())
        half_m = 0.5 * (near_m + far_m)
        before_half += float((is_looking & (nearest_m < half_m + NEAR_M)).sum())
    squarely = sum(len(wall.pings) for wall in walls)
    is_mirror = at_edge < MOST_AT_EDGE * looks and before_half < MOST_MIRRORED * looks
    return is_mirror and squarely > HEARD_SQUARELY * int(has_any.sum())


def _aslant(wall: MirrorWall, numbers: FloatArray) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Pings that look at a wall aslant, and its range at the beam's edge and on its axis, m."""
    cosine, sine = math.cos(wall.normal_rad), math.sin(wall.normal_rad)
    x_m, y_m = numbers[:, X], numbers[:, Y]
    across_m, along_m = wall.distance_m - cosine * x_m - sine * y_m, cosine * y_m - sine * x_m
    axis_rad = wrapped(numbers[:, HEADING] - wall.normal_rad)
    edge_rad = np.abs(axis_rad) - numbers[:, HALF_ANGLE]
    is_aslant = (across_m > 0.0) & (edge_rad > LEAST_ASLANT_RAD)
    is_aslant &= np.abs(axis_rad) < MOST_OFF_RAD
    edge_rad, axis_rad = np.where(is_aslant, (edge_rad * np.sign(axis_rad), axis_rad), 0.0)
    far_m, struck_m = across_m / np.cos(axis_rad), along_m + across_m * np.tan(edge_rad)
    is_aslant &= (struck_m > wall.begin_m - BEYOND_M) & (struck_m < wall.end_m + BEYOND_M)
    is_aslant &= far_m < numbers[:, GREATEST_RANGE]
    return is_aslant, across_m / np.cos(edge_rad), far_m
