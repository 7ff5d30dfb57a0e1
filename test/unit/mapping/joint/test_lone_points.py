"""Points that ranges tell, where cells do not."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from usmap_ros.grids import OCCUPIED_PROBABILITY
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.joint.leave_one_out import kept_pings
from usmap_ros.mapping.joint.surfaces.column_fits import PingSet
from usmap_ros.mapping.joint.surfaces.lone_points import LEAST_HITS, lone_points
from usmap_ros.mapping.joint.visibility.field import field_around
from usmap_ros.mapping.joint.visibility.ray_casting import RAYS, STEPS, WHOLE
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Where a pole stands, m.
POLE_M = (3.8, 0.9)


def on_a_way(
    make_cone: Callable[..., EchoCone],
    bend_per_m: float,
    count: int = 12,
) -> list[EchoCone]:
    """Pings of a robot that drives ahead on a way that bends, each with an echo of a pole."""
    cones = []
    for number in range(count):
        x_m = 0.1 * number
        y_m, yaw_rad = bend_per_m * x_m**2, math.atan(2.0 * bend_per_m * x_m)
        range_m = math.hypot(POLE_M[0] - x_m, POLE_M[1] - y_m) + 0.001 * (-1.0) ** number
        pose = {"x_m": x_m, "y_m": y_m, "yaw_rad": yaw_rad}
        cones.append(make_cone((range_m, 0.02), stamp_ns=number, max_range_m=5.0, **pose))
    return cones


def points_of(
    cones: list[EchoCone], lone_cells_m: list[tuple[float, float]] | None = None
) -> FloatArray:
    """Points by all echoes, or by those that cells of one thing explain."""
    table, rows, _, echoes = kept_pings({"robot": cones}, MappingParameters()).pings()[:4]
    left = np.full((len(rows), RAYS, STEPS), WHOLE, np.uint8)
    every = np.ones(len(echoes.range_m), bool)
    ping_set, field = PingSet(table, rows, echoes, left), field_around(table, rows, 0.05)
    if lone_cells_m is None:
        return lone_points(ping_set, every, every, [], field)
    return lone_points(ping_set, ~every, every, [np.array(lone_cells_m)], field)


def test_ranges_tell_where_a_far_pole_is_if_the_way_bends(
    make_cone: Callable[..., EchoCone],
) -> None:
    (point_m,) = points_of(on_a_way(make_cone, 0.3))
    assert point_m == pytest.approx(POLE_M, abs=0.05)


def test_what_is_heard_on_a_straight_way_may_be_on_either_side(
    make_cone: Callable[..., EchoCone],
) -> None:
    assert len(points_of(on_a_way(make_cone, 0.0))) == 0


def test_few_pings_tell_no_point(make_cone: Callable[..., EchoCone]) -> None:
    assert len(points_of(on_a_way(make_cone, 0.3, LEAST_HITS - 1))) == 0


def test_ranges_tell_which_of_some_cells_a_pole_is_in(make_cone: Callable[..., EchoCone]) -> None:
    """The cell that was believed most was a decimetre off."""
    cones, (x_m, y_m) = on_a_way(make_cone, 0.3), POLE_M
    (point_m,) = points_of(cones, [(x_m - 0.02, y_m + 0.12), (x_m, y_m + 0.02)])
    assert point_m == pytest.approx(POLE_M, abs=0.05)
    assert len(points_of(cones, [(x_m, y_m + 0.07), (x_m, y_m + 0.02)])) == 0


def test_a_far_pole_is_in_the_map(make_cone: Callable[..., EchoCone]) -> None:
    """An arc of cells explained what was heard of it, and none of them was shown."""
    fusion = JointFusion(MappingParameters())
    for cone in on_a_way(make_cone, 0.3):
        fusion.fuse(cone, "robot")
    occupancy = fusion.occupancy_map()
    rows, columns = np.nonzero(
        occupancy.observed & (occupancy.probability() >= OCCUPIED_PROBABILITY)
    )
    places_m = occupancy.geometry.cell_centers_m(rows, columns)
    assert len(places_m)
    assert np.abs(places_m - POLE_M).max() < 0.1
