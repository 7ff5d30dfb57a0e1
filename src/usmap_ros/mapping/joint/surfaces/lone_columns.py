"""Round columns in place of lone cells.

A column that was heard from one side is nearly a point: the cell nearest to its listeners explains
its echoes, each with a small error, and all around that cell would be free.  A circle explains them
better, and by how much tells a column from a pole.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from usmap_ros.mapping.joint.surfaces.column_fits import (
    RANGE_STD_M,
    Circle,
    LevenbergMarquardt,
    PingSet,
    fitted_circle,
    log_ratio_of_point,
)
from usmap_ros.mapping.joint.surfaces.round_column import RoundColumn
from usmap_ros.mapping.joint.surfaces.round_columns import (
    LEAST_HITS,
    LEAST_LOG_RATIO,
    SUSPECT_LOG_RATIO_A_HIT,
)
from usmap_ros.mapping.joint.visibility.beams import LOOKING_SHARE
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.ping_table import HALF_ANGLE, HEADING, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.geometry import wrapped
from usmap_ros.processes.threads import for_each, in_turn

#: Radii that fits begin with, m, and how each descends; and by how much likelier than a point what
#: they come to is.
Begun = Sequence[tuple[float, LevenbergMarquardt]]
Fits = list[tuple[float, Circle | None]]

#: Radii that fits begin with, m; what few directions tell of a radius is little, and most columns'
#: are 0.18 +- 0.08 m.
RADII_M = (0.12, 0.25)
DESCENT = LevenbergMarquardt(
    15, np.array([1e-3, 1e-3, (RANGE_STD_M / 0.08) ** 2]), usual_radius_m=0.18
)
#: Damping of the middle and of a radius that stays: were it free, the middle would go where it
#: belongs with another radius.
MIDDLE_ALONE = np.array([1e-3, 1e-3, 1e6])
#: To the point that explains most.
TO_POINT = LevenbergMarquardt(5, MIDDLE_ALONE, radii_m=(0.0, 0.0))
#: How much likelier than a point a column is, by its log-likelihood ratio, and the most pings that
#: should have heard it but did not, over its hits.
LEAST_OVER_POINT, MOST_MISSED = 15.0, 0.2
#: A column is suspected if the odds that there is one exceed this; of things that stand alone so
#: many are columns, beside those that were found.
SUSPECT_ODDS, MAY_BE_COLUMNS = 0.05, 0.5
#: What its radius may be, m, and shares of columns.
SUSPECT_RADII_M, RADIUS_SHARES = (0.12, 0.18, 0.25, 0.32), (0.28, 0.38, 0.26, 0.08)
#: A column may be larger than it was found to be if its log-likelihood ratio is less by this.
MAY_BE_LARGER = 2.0
#: Lone cells lie within the first distance of the one that is believed most, and no others within
#: the second one, m; their echoes are so far from their ranges, m, at the most.
LONE_M, APART_M, OWN_M = 0.25, 0.4, 0.04


def columns_instead(
    ping_set: PingSet,
    is_open: BoolArray,
    may_be: BoolArray,
    lone_cells_m: Sequence[FloatArray],
    certain: int,
) -> list[RoundColumn]:
    """Columns in place of cells which stand alone.

    Parameters
    ----------
    ping_set : PingSet
        Pings.
    is_open, may_be : (echoes,) bool arrays
        Echoes that nothing explains, and those that cells may explain, too.
    lone_cells_m : sequence of (cells, 2) arrays
        Middles of cells, of one thing each; see `lone_cells`.
    certain : int
        Columns that were found without.
    """
    is_open, may_be, found = is_open.copy(), may_be.copy(), list[RoundColumn]()

    def fitted(begun: Begun, cells_m: FloatArray) -> Fits:
        return _over_point_at(cells_m, begun, ping_set, is_open, may_be)

    def take(cells_m: FloatArray, fits: Fits) -> bool:
        over, best = max(fits, key=lambda fit: fit[0])
        if not best or over <= LEAST_OVER_POINT or not _is_heard_well(best):
            return False
        found.append(RoundColumn.of(best, True, ping_set))
        is_open[best.echoes] = may_be[best.echoes] = False
        return True

    in_turn(partial(fitted, [(radius_m, DESCENT) for radius_m in RADII_M]), lone_cells_m, take)
    share = (certain + len(found) + MAY_BE_COLUMNS) / (len(lone_cells_m) + certain + 1)
    fixed = [(radius_m, _of_radius(radius_m)) for radius_m in SUSPECT_RADII_M]
    for fits in for_each(partial(fitted, fixed), lone_cells_m):
        odds, largest = _odds(share, fits)
        if largest:
            suspected = RoundColumn.of(largest, False, ping_set)
            found.append(replace(suspected, likely=odds / (1.0 + odds)))
    return found


def larger_columns(columns: Sequence[RoundColumn], ping_set: PingSet) -> list[RoundColumn]:
    """The largest one that each of some columns may be as well, if it is larger: only suspected.

    Of one that was heard from one side, nobody knows how far it goes.
    """
    largest = (_largest(column, ping_set) for column in columns)
    return [RoundColumn.of(circle, False, ping_set) for circle in largest if circle]


def lone_cells(is_reliable: BoolArray, log_odds: FloatArray, field: Field) -> list[FloatArray]:
    """Middles of reliable cells, m, of each small thing that stands alone.

    Parameters
    ----------
    is_reliable : (rows, columns) bool array
        Those.
    log_odds : (rows, columns) array
        Of all cells.
    field : Field
        The cells.
    """
    rows, columns = np.nonzero(is_reliable)
    places_m = (
        np.column_stack([field.first_column + columns + 0.5, field.first_row + rows + 0.5])
        * field.resolution_m
    )
    is_left, things = np.ones(len(rows), bool), list[FloatArray]()
    for index in np.argsort(-log_odds[rows, columns], kind="stable"):
        if not is_left[index]:
            continue
        away_m = np.hypot(*(places_m - places_m[index]).T)
        is_near = away_m <= LONE_M
        is_left[is_near] = False
        if not np.any(~is_near & (away_m < APART_M)):
            things.append(places_m[is_near])
    return things


def _over_point_at(
    cells_m: FloatArray,
    begun: Begun,
    ping_set: PingSet,
    is_open: BoolArray,
    may_be: BoolArray,
) -> Fits:
    """By how much likelier than a point circles are that some cells are the near side of.

    One for each radius that a fit begins with, by its descent.
    """
    own, towards = echoes_of(cells_m, ping_set)
    is_open_now = is_open | (own & may_be)
    middle_m = cells_m.mean(axis=0)
    point = fitted_circle(ping_set, is_open_now, np.append(middle_m, 0.0), TO_POINT)
    circles = [
        fitted_circle(
            ping_set, is_open_now, np.append(middle_m + radius_m * towards, radius_m), descent
        )
        for radius_m, descent in begun
    ]
    return [
        (_over_point(circle, point, ping_set), circle)
        if circle and circle.misses < MOST_MISSED * len(circle.pings)
        else (-math.inf, None)
        for circle in circles
    ]


def _odds(share: float, fits: Fits) -> tuple[float, Circle | None]:
    """Odds that there is a column, and the largest one that there may be.

    Parameters
    ----------
    share : float
        Of things that are columns.
    fits : list of (float, Circle)
        By how much likelier than a point each is, for each of `SUSPECT_RADII_M`.
    """
    odds, largest = 0.0, None
    # The largest one covers the others, whose near sides are where its own is.
    for (over, circle), of_radius in zip(reversed(fits), reversed(RADIUS_SHARES), strict=True):
        # What is certain is not more so: exponentials grow out of bounds.
        odds += share * of_radius * math.exp(min(over, LEAST_OVER_POINT))
        if odds > SUSPECT_ODDS:
            largest = largest or circle
    return odds, largest


def _largest(column: RoundColumn, ping_set: PingSet) -> Circle | None:
    """The largest circle that is hardly less likely than a column, if it is larger."""
    own = np.zeros(len(ping_set.echoes.range_m), bool)
    own[column.echoes] = True
    middle_m = np.array([column.x_m, column.y_m])
    places_m = ping_set.table.numbers[ping_set.pings[column.pings]][:, [X, Y]]
    towards = (middle_m - places_m).mean(axis=0)
    towards /= max(float(np.hypot(*towards)), 1e-9)

    def fitted(radius_m: float) -> Circle | None:
        place = np.append(middle_m + (radius_m - column.radius_m) * towards, radius_m)
        return fitted_circle(ping_set, own, place, _of_radius(radius_m))

    as_found = fitted(column.radius_m)
    for radius_m in reversed(SUSPECT_RADII_M):
        if as_found is None or radius_m <= column.radius_m:
            break
        circle = fitted(radius_m)
        if circle and circle.log_ratio > as_found.log_ratio - MAY_BE_LARGER:
            return circle
    return None


def _of_radius(radius_m: float) -> LevenbergMarquardt:
    """The descent to circles of one radius."""
    return LevenbergMarquardt(15, MIDDLE_ALONE, usual_radius_m=radius_m)


def _over_point(circle: Circle, point: Circle | None, ping_set: PingSet) -> float:
    """By how much likelier a circle is than any point, by its log-likelihood ratio.

    Hits of the point from which the circle's middle is at the edge of the beam speak for neither.
    """
    of_all_hits = 0.0
    if point:
        numbers = ping_set.table.numbers[ping_set.pings[point.pings]]
        to_middle = np.array([circle.x_m, circle.y_m]) - numbers[:, [X, Y]]
        in_beam = _share_of_beam(to_middle, numbers)
        at_edge = (in_beam >= LOOKING_SHARE) & (in_beam < 1.0)
        of_all_hits = point.log_ratio * (1.0 - float(at_edge.mean()))
    return circle.log_ratio - max(of_all_hits, log_ratio_of_point(ping_set, circle))


def _is_heard_well(circle: Circle) -> bool:
    """Whether a circle was heard often enough, from whatever side, and is no corner.

    What a corner's circle covers lies behind its walls: it may as well be suspected.
    """
    hits = len(circle.pings)
    least = max(LEAST_LOG_RATIO, SUSPECT_LOG_RATIO_A_HIT * hits)
    return hits >= LEAST_HITS and circle.log_ratio >= least and not circle.is_corner


def echoes_of(cells_m: FloatArray, ping_set: PingSet) -> tuple[BoolArray, FloatArray]:
    """Which echoes may be of some cells; and the mean direction of those who heard them.

    Parameters
    ----------
    cells_m : (cells, 2) array
        Their middles.
    ping_set : PingSet
        Pings.

    Returns
    -------
    own : (echoes,) bool array
        Which may be of them.
    towards : (2,) array
        A unit vector.
    """
    table, pings, echoes, _ = ping_set
    numbers = table.numbers[pings]
    offsets = cells_m - numbers[:, np.newaxis, [X, Y]]
    away_m, middle = np.hypot(offsets[..., 0], offsets[..., 1]), offsets.mean(axis=1)
    is_ahead = _share_of_beam(middle, numbers) < 1.0
    of = np.repeat(np.arange(len(pings)), np.diff(echoes.start))
    own: BoolArray = is_ahead[of]
    own &= echoes.range_m > (away_m.min(axis=1) - OWN_M)[of]
    own &= echoes.range_m < (away_m.max(axis=1) + OWN_M)[of]
    towards = (middle / np.hypot(*middle.T)[:, np.newaxis])[of[own]].sum(axis=0)
    return own, towards / max(float(np.hypot(*towards)), 1e-9)


def _share_of_beam(offsets_m: FloatArray, numbers: FloatArray) -> FloatArray:
    """How far off their axes pings have places, from themselves, over half of their beams."""
    off_rad = wrapped(np.arctan2(offsets_m[:, 1], offsets_m[:, 0]) - numbers[:, HEADING])
    return np.asarray(np.abs(off_rad) / numbers[:, HALF_ANGLE])
