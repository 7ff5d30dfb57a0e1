"""Round columns, which answer each view from their nearest point, and what explained echoes say."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.mapping.joint.free_space.response import MOST_EXPLAINED, listen
from usmap_ros.mapping.joint.leave_one_out import kept_pings
from usmap_ros.mapping.joint.surfaces.column_fits import (
    CROWD_M,
    Circle,
    PingSet,
    log_ratio_of_point,
)
from usmap_ros.mapping.joint.surfaces.lone_columns import (
    columns_instead,
    larger_columns,
    lone_cells,
)
from usmap_ros.mapping.joint.surfaces.round_column import RoundColumn, discs, without_pairs
from usmap_ros.mapping.joint.surfaces.round_columns import round_columns
from usmap_ros.mapping.joint.surfaces.smooth_surfaces import SmoothSurfaces
from usmap_ros.mapping.joint.visibility.field import Field, field_around
from usmap_ros.mapping.joint.visibility.ray_casting import RAYS, STEPS, WHOLE
from usmap_ros.mapping.ping_bins import ECHO
from usmap_ros.mapping.ping_table import NOISE
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Where a column stands, and its radius, m.
X_M, Y_M, RADIUS_M = 0.42, -0.13, 0.2
NO_PINGS = np.zeros(0, np.int64)
#: No echo is of a sensor that reports the first thing only.
NOT_FIRST = np.zeros(1000, bool)


def pings_around(
    make_cone: Callable[..., EchoCone],
    first_rad: float,
    last_rad: float,
    count: int,
    error_m: float,
    radius_m: float = RADIUS_M,
    *others_m: float,
    pose_std_m: float = 0.0,
) -> list[EchoCone]:
    """Pings that look at the column, each with its echo, errors of its range, and others off it."""
    cones, rng = [], np.random.default_rng(5)
    covariance = np.diag([pose_std_m**2, pose_std_m**2, 0.0])
    for number, bearing_rad in enumerate(np.linspace(first_rad, last_rad, count)):
        away_m = 1.1 + 0.3 * math.sin(2.3 * number)
        x_m, y_m = X_M + away_m * math.cos(bearing_rad), Y_M + away_m * math.sin(bearing_rad)
        echo = away_m - radius_m + error_m * rng.uniform(-1.0, 1.0), 0.15
        others = [(echo[0] + off_m * rng.uniform(0.7, 1.3), 0.15) for off_m in others_m]
        yaw_rad = bearing_rad + math.pi
        pose = {"x_m": x_m, "y_m": y_m, "yaw_rad": yaw_rad}
        pose["x_m"] += pose_std_m * rng.normal()
        pose["y_m"] += pose_std_m * rng.normal()
        echoes = sorted([echo, *others])
        cones.append(make_cone(*echoes, stamp_ns=number, planar_covariance=covariance, **pose))
    return cones


def heard(cones: list[EchoCone]) -> tuple[PingSet, Field]:
    """What some pings heard, where nothing holds sound back, and cells around."""
    table, rows, _, echoes = kept_pings({"robot": cones}, MappingParameters()).pings()[:4]
    left = np.full((len(rows), RAYS, STEPS), WHOLE, np.uint8)
    return PingSet(table, rows, echoes, left), field_around(table, rows, 0.05)


def columns_of(cones: list[EchoCone]) -> list[RoundColumn]:
    ping_set, field = heard(cones)
    return round_columns(ping_set, np.zeros(len(ping_set.echoes.range_m), bool), field).columns


def columns_instead_of(
    cell_m: tuple[float, float], cones: list[EchoCone], certain: int = 0
) -> list[RoundColumn]:
    """Columns in place of a cell that explains all echoes, of 60; so many are certain."""
    ping_set, _ = heard(cones)
    none = np.zeros(len(ping_set.echoes.range_m), bool)
    others = [np.array([[100.0 + number, 100.0]]) for number in range(59)]
    return columns_instead(ping_set, none, ~none, [np.array([cell_m]), *others], certain)


def test_a_column_is_found_from_around(make_cone: Callable[..., EchoCone]) -> None:
    (column,) = columns_of(pings_around(make_cone, 0.0, 4.0, 24, 0.003))
    assert column.is_certain
    found = column.x_m, column.y_m, column.radius_m
    assert found == pytest.approx((X_M, Y_M, RADIUS_M), abs=0.02)


def test_a_column_is_found_from_uncertain_poses(make_cone: Callable[..., EchoCone]) -> None:
    """As every localisation's are: without it, what is round would be called free."""
    (column,) = columns_of(pings_around(make_cone, 0.0, 4.0, 60, 0.003, pose_std_m=0.02))
    assert column.is_certain
    found = column.x_m, column.y_m, column.radius_m
    assert found == pytest.approx((X_M, Y_M, RADIUS_M), abs=0.03)


