"""Round columns: smooth convex things, which answer each view from their nearest point.

A column of radius R about c returns one echo to each ping that looks at it, from range |c - p| - R:
another point of its surface each time, so that no cell of it explains many pings.  Echoes that no
reliable cell explains vote for centres, for some radii, and circles that fit what was heard better
than points do are columns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.log_odds import over_block
from usmap_ros.mapping.joint.surfaces.column_fits import (
    CROWD_M,
    HIT_SHARE,
    RANGE_STD_M,
    STRAY_SHARE,
    Circle,
    LevenbergMarquardt,
    PingSet,
    echoes_per_m,
    fitted_circle,
    log_ratio_of_point,
    log_ratio_of_two_points,
)
from usmap_ros.mapping.joint.surfaces.round_column import RoundColumn, overlaps_any
from usmap_ros.mapping.joint.visibility.echoes import Echoes
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.ping_table import HALF_ANGLE, HEADING, RANGE_STD, PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled
from usmap_ros.processes.threads import for_each, in_turn

#: Radii that are tried, m.
RADII_M = np.array([0.08, 0.12, 0.16, 0.2, 0.25, 0.32])
#: Pings whose ranges are less certain, by their poses, find no columns, m: what scatters as much as
#: its radius may be is no circle.
MOST_RANGE_STD_M = 0.04
#: Candidates that are looked at, and columns that are found, at the most.
MOST_TRIES, MOST_COLUMNS = 600, 60
#: Hits that a column has at least; how far the directions of hits must spread.
LEAST_HITS, LEAST_SPREAD = 12, 0.1
#: Log-likelihood ratio of a column to chance: in all, and on the mean of its hits, times the spread
#: of directions.
LEAST_LOG_RATIO, LEAST_LOG_RATIO_A_HIT = 55.0, 0.16
#: By how much likelier than a point it is: where poses are uncertain, a circle fits as well.
LEAST_OVER_POINT = 3.0
#: In all, and on the mean of its hits, at which a column is suspected, from wherever it was heard.
SUSPECT_LOG_RATIO, SUSPECT_LOG_RATIO_A_HIT = 20.0, 2.5
#: The same of circles which tell of each other: log-likelihood ratio, spread, misses over hits, and
#: by how much likelier they are than a point and than two.  In none of 14 own rooms of walls there
#: were four that are alike.
FAINT_LOG_RATIO, FAINT_SPREAD, MOST_FAINT_MISSES = 23.0, 0.2, 0.2
FAINT_OVER_POINT, FAINT_OVER_TWO_POINTS = 40.0, 5.0
#: Candidates of votes lie near columns, but not so near that few steps lead there: some fits of
#: rough columns ended by a radius beside them.
FROM_VOTES = LevenbergMarquardt(12, np.full(3, 0.16))


class FoundColumns(NamedTuple):
    """What echoes show that nothing else explains."""

    #: Columns, suspected ones among them.
    columns: list[RoundColumn]
    #: Circles that were heard too faintly for that, all around or nearly so, some of them twice.
    faint: list[Circle]


def round_columns(ping_set: PingSet, is_explained: BoolArray, field: Field) -> FoundColumns:
    """Columns that explain echoes which nothing else does.

    Parameters
    ----------
    ping_set : PingSet
        Pings.
    is_explained : (echoes,) bool array
        Whether cells or mirrors explain an echo.
    field : Field
        The cells, which centres are looked for at.
    """
    is_open, found = ~is_explained & tell_columns(ping_set), list[RoundColumn]()
    faint = list[Circle]()

    def fitted(place: tuple[float, float, float]) -> Circle | None:
        if len(found) == MOST_COLUMNS or overlaps_any(*place, found):
            return None
        return fitted_circle(ping_set, is_open, np.array(place), FROM_VOTES)

    def take(place: tuple[float, float, float], circle: Circle | None) -> bool:
        if circle is None:
            return False
        is_certain = _is_heard_around(circle, ping_set)
        if not is_certain and is_faint(circle, ping_set):
            faint.append(circle)
        if not is_certain and not _is_suspected(circle):
            return False
        found.append(RoundColumn.of(circle, is_certain, ping_set))
        is_open[circle.echoes] = False
        return True

    in_turn(fitted, candidates(ping_set, is_open, field, RADII_M.tolist()), take)
    return FoundColumns(found, faint)


def tell_columns(ping_set: PingSet) -> BoolArray:
    """Which echoes are of pings whose ranges are certain enough to find columns: (echoes,)."""
    return _stds_m(ping_set) <= MOST_RANGE_STD_M


def _stds_m(ping_set: PingSet) -> FloatArray:
    """Standard deviation of each echo's range by the ping's pose: (echoes,) array."""
    of_pings: FloatArray = ping_set.table.numbers[ping_set.pings, RANGE_STD]
    return np.repeat(of_pings, np.diff(ping_set.echoes.start))


def _is_heard_around(circle: Circle, ping_set: PingSet) -> bool:
    """Whether a circle was heard often enough, and from enough directions, to be shown."""
    hits = len(circle.pings)
    return (
        hits >= LEAST_HITS
        and circle.spread >= LEAST_SPREAD
        and circle.log_ratio >= LEAST_LOG_RATIO
        and circle.log_ratio * circle.spread >= LEAST_LOG_RATIO_A_HIT * hits
        and not circle.is_corner
        and circle.log_ratio > log_ratio_of_point(ping_set, circle) + LEAST_OVER_POINT
    )


def _is_suspected(circle: Circle) -> bool:
    """Whether there may be a column."""
    least_log_ratio = max(SUSPECT_LOG_RATIO, SUSPECT_LOG_RATIO_A_HIT * len(circle.pings))
    return circle.log_ratio >= least_log_ratio


def is_faint(
    circle: Circle, ping_set: PingSet, over_two_points: float = FAINT_OVER_TWO_POINTS
) -> bool:
    """Whether a circle may be a column if several of its place are like it.

    Parameters
    ----------
    circle : Circle
        What was heard.
    ping_set : PingSet
        Pings.
    over_two_points : float
        By how much likelier than two points it must be.
    """
    hits = len(circle.pings)
    return (
        hits >= LEAST_HITS
        and circle.spread >= FAINT_SPREAD
        and circle.log_ratio >= FAINT_LOG_RATIO
        and circle.misses <= MOST_FAINT_MISSES * hits
        and not circle.is_corner
        and circle.log_ratio > log_ratio_of_point(ping_set, circle) + FAINT_OVER_POINT
        and circle.log_ratio > log_ratio_of_two_points(ping_set, circle) + over_two_points
    )


def candidates(
    ping_set: PingSet, is_open: BoolArray, field: Field, radii_m: Sequence[float]
) -> list[tuple[float, float, float]]:
    """Middles and radii that open echoes vote for, the best ones first.

    Parameters
    ----------
    ping_set : PingSet
        Pings.
    is_open : (echoes,) bool array
        Which echoes vote.
    field : Field
        The cells, which centres are looked for at.
    radii_m : sequence of float
        That are tried.
    """
    table, pings, echoes, _ = ping_set
    telling = _telling(echoes, _stds_m(ping_set))
    best = list[tuple[float, float, float, float]]()

    def most(radius_m: float) -> list[tuple[float, float, float, float]]:
        votes = np.zeros(field.shape, np.float32)
        _vote(table, pings, echoes, is_open, telling, field, radius_m, votes)
        rows, columns = np.nonzero((votes >= SUSPECT_LOG_RATIO) & (votes >= over_block(votes)))
        x_m = (field.first_column + columns + 0.5) * field.resolution_m
        y_m = (field.first_row + rows + 0.5) * field.resolution_m
        told = zip(votes[rows, columns].tolist(), x_m.tolist(), y_m.tolist(), strict=True)
        return [(vote, x, y, radius_m) for vote, x, y in told]

    for some in for_each(most, radii_m):
        best += some
    best.sort(key=lambda candidate: -candidate[0])
    return [(x_m, y_m, radius_m) for _, x_m, y_m, radius_m in best[:MOST_TRIES]]


def _telling(echoes: Echoes, stds_m: FloatArray) -> FloatArray:
    """Log-likelihood ratio of a hit just where it should be, for each echo."""
    std_m = np.maximum(stds_m, RANGE_STD_M)
    crowd = np.zeros(len(echoes.range_m), np.int64)
    _count_around(echoes, crowd)
    peak = HIT_SHARE * (1.0 - STRAY_SHARE) / (std_m * math.sqrt(2.0 * math.pi))
    telling: FloatArray = np.log(np.maximum(peak / echoes_per_m(crowd), 1.0))
    return telling


@compiled
def _count_around(echoes: Echoes, crowd: NDArray[np.int64]) -> None:
    """Set how many other echoes of the same ping are within `CROWD_M` of each."""
    for ping in range(len(echoes.start) - 1):
        for echo in range(echoes.start[ping], echoes.start[ping + 1]):
            for other in range(echoes.start[ping], echoes.start[ping + 1]):
                if other != echo and abs(echoes.range_m[other] - echoes.range_m[echo]) < CROWD_M:
                    crowd[echo] += 1


@compiled
def _vote(
    table: PingTable,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    telling: FloatArray,
    field: Field,
    radius_m: float,
    votes: NDArray[np.float32],
) -> None:
    """Add up, for each centre, how telling the open echoes are that a column there would return.

    Of each ping the first one counts.
    """
    last = np.full((field.rows, field.columns), -1, np.int32)
    res = field.resolution_m
    for index in range(len(pings)):
        numbers = table.numbers[pings[index]]
        half = numbers[HALF_ANGLE]
        for echo in range(echoes.start[index], echoes.start[index + 1]):
            if not is_open[echo]:
                continue
            distance = echoes.range_m[echo] + radius_m
            steps = int(2.0 * half * distance / (0.7 * res)) + 1
            # Each direction is the one before, turned by a step.
            cosine, sine = math.cos(2.0 * half / steps), math.sin(2.0 * half / steps)
            x = distance / res * math.cos(numbers[HEADING] - half)
            y = distance / res * math.sin(numbers[HEADING] - half)
            for k in range(steps + 1):
                if k > 0:
                    x, y = x * cosine - y * sine, x * sine + y * cosine
                column = math.floor(numbers[X] / res + x) - field.first_column
                row = math.floor(numbers[Y] / res + y) - field.first_row
                if row < 1 or column < 1 or row >= field.rows - 1 or column >= field.columns - 1:
                    continue
                if last[row, column] != index:
                    last[row, column] = index
                    votes[row, column] += telling[echo]
