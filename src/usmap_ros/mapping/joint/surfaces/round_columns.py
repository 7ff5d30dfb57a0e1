"""Round columns: smooth convex things, which answer each view from their nearest point.

A column of radius R about c returns one echo to each ping that looks at it, from range |c - p| - R:
another point of its surface each time, so that no cell of it explains many pings.  Echoes that no
reliable cell explains vote for centres, for some radii, and circles that fit what was heard better
than points do are columns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

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
from usmap_ros.mapping.joint.surfaces.lines import BEGIN, DISTANCE, END, NORMAL_X, NORMAL_Y
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
#: Share of suspected columns that are some.
SUSPECTED_SHARE = 0.5
#: A wall so near to a column, in cells, touches it, and is none if it is shorter: columns' sides
#: look like that, too.
TOUCHING_CELLS, WALL_CELLS = 1.5, 20.0
#: Candidates of votes lie near columns, but not so near that few steps lead there: some fits of
#: rough columns ended by a radius beside them.
FROM_VOTES = LevenbergMarquardt(12, np.full(3, 0.16))


@dataclass(frozen=True)
class RoundColumn:
    """A column."""

    #: Its middle and radius.
    x_m: float
    y_m: float
    radius_m: float
    #: (hits,) integer arrays: that heard it, and their echoes of it.
    pings: NDArray[np.int64]
    echoes: NDArray[np.int64]
    #: Whether it was heard often enough, and from enough directions, to be shown.
    is_certain: bool
    #: How likely it is one, if it is not certain.
    likely: float = SUSPECTED_SHARE
    #: By how much likelier than two points one that is certain is, by its log-likelihood ratio.
    over_two_points: float = math.inf

    @classmethod
    def of(cls, circle: Circle, is_certain: bool, ping_set: PingSet) -> RoundColumn:
        """What a circle shows that some pings heard."""
        over = math.inf
        if is_certain:
            # Two points have one more unknown, by the Bayesian information criterion.
            over = circle.log_ratio + 0.5 * math.log(len(circle.pings))
            over -= log_ratio_of_two_points(ping_set, circle)
        return cls(
            circle.x_m,
            circle.y_m,
            circle.radius_m,
            circle.pings,
            circle.echoes,
            is_certain,
            over_two_points=over,
        )

    def bearing_from(self, x_m: float, y_m: float) -> float:
        """Direction in which a place hears it, rad."""
        return math.atan2(self.y_m - y_m, self.x_m - x_m)

    def overlaps(self, other: RoundColumn) -> bool:
        """Whether both cannot be there."""
        apart_m = math.hypot(self.x_m - other.x_m, self.y_m - other.y_m)
        return apart_m < self.radius_m + other.radius_m

    def is_on(self, lines: FloatArray, field: Field) -> bool:
        """Whether one of some lines on a field is a wall, and passes through it or touches it."""
        right = self.x_m / field.resolution_m - field.first_column - 0.5
        up = self.y_m / field.resolution_m - field.first_row - 0.5
        across = right * lines[:, NORMAL_X] + up * lines[:, NORMAL_Y] - lines[:, DISTANCE]
        along = up * lines[:, NORMAL_X] - right * lines[:, NORMAL_Y]
        is_wall = lines[:, END] - lines[:, BEGIN] >= WALL_CELLS
        is_near = np.abs(across) <= self.radius_m / field.resolution_m + TOUCHING_CELLS
        is_beside = (along >= lines[:, BEGIN]) & (along <= lines[:, END])
        return bool(np.any(is_wall & is_near & is_beside))


def round_columns(ping_set: PingSet, is_explained: BoolArray, field: Field) -> list[RoundColumn]:
    """Columns that explain echoes which nothing else does, suspected ones among them.

    Parameters
    ----------
    ping_set : PingSet
        Pings.
    is_explained : (echoes,) bool array
        Whether cells or mirrors explain an echo.
    field : Field
        The cells, which centres are looked for at.
    """
    table, pings, echoes, _ = ping_set
    stds_m = np.repeat(table.numbers[pings, RANGE_STD], np.diff(echoes.start))
    is_open, found = ~is_explained & (stds_m <= MOST_RANGE_STD_M), list[RoundColumn]()

    def fitted(place: tuple[float, float, float]) -> Circle | None:
        x_m, y_m, radius_m = place
        if len(found) == MOST_COLUMNS:
            return None
        if any(math.hypot(x_m - c.x_m, y_m - c.y_m) < radius_m + c.radius_m for c in found):
            return None
        return fitted_circle(ping_set, is_open, np.array(place), FROM_VOTES)

    def take(place: tuple[float, float, float], circle: Circle | None) -> bool:
        if circle is None:
            return False
        is_certain = _is_heard_around(circle, ping_set)
        if not is_certain and not _is_suspected(circle):
            return False
        found.append(RoundColumn.of(circle, is_certain, ping_set))
        is_open[circle.echoes] = False
        return True

    in_turn(fitted, _candidates(ping_set, is_open, stds_m, field), take)
    return found


def without_pairs(columns: list[RoundColumn], things: int) -> list[RoundColumn]:
    """Columns, those suspected only which two points explain as well.

    Of many things that stand alone, some two are bound to be heard as one column would be.  How
    many things are round in this place, the columns tell that nothing else explains; where no more
    than one does, it may as well be any pair of all things.

    Parameters
    ----------
    columns : list of RoundColumn
        Suspected ones among them.
    things : int
        How many things stand alone.
    """
    over = [column.over_two_points for column in columns if column.is_certain]
    least = math.log1p(things)
    told = sum(each > least for each in over)
    least = least - math.log1p(told) if told > 1 else math.log1p(math.comb(things, 2))
    return [
        replace(column, is_certain=column.is_certain and column.over_two_points > least)
        for column in columns
    ]


def drawn_columns(columns: list[RoundColumn], field: Field) -> BoolArray:
    """Cells at the surface of columns."""
    mask = np.zeros(field.shape, bool)
    for column in columns:
        beyond_m = _beyond_m(column, field)
        mask |= (beyond_m >= -field.resolution_m) & (beyond_m < 0.25 * field.resolution_m)
    return mask


def discs(columns: list[RoundColumn], field: Field, beside_m: float | None = None) -> BoolArray:
    """Cells that columns cover, and those beside them: as far as a cell is wide, or so far."""
    beside_m = field.resolution_m if beside_m is None else beside_m
    mask = np.zeros(field.shape, bool)
    for column in columns:
        mask |= _beyond_m(column, field) < beside_m
    return mask


def _beyond_m(column: RoundColumn, field: Field) -> FloatArray:
    """How far each cell's middle is from a column's surface, m; less than 0 inside of it."""
    x_m = (field.first_column + np.arange(field.columns) + 0.5) * field.resolution_m - column.x_m
    y_m = (field.first_row + np.arange(field.rows) + 0.5) * field.resolution_m - column.y_m
    beyond_m: FloatArray = np.hypot(x_m[np.newaxis], y_m[:, np.newaxis]) - column.radius_m
    return beyond_m


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


def _candidates(
    ping_set: PingSet, is_open: BoolArray, stds_m: FloatArray, field: Field
) -> list[tuple[float, float, float]]:
    """Middles and radii that open echoes vote for, the best ones first."""
    table, pings, echoes, _ = ping_set
    telling, best = _telling(echoes, stds_m), list[tuple[float, float, float, float]]()

    def most(radius_m: float) -> list[tuple[float, float, float, float]]:
        votes = np.zeros(field.shape, np.float32)
        _vote(table, pings, echoes, is_open, telling, field, radius_m, votes)
        rows, columns = np.nonzero((votes >= SUSPECT_LOG_RATIO) & (votes >= over_block(votes)))
        x_m = (field.first_column + columns + 0.5) * field.resolution_m
        y_m = (field.first_row + rows + 0.5) * field.resolution_m
        told = zip(votes[rows, columns].tolist(), x_m.tolist(), y_m.tolist(), strict=True)
        return [(vote, x, y, radius_m) for vote, x, y in told]

    for some in for_each(most, RADII_M.tolist()):
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