def test_an_echo_may_be_far_from_where_a_column_should_be_heard(
    make_cone: Callable[..., EchoCone],
) -> None:
    """By poses that are very uncertain: there were fewer than no others around such an echo."""
    ping_set, _ = heard(pings_around(make_cone, 0.0, 4.0, 10, 0.0))
    every = np.arange(10)
    far = Circle(
        X_M, Y_M, RADIUS_M + 1.1 * CROWD_M, every, every, misses=0, spread=0.3, log_ratio=0.0,
        is_corner=False,
    )  # fmt: skip
    assert math.isfinite(log_ratio_of_point(ping_set, far))


def test_a_pole_from_uncertain_poses_is_no_column(make_cone: Callable[..., EchoCone]) -> None:
    for last_rad in (1.6, 4.0):
        cones = pings_around(make_cone, 0.0, last_rad, 60, 0.003, 0.0, pose_std_m=0.02)
        assert not any(column.is_certain for column in columns_of(cones))


def test_a_column_heard_from_one_side_is_suspected(make_cone: Callable[..., EchoCone]) -> None:
    found = columns_of(pings_around(make_cone, 0.0, 0.8, 9, 0.002))
    assert found
    assert not any(column.is_certain for column in found)


def test_a_pole_is_no_column(make_cone: Callable[..., EchoCone]) -> None:
    """Heard from a quarter of the way around, it nearly fits columns behind it."""
    for last_rad in (0.8, 1.6, 4.0):
        found = columns_of(pings_around(make_cone, 0.0, last_rad, 24, 0.003, radius_m=0.0))
        assert not any(column.is_certain for column in found)


@pytest.mark.parametrize(
    ("others_m", "is_column"), [((-0.15, -0.27), False), ((-0.15,), True), ((0.15, 0.27), True)]
)
def test_what_two_walls_are_heard_before_is_no_column(
    make_cone: Callable[..., EchoCone], others_m: tuple[float, ...], is_column: bool
) -> None:
    """A corner of two walls is heard after them; a column after one thing or before others."""
    found = columns_of(pings_around(make_cone, 0.0, 4.0, 40, 0.002, RADIUS_M, *others_m))
    is_there = [
        column.is_certain
        for column in found
        if math.hypot(column.x_m - X_M, column.y_m - Y_M) < 0.05
    ]
    assert is_there == [is_column]


def pair_of_poles(make_cone: Callable[..., EchoCone]) -> list[EchoCone]:
    """Two poles 0.3 m apart, each heard in passing from its own side."""
    cones, rng = [], np.random.default_rng(7)
    for x_m, first_rad in ((0.0, 2.1), (0.3, 0.2)):
        for bearing_rad in np.linspace(first_rad, first_rad + 0.7, 12):
            away_m = 1.5 + 0.02 * len(cones)
            turned = math.cos(bearing_rad), math.sin(bearing_rad)
            cones.append(
                make_cone(
                    (away_m + 0.004 * rng.normal(), 0.15), stamp_ns=len(cones),
                    x_m=x_m + away_m * turned[0], y_m=away_m * turned[1],
                    yaw_rad=bearing_rad + math.pi,
                )
            )  # fmt: skip
    return cones


def test_a_pair_of_poles_is_a_column_only_where_others_are(
    make_cone: Callable[..., EchoCone],
) -> None:
    """Each heard from one side, they pass for what is round; of many poles some are bound to."""
    pair = [column for column in columns_of(pair_of_poles(make_cone)) if column.is_certain]
    assert pair
    assert not any(column.is_certain for column in without_pairs(pair, 20, NOT_FIRST))
    # Who reports the first thing only hears the nearer one of two.
    assert without_pairs(pair, 20, ~NOT_FIRST) == pair
    (column,) = columns_of(pings_around(make_cone, 0.0, 4.0, 24, 0.003))
    (found,) = without_pairs([column], 20, NOT_FIRST)
    assert found.is_certain


