"""Columns that are alike tell of each other, though none is certain by itself."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from usmap_ros.mapping.joint.leave_one_out import kept_pings
from usmap_ros.mapping.joint.surfaces.alike_columns import (
    SEVERAL,
    columns_of_place,
    several_alike,
)
from usmap_ros.mapping.joint.surfaces.column_fits import Circle, PingSet
from usmap_ros.mapping.joint.surfaces.round_column import RoundColumn
from usmap_ros.mapping.joint.surfaces.round_columns import round_columns
from usmap_ros.mapping.joint.visibility.field import Field, field_around
from usmap_ros.mapping.joint.visibility.ray_casting import RAYS, STEPS, WHOLE
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

RADIUS_M, APART_M = 0.15, 3.0


def circle(x_m: float, radius_m: float = RADIUS_M, log_ratio: float = 30.0) -> Circle:
    every = np.arange(20)
    return Circle(x_m, 0.0, radius_m, every, every, 0, 0.3, log_ratio, is_corner=False)


def certain(x_m: float, radius_m: float = RADIUS_M) -> RoundColumn:
    nothing = np.zeros(0, np.int64)
    return RoundColumn(x_m, 0.0, radius_m, nothing, nothing, is_certain=True)


def test_several_faint_columns_of_one_radius_are_some() -> None:
    faint = [circle(APART_M * number) for number in range(SEVERAL)]
    assert several_alike([], faint) == faint
    assert several_alike([], faint[1:]) is None
    assert several_alike([certain(-APART_M)], faint[1:]) == faint[1:]
    assert several_alike([certain(-APART_M * number) for number in range(SEVERAL)], []) == []


def test_columns_of_other_radii_do_not_count() -> None:
    faint = [circle(APART_M * number) for number in range(SEVERAL - 1)]
    assert several_alike([], [*faint, circle(-APART_M, 2.0 * RADIUS_M)]) is None


def test_what_overlaps_counts_once() -> None:
    """One column fits with several radii and middles; the likeliest is it."""
    faint = [circle(APART_M * number) for number in range(SEVERAL - 1)]
    again = circle(0.1, log_ratio=40.0)
    assert several_alike([], [*faint, again]) is None
    others = circle(-APART_M)
    assert several_alike([], [*faint, again, others]) == [again, *faint[1:], others]


def heard_among_others(
    make_cone: Callable[..., EchoCone], columns: int, off_m: float
) -> tuple[PingSet, Field]:
    """Columns in a row, each heard from around, among twelve echoes of anything in each ping."""
    cones, rng = list[EchoCone](), np.random.default_rng(3)
    for number, bearing_rad in enumerate(np.tile(np.linspace(0.0, 5.0, 26), columns)):
        middle_m, away_m = APART_M * (number // 26), 0.9 + 0.2 * math.sin(2.3 * number)
        x_m, y_m = middle_m + away_m * math.cos(bearing_rad), away_m * math.sin(bearing_rad)
        range_m = away_m - RADIUS_M + off_m * rng.uniform(-1.0, 1.0)
        others = [(float(other_m), 0.15) for other_m in rng.uniform(0.3, 1.5, 12)]
        pose = {"x_m": x_m, "y_m": y_m, "yaw_rad": bearing_rad + math.pi}
        cones.append(make_cone(*sorted([(range_m, 0.15), *others]), stamp_ns=number, **pose))
    table, rows, _, echoes = kept_pings({"robot": cones}, MappingParameters()).pings()[:4]
    left = np.full((len(rows), RAYS, STEPS), WHOLE, np.uint8)
    return PingSet(table, rows, echoes, left), field_around(table, rows, 0.05)


@pytest.mark.parametrize("columns", [SEVERAL, 1])
def test_columns_among_much_else_are_found_together(
    make_cone: Callable[..., EchoCone], columns: int
) -> None:
    ping_set, field = heard_among_others(make_cone, columns, 0.007)
    nothing = np.zeros(len(ping_set.echoes.range_m), bool)
    alone = [one for one in round_columns(ping_set, nothing, field).columns if one.is_certain]
    found = [one for one in columns_of_place(ping_set, nothing, ~nothing, field) if one.is_certain]
    middles_m = sorted(one.x_m for one in found)
    if columns == 1:
        assert len(found) == len(alone) == 0
    else:
        assert len(alone) < SEVERAL
        assert middles_m == pytest.approx([APART_M * number for number in range(SEVERAL)], abs=0.05)
        assert all(one.radius_m == pytest.approx(RADIUS_M, abs=0.03) for one in found)
