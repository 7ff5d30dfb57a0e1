"""Points that stand alone, where ranges alone tell which cell they are in.

Cells weigh a ping by range bins and by how wide they are, so that an arc of them explains what is
heard from far off along a nearly straight way, and none of them is shown.  Ranges are ten times as
fine: where one point explains echoes that no reliable cell does, and no other point on its arc
explains them nearly as well, it is shown.  Where the way was straight, its mirror image explains
them as well, and neither is.
"""

import math
from collections.abc import Sequence

import numpy as np

from usmap_ros.mapping.joint.surfaces.column_fits import Circle, PingSet, fitted_circle
from usmap_ros.mapping.joint.surfaces.lone_columns import TO_POINT, echoes_of
from usmap_ros.mapping.joint.surfaces.round_columns import candidates, tell_columns
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.ping_table import HALF_ANGLE, HEADING, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.processes.threads import for_each

#: Log-likelihood ratio to echoes by chance, and hits, that a point has at least; and misses over
#: hits at the most, beside one.
LEAST_LOG_RATIO, LEAST_HITS, MOST_MISSES = 28.0, 6, 0.2
#: Steps along an arc, m; points that explain such a share of the same echoes are compared; how sure
#: it must be that the right one is within some distance, m, of the likeliest.
STEP_M, SAME_SHARE, SURE, WITHIN_M = 0.06, 0.5, 0.9, 0.075
#: Points are the same that are no farther apart, m.
SAME_M = 0.02
#: Share of echoes, of those that a likelier one has, at which a point is not looked at.
TAKEN_SHARE = 0.3


def lone_points(
    ping_set: PingSet,
    is_open: BoolArray,
    may_be: BoolArray,
    lone_cells_m: Sequence[FloatArray],
    field: Field,
) -> FloatArray:
    """Points that stand alone.

    Parameters
    ----------
    ping_set : PingSet
        Pings.
    is_open, may_be : (echoes,) bool arrays
        Echoes that nothing explains, and those that cells may explain, too.
    lone_cells_m : sequence of (cells, 2) arrays
        Middles of cells, of one thing each, as
        `usmap_ros.mapping.joint.surfaces.lone_columns.lone_cells` gives them: where they are far
        apart, ranges tell which of them it is in.
    field : Field
        The cells, which are begun with.

    Returns
    -------
    points_m : (points, 2) array
        Where they are.
    """
    tell = tell_columns(ping_set)
    is_open, found = is_open & tell, list[Circle]()
    begun_m = np.array([place[:2] for place in candidates(ping_set, is_open, field, [0.0])])
    for point in _points_near(begun_m.reshape(-1, 2), ping_set, is_open):
        if point.log_ratio < LEAST_LOG_RATIO:
            break
        if is_open[point.echoes].mean() >= 1.0 - TAKEN_SHARE:
            best, is_sure = _best_of_arc(point, ping_set, is_open)
            is_open[best.echoes] = False
            found += [best] * is_sure
    for cells_m in filter(_are_far_apart, lone_cells_m):
        own, _ = echoes_of(cells_m, ping_set)
        may_be_here = (is_open | (own & may_be)) & tell
        for point in _points_near(cells_m, ping_set, may_be_here)[:1]:
            best, is_sure = _best_of_arc(point, ping_set, may_be_here)
            found += [best] * is_sure
    return np.array([(point.x_m, point.y_m) for point in found]).reshape(-1, 2)


def _are_far_apart(cells_m: FloatArray) -> bool:
    """Whether some cells of one thing are no neighbours."""
    return float(np.ptp(cells_m, axis=0).max()) > WITHIN_M


def _best_of_arc(point: Circle, ping_set: PingSet, is_open: BoolArray) -> tuple[Circle, bool]:
    """The likeliest point on the arc of one; and whether it was heard well, and no other is it."""
    arc = [point, *_points_near(_arc_m(point, ping_set), ping_set, is_open)]
    best = max(arc, key=lambda other: other.log_ratio)
    return best, _is_heard_well(best) and _is_alone(best, arc)


def _points_near(places_m: FloatArray, ping_set: PingSet, is_open: BoolArray) -> list[Circle]:
    """Points that fit echoes best near some places, the likeliest first, and none twice."""
    fits = for_each(
        lambda place_m: fitted_circle(ping_set, is_open, np.append(place_m, 0.0), TO_POINT),
        places_m,
    )
    found: dict[tuple[int, int], Circle] = {}
    for fit in filter(None, fits):
        place = round(fit.x_m / SAME_M), round(fit.y_m / SAME_M)
        found[place] = max(fit, found.get(place, fit), key=lambda fit: fit.log_ratio)
    return sorted(found.values(), key=lambda fit: -fit.log_ratio)


def _arc_m(circle: Circle, ping_set: PingSet) -> FloatArray:
    """Places that are as far from a point's middle ping as its echo tells, within the beam."""
    middle = len(circle.pings) // 2
    numbers = ping_set.table.numbers[ping_set.pings[circle.pings[middle]]]
    range_m = ping_set.echoes.range_m[circle.echoes[middle]]
    bearings_rad = numbers[HEADING] + np.arange(
        -numbers[HALF_ANGLE], numbers[HALF_ANGLE], STEP_M / range_m
    )
    around = np.column_stack([np.cos(bearings_rad), np.sin(bearings_rad)])
    return np.asarray(numbers[[X, Y]] + range_m * around, np.float64)


def _is_heard_well(point: Circle) -> bool:
    """Whether a point was heard often enough, and seldom missed."""
    hits = len(point.pings)
    is_likely = point.log_ratio >= LEAST_LOG_RATIO and hits >= LEAST_HITS
    return is_likely and point.misses <= MOST_MISSES * hits + 1.0


def _is_alone(best: Circle, arc: list[Circle]) -> bool:
    """Whether no other point on the arc of the likeliest one explains what it does as well."""
    near, far = 0.0, 0.0
    for other in arc:
        if np.isin(other.echoes, best.echoes).mean() < SAME_SHARE:
            continue
        likely = math.exp(other.log_ratio - best.log_ratio)
        if math.hypot(other.x_m - best.x_m, other.y_m - best.y_m) <= WITHIN_M:
            near += likely
        else:
            far += likely
    return near >= SURE * (near + far)