def test_a_single_column_among_many_poles_may_be_any_pair_of_them(
    make_cone: Callable[..., EchoCone],
) -> None:
    """Of 25 poles two had been taken for the only column, by a log-likelihood ratio of 5.2."""
    (column,) = columns_of(pings_around(make_cone, 0.0, 4.0, 24, 0.003))
    unlikely, likely = (replace(column, over_two_points=over) for over in (5.2, 7.0))
    assert [each.is_certain for each in without_pairs([unlikely], 25, NOT_FIRST)] == [False]
    assert [each.is_certain for each in without_pairs([likely], 25, NOT_FIRST)] == [True]
    assert [each.is_certain for each in without_pairs([unlikely, likely], 25, NOT_FIRST)] == [
        True,
        True,
    ]
    assert [each.is_certain for each in without_pairs([unlikely], 8, NOT_FIRST)] == [True]


def test_a_column_heard_from_one_side_replaces_the_cell_on_it(
    make_cone: Callable[..., EchoCone],
) -> None:
    """The cell nearest to its listeners explains all of its echoes, each with a small error."""
    cones = pings_around(make_cone, 0.0, 1.0, 40, 0.001)
    near_m = X_M + RADIUS_M * math.cos(0.5), Y_M + RADIUS_M * math.sin(0.5)
    (column,) = columns_instead_of(near_m, cones)
    assert column.is_certain
    found = column.x_m, column.y_m, column.radius_m
    assert found == pytest.approx((X_M, Y_M, RADIUS_M), abs=0.04)


def test_a_column_heard_from_one_side_may_stand_where_cells_do(
    make_cone: Callable[..., EchoCone],
) -> None:
    """It is likelier than a point, though not by enough: what it would cover is not free."""
    cones = pings_around(make_cone, 0.0, 0.75, 20, 0.002)
    near_m = X_M + RADIUS_M * math.cos(0.375), Y_M + RADIUS_M * math.sin(0.375)
    (column,) = columns_instead_of(near_m, cones)
    assert not column.is_certain


def test_a_pole_heard_from_one_side_stays_a_cell(make_cone: Callable[..., EchoCone]) -> None:
    for last_rad in (0.5, 1.0, 4.0):
        cones = pings_around(make_cone, 0.0, last_rad, 40, 0.001, 0.0)
        assert not columns_instead_of((X_M, Y_M), cones)


def test_where_columns_stand_the_next_thing_may_be_one(
    make_cone: Callable[..., EchoCone],
) -> None:
    """Heard from one side, a column is as likely as a point: what it would cover is not free."""
    cones = pings_around(make_cone, 0.0, 0.4, 20, 0.003)
    near_m = X_M + RADIUS_M * math.cos(0.2), Y_M + RADIUS_M * math.sin(0.2)
    assert not columns_instead_of(near_m, cones)
    (column,) = columns_instead_of(near_m, cones, certain=2)
    assert not column.is_certain
    assert math.hypot(column.x_m - X_M, column.y_m - Y_M) < column.radius_m
    pole = pings_around(make_cone, 0.0, 4.0, 40, 0.001, 0.0)
    assert not columns_instead_of((X_M, Y_M), pole, certain=2)


def test_a_column_behind_other_things_may_stand_there(make_cone: Callable[..., EchoCone]) -> None:
    """Most that is heard is before it, as before a corner: it is not shown, but nothing is free."""
    cones = pings_around(make_cone, 0.0, 0.8, 30, 0.001, RADIUS_M, -0.15, -0.2, -0.25)
    near_m = X_M + RADIUS_M * math.cos(0.4), Y_M + RADIUS_M * math.sin(0.4)
    (column,) = columns_instead_of(near_m, cones, certain=2)
    assert not column.is_certain


