"""A round column, and where columns are on a field."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.column_fits import Circle, PingSet, log_ratio_of_two_points
from usmap_ros.mapping.joint.surfaces.lines import BEGIN, DISTANCE, END, NORMAL_X, NORMAL_Y
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Share of suspected columns that are some.
SUSPECTED_SHARE = 0.5
#: A wall so near to a column, in cells, touches it, and is none if it is shorter: columns' sides
#: look like that, too.
TOUCHING_CELLS, WALL_CELLS = 1.5, 20.0


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

    def overlaps_any(self, others: Iterable[RoundColumn]) -> bool:
        """Whether it and any of some others cannot both be there."""
        return overlaps_any(self.x_m, self.y_m, self.radius_m, others)

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


def overlaps_any(
    x_m: float, y_m: float, radius_m: float, others: Iterable[RoundColumn | Circle]
) -> bool:
    """Whether a circle about a place and any of some others cannot both be there."""
    return any(
        math.hypot(x_m - other.x_m, y_m - other.y_m) < radius_m + other.radius_m for other in others
    )


def without_pairs(
    columns: list[RoundColumn], things: int, is_first: BoolArray
) -> list[RoundColumn]:
    """Columns, those suspected only which two points explain as well.

    Of many things that stand alone, some two are bound to be heard as one column would be.  How
    many things are round in this place, the columns tell that nothing else explains; where no more
    than one does, it may as well be any pair of all things.  But of two points, sensors that report
    the first thing only hear the nearer one, as of a column.

    Parameters
    ----------
    columns : list of RoundColumn
        Suspected ones among them.
    things : int
        How many things stand alone.
    is_first : (echoes,) bool array
        Whether each echo is of a sensor that reports the first thing only.
    """
    may_be_pairs = [not bool(is_first[column.echoes].all()) for column in columns]
    over = [
        column.over_two_points
        for column, may_be_pair in zip(columns, may_be_pairs, strict=True)
        if may_be_pair and column.is_certain
    ]
    least = math.log1p(things)
    told = sum(each > least for each in over)
    least = least - math.log1p(told) if told > 1 else math.log1p(math.comb(things, 2))
    return [
        replace(column, is_certain=column.is_certain and column.over_two_points > least)
        if may_be_pair
        else column
        for column, may_be_pair in zip(columns, may_be_pairs, strict=True)
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
