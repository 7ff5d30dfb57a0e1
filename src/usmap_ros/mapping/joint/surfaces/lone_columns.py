"""Round columns in place of lone cells.

A column that was heard from one side is nearly a point: the cell nearest to its listeners explains
its echoes, each with a small error, and all around that cell would be free.  A circle explains them
better, and by how much tells a column from a pole.
"""

from collections.abc import Sequence

import numpy as np

from usmap_ros.mapping.joint.surfaces.column_fits import (
    RANGE_STD_M,
    Circle,
    LevenbergMarquardt,
    PingSet,
    fitted_circle,
    log_ratio_of_point,
)
from usmap_ros.mapping.joint.surfaces.round_columns import (
    LEAST_HITS,
    LEAST_LOG_RATIO,
    SUSPECT_LOG_RATIO_A_HIT,
    RoundColumn,
)
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.ping_table import HALF_ANGLE, HEADING, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.geometry import wrapped

#: Radii that fits begin with, m; what few directions tell of a radius is little, and most columns'
#: are 0.18 +- 0.08 m.
RADII_M = (0.12, 0.25)
DESCENT = LevenbergMarquardt(
    15, np.array([1e-3, 1e-3, (RANGE_STD_M / 0.08) ** 2]), usual_radius_m=0.18
)
#: To the point that explains most.
TO_POINT = LevenbergMarquardt(5, np.array([1e-3, 1e-3, 1.0]), radii_m=(0.0, 0.0))
#: How much likelier than a point a column is, by its log-likelihood ratio, and the most pings that
#: should have heard it but did not, over its hits.
LEAST_OVER_POINT, MOST_MISSED = 15.0, 0.2
#: The first at which a column is suspected.
SUSPECT_OVER_POINT = 6.0
#: Lone cells lie within the first distance of the one that is believed most, and no others within
#: the second one, m; their echoes are so far from their ranges, m, at the most.
LONE_M, APART_M, OWN_M = 0.25, 0.4, 0.04


def columns_instead(
    ping_set: PingSet,
    is_open: BoolArray,
    may_be: BoolArray,
    lone_cells_m: Sequence[FloatArray],
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
    """
    is_open, may_be, found = is_open.copy(), may_be.copy(), list[RoundColumn]()
    for cells_m in lone_cells_m:
        own, towards = _echoes_of(cells_m, ping_set)
        is_open_now = is_open | (own & may_be)
        middle_m = cells_m.mean(axis=0)
        point = fitted_circle(ping_set, is_open_now, np.append(middle_m, 0.0), TO_POINT)
        circles = [
            fitted_circle(ping_set, is_open_now, place, DESCENT)
            for radius_m in RADII_M
            for place in [np.append(middle_m + radius_m * towards, radius_m)]
        ]
        over_point = {
            _over_point(circle, point, ping_set): circle
            for circle in circles
            if circle and _may_be_round(circle)
        }
        most = max(over_point, default=0.0)
        if most > SUSPECT_OVER_POINT:
            best, is_certain = over_point[most], most > LEAST_OVER_POINT
            found.append(RoundColumn.of(best, is_certain, ping_set))
            if is_certain:
                is_open[best.echoes] = may_be[best.echoes] = False
    return found


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


def _over_point(circle: Circle, point: Circle | None, ping_set: PingSet) -> float:
    """By how much likelier a circle is than any point, by its log-likelihood ratio."""
    of_all_hits = point.log_ratio if point else 0.0
    return circle.log_ratio - max(of_all_hits, log_ratio_of_point(ping_set, circle))


def _may_be_round(circle: Circle) -> bool:
    """Whether a circle was heard often enough, from whatever side."""
    hits = len(circle.pings)
    return (
        hits >= LEAST_HITS
        and circle.log_ratio >= max(LEAST_LOG_RATIO, SUSPECT_LOG_RATIO_A_HIT * hits)
        and circle.misses < MOST_MISSED * hits
        and not circle.is_corner
    )


def _echoes_of(cells_m: FloatArray, ping_set: PingSet) -> tuple[BoolArray, FloatArray]:
    """Which echoes may be of some cells; and the mean direction of those who heard them."""
    table, pings, echoes, _ = ping_set
    numbers = table.numbers[pings]
    offsets = cells_m - numbers[:, np.newaxis, [X, Y]]
    away_m, middle = np.hypot(offsets[..., 0], offsets[..., 1]), offsets.mean(axis=1)
    off_rad = wrapped(np.arctan2(middle[:, 1], middle[:, 0]) - numbers[:, HEADING])
    is_ahead = np.abs(off_rad) < numbers[:, HALF_ANGLE]
    of = np.repeat(np.arange(len(pings)), np.diff(echoes.start))
    own: BoolArray = is_ahead[of]
    own &= echoes.range_m > (away_m.min(axis=1) - OWN_M)[of]
    own &= echoes.range_m < (away_m.max(axis=1) + OWN_M)[of]
    towards = (middle / np.hypot(*middle.T)[:, np.newaxis])[of[own]].sum(axis=0)
    return own, towards / max(float(np.hypot(*towards)), 1e-9)