def test_a_column_heard_from_one_side_may_be_larger(make_cone: Callable[..., EchoCone]) -> None:
    """Nobody heard how far it goes; from around, it is as large as it was found to be."""
    ping_set, _ = heard(pings_around(make_cone, 0.0, 0.8, 30, 0.003))
    near_m = X_M + RADIUS_M * math.cos(0.4), Y_M + RADIUS_M * math.sin(0.4)
    (found,) = columns_instead_of(near_m, pings_around(make_cone, 0.0, 0.8, 30, 0.003))
    (larger,) = larger_columns([found], ping_set)
    assert not larger.is_certain
    assert larger.radius_m > found.radius_m + 0.05
    cones = pings_around(make_cone, 0.0, 4.0, 24, 0.003)
    (around,) = columns_of(cones)
    assert not larger_columns([around], heard(cones)[0])


def test_cells_are_lone_if_no_others_are_near() -> None:
    field = Field(first_row=0, first_column=0, rows=40, columns=40, resolution_m=0.05)
    is_reliable = np.zeros(field.shape, bool)
    is_reliable[5, 5:7] = True
    is_reliable[30, 10:30] = True
    (thing,) = lone_cells(is_reliable, np.where(is_reliable, 2.0, -9.0), field)
    assert thing.tolist() == [[0.275, 0.275], [0.325, 0.275]]


def test_echoes_that_scatter_are_no_column(make_cone: Callable[..., EchoCone]) -> None:
    found = columns_of(pings_around(make_cone, 0.0, 4.0, 24, 0.1))
    assert not any(column.is_certain for column in found)


def test_a_column_covers_its_disc(views: list[EchoCone]) -> None:
    table, rows = kept_pings({"robot": [views[0]]}, MappingParameters()).pings()[:2]
    none = np.zeros(0, np.int64)
    field = field_around(table, rows, 0.05)
    mask = discs([RoundColumn(X_M, Y_M, RADIUS_M, none, none, False)], field)
    assert np.count_nonzero(mask) * 0.05**2 == pytest.approx(math.pi * 0.25**2, rel=0.1)


@pytest.mark.parametrize(
    ("row", "begin", "end", "is_on"),
    [(10.0, -40.0, -20.0, True), (14.5, -40.0, -20.0, True), (17.0, -40.0, -20.0, False),
     (10.0, -20.0, 0.0, False), (14.0, -36.0, -24.0, False)],
)  # fmt: skip
def test_a_wall_is_on_a_column_that_it_passes_through_or_touches(
    row: float, begin: float, end: float, is_on: bool
) -> None:
    """A wall along a row of cells of 5 cm, and a column of 20 cm about row 10 and column 30.

    What is as short as a column's side is no wall.
    """
    field = Field(-4, 7, 40, 60, 0.05)
    column = RoundColumn(37.5 * 0.05, 6.5 * 0.05, 0.2, NO_PINGS, NO_PINGS, True)
    lines = np.array([[0.0, 1.0, row, begin, end]])
    assert column.is_on(lines, field) == is_on


def test_a_column_on_a_wall_is_not_shown_but_nothing_is_free_there(views: list[EchoCone]) -> None:
    (table, rows, echoes, _), field = heard(views)
    smooth, column = (
        SmoothSurfaces(table, rows, echoes, field),
        RoundColumn(X_M, Y_M, RADIUS_M, NO_PINGS, NO_PINGS, True),
    )
    smooth.columns = [column]
    row = Y_M / field.resolution_m - field.first_row
    assert not smooth.doubt_columns_on(np.array([[0.0, 1.0, row + 20.0, -1000.0, 0.0]]))
    assert smooth.drawn_columns().any()
    assert smooth.doubt_columns_on(np.array([[0.0, 1.0, row, -1000.0, 0.0]]))
    assert not smooth.drawn_columns().any()
    assert (smooth.suspected() == discs([column], field)).all()


def test_an_explained_echo_was_to_be_heard(views: list[EchoCone]) -> None:
    table, rows = kept_pings({"robot": [views[0]]}, MappingParameters()).pings()[:2]
    noise = np.full(table.kind[rows].shape, table.numbers[rows[0], NOISE], np.float32)
    is_echo = table.kind[rows] == ECHO
    explained = np.where(is_echo, noise + table.power[rows], noise)
    assert listen(table, rows, noise, 2).chance[is_echo].max() < 0.5
    assert listen(table, rows, explained, 2).chance[is_echo].min() >= np.float32(MOST_EXPLAINED)
