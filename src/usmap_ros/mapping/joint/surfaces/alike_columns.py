"""Columns of a place that are alike: several that are heard faintly tell of each other.

Where much else is heard around columns, or cells explain some of what they return, no circle is
much likelier than chance by itself.  But columns of one place are mostly alike, and chance is not:
where several circles have much the same radius, each of them is one, and others like them are
looked for among all echoes.
"""

import math
from collections.abc import Sequence

import numpy as np

from usmap_ros.mapping.joint.surfaces.column_fits import (
    RANGE_STD_M,
    Circle,
    LevenbergMarquardt,
    PingSet,
    fitted_circle,
)
from usmap_ros.mapping.joint.surfaces.mirror_walls import left_of
from usmap_ros.mapping.joint.surfaces.round_column import RoundColumn, overlaps_any
from usmap_ros.mapping.joint.surfaces.round_columns import (
    candidates,
    is_faint,
    round_columns,
    tell_columns,
)
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: So many columns of one place, faint ones among them, tell of each other.
SEVERAL = 4
#: Logarithms of radii of those that are alike differ from the usual one by less: of faint ones as
#: they were found, and of others that are looked for by it.
ALIKE, AS_ALIKE = 0.35, 0.2
#: By how much likelier others are than two points: pieces of walls are by less.
OTHERS_OVER_TWO_POINTS = 26.0
#: How much radii of those that are alike differ, m.
RADII_DIFFER_M = 0.04


def columns_of_place(
    ping_set: PingSet, is_explained: BoolArray, is_usable: BoolArray, field: Field
) -> list[RoundColumn]:
    """Columns of a place, suspected ones among them.

    Parameters
    ----------
    ping_set : PingSet
        Pings.
    is_explained : (echoes,) bool array
        Whether cells or mirrors explain an echo.
    is_usable : (echoes,) bool array
        Whether an echo may be of a column, though cells explain it.
    field : Field
        The cells.
    """
    columns, faint = round_columns(ping_set, is_explained, field)
    certain = [column for column in columns if column.is_certain]
    alike = several_alike(certain, faint)
    if alike is None:
        return columns
    search = _Search(ping_set, is_usable & tell_columns(ping_set), field, certain)
    search.take(alike)
    search.take(search.others())
    more = search.found[len(certain) :]
    return [each for each in columns if each.is_certain or not each.overlaps_any(more)] + more


def several_alike(certain: list[RoundColumn], faint: list[Circle]) -> list[Circle] | None:
    """Faint circles that are like most columns of the place, if those are several together.

    Parameters
    ----------
    certain : list of RoundColumn
        Columns that were found.
    faint : list of Circle
        What may be others; of those that overlap the likeliest counts.

    Returns
    -------
    alike : list of Circle, optional
        The likeliest first; None where too few columns are alike to tell of others.
    """
    apart: list[Circle] = []
    for circle in sorted(faint, key=lambda circle: -circle.log_ratio):
        if not overlaps_any(*circle[:3], (*certain, *apart)):
            apart.append(circle)
    if len(certain) + len(apart) < SEVERAL:
        return None
    usual_m = _usual_radius_m([*certain, *apart])
    alike = [circle for circle in apart if _is_like(circle, usual_m, ALIKE)]
    others = sum(_is_like(column, usual_m, ALIKE) for column in certain)
    return alike if len(alike) + others >= SEVERAL else None


class _Search:
    """Columns that are like others; arguments as of `columns_of_place`."""

    def __init__(
        self, ping_set: PingSet, is_open: BoolArray, field: Field, certain: list[RoundColumn]
    ) -> None:
        self._ping_set, self._field = ping_set, field
        self._is_open, self.found = left_of(is_open, certain), list(certain)

    def take(self, circles: list[Circle]) -> None:
        """Take circles for columns, each by all its echoes, unless others are where it would be."""
        usual_m = _usual_radius_m([*self.found, *circles])
        for circle in circles:
            again = self._fitted(np.array([circle.x_m, circle.y_m, usual_m]), usual_m)
            fits = [again, circle] if again and again.log_ratio > circle.log_ratio else [circle]
            best = next((fit for fit in fits if not overlaps_any(*fit[:3], self.found)), None)
            if best:
                self.found.append(RoundColumn.of(best, True, self._ping_set))
                self._is_open[best.echoes] = False

    def others(self) -> list[Circle]:
        """Circles that are like those that were found, the likeliest first."""
        usual_m, like = _usual_radius_m(self.found), list[Circle]()
        for x_m, y_m, _ in candidates(self._ping_set, self._is_open, self._field, [usual_m]):
            circle = self._fitted(np.array([x_m, y_m, usual_m]), usual_m)
            if (
                circle
                and _is_like(circle, usual_m, AS_ALIKE)
                and is_faint(circle, self._ping_set, OTHERS_OVER_TWO_POINTS)
            ):
                like.append(circle)
        return sorted(like, key=lambda circle: -circle.log_ratio)

    def _fitted(self, place: FloatArray, usual_m: float) -> Circle | None:
        damping = np.array([1e-3, 1e-3, (RANGE_STD_M / RADII_DIFFER_M) ** 2])
        descent = LevenbergMarquardt(15, damping, usual_radius_m=usual_m)
        return fitted_circle(self._ping_set, self._is_open, place, descent)


def _usual_radius_m(columns: Sequence[RoundColumn | Circle]) -> float:
    return float(np.median([column.radius_m for column in columns]))


def _is_like(column: RoundColumn | Circle, usual_m: float, alike: float) -> bool:
    """Whether a radius is nearly the usual one."""
    return abs(math.log(column.radius_m / usual_m)) < alike
