"""Cones become a map: what every way of fusing promises, and what the joint method does better."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logit
from two_objects import OBJECTS, VIEWS

from usmap_ros.errors import MalformedMessageError
from usmap_ros.grids import GridGeometry, OccupancyMap
from usmap_ros.mapping.footprint import footprint
from usmap_ros.mapping.fusion import Fusion
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.yardsticks.additive import AdditiveFusion
from usmap_ros.mapping.yardsticks.range_only import RangeSensorFusion
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

MakeCone = Callable[..., EchoCone]
FUSIONS = [JointFusion, AdditiveFusion, RangeSensorFusion]


@pytest.fixture(params=FUSIONS, ids=[kind.__name__ for kind in FUSIONS])
def kind(request: pytest.FixtureRequest) -> type[Fusion]:
    return request.param


def fused(fusion: Fusion, cones: list[EchoCone]) -> OccupancyMap:
    for cone in cones:
        fusion.fuse(cone)
    return fusion.occupancy_map()


def test_a_snapshot_stays_as_it_was_while_cones_are_fused(
    kind: type[Fusion], views: list[EchoCone]
) -> None:
    fusion = kind(MappingParameters())
    before = fused(fusion, views[:5])
    make = fusion.snapshot()
    after = fused(fusion, views[5:])
    assert not np.array_equal(after.observed, before.observed)
    assert_same(make(), before)


def probability_at(occupancy: OccupancyMap, x_m: float, y_m: float) -> float:
    resolution_m, (left_m, bottom_m) = occupancy.geometry.resolution_m, occupancy.geometry.origin_m
    row, column = int((y_m - bottom_m) // resolution_m), int((x_m - left_m) // resolution_m)
    return float(occupancy.probability()[row, column])


def trinary_at(occupancy: OccupancyMap, x_m: float, y_m: float) -> int:
    resolution_m, (left_m, bottom_m) = occupancy.geometry.resolution_m, occupancy.geometry.origin_m
    row, column = int((y_m - bottom_m) // resolution_m), int((x_m - left_m) // resolution_m)
    return int(occupancy.trinary()[row, column])


def assert_same(first: OccupancyMap, second: OccupancyMap) -> None:
    assert first.geometry == second.geometry
    np.testing.assert_array_equal(first.observed, second.observed)
    np.testing.assert_array_equal(first.log_odds, second.log_odds)


def test_a_new_map_is_one_unobserved_cell(kind: type[Fusion]) -> None:
    occupancy = kind(MappingParameters()).occupancy_map()
    assert occupancy.geometry.shape == (1, 1)
    assert not occupancy.observed.any()
    assert occupancy.frame_id == ""


def test_the_same_cones_in_the_same_order_give_the_same_map(
    kind: type[Fusion], views: list[EchoCone]
) -> None:
    assert_same(fused(kind(MappingParameters()), views), fused(kind(MappingParameters()), views))


def test_a_cone_of_another_frame_is_refused_and_changes_nothing(
    kind: type[Fusion], views: list[EchoCone]
) -> None:
    fusion = kind(MappingParameters())
    before = fused(fusion, views[:2])
    with pytest.raises(MalformedMessageError, match="is 'odom', the map's is 'map'"):
        fusion.fuse(replace(views[2], frame_id="odom"))
    assert_same(fusion.occupancy_map(), before)


def test_the_map_has_the_frame_and_the_newest_stamp_of_its_cones(
    kind: type[Fusion], make_cone: MakeCone
) -> None:
    cones = [make_cone(frame_id="site", stamp_ns=stamp_ns) for stamp_ns in (30, 50, 40)]
    occupancy = fused(kind(MappingParameters()), cones)
    assert (occupancy.frame_id, occupancy.stamp_ns) == ("site", 50)


def test_log_odds_stay_between_the_clamps_however_often_it_is_told(
    kind: type[Fusion], cone_of_objects: MakeCone
) -> None:
    parameters = MappingParameters(prior=0.1, least_log_odds=-3.0, greatest_log_odds=1.5)
    occupancy = fused(kind(parameters), [cone_of_objects(*OBJECTS)] * 60)
    log_odds = occupancy.log_odds[occupancy.observed]
    assert log_odds.min() == pytest.approx(-3.0)
    assert log_odds.max() <= 1.5
    if kind is not JointFusion:  # which never chooses among mirror images
        assert log_odds.max() == 1.5


def test_cells_that_no_cone_touched_hold_the_prior(
    kind: type[Fusion], views: list[EchoCone]
) -> None:
    fusion = kind(MappingParameters(prior=0.01))
    occupancy = fused(fusion, views[:2])
    (left_m, bottom_m), (rows, columns) = occupancy.geometry.origin_m, occupancy.geometry.shape
    touched = np.zeros((rows, columns), dtype=bool)
    row, column = np.mgrid[:rows, :columns]
    centers_m = occupancy.geometry.cell_centers_m(row, column)
    for cone in views[:2]:
        cells = footprint(cone, 0.05)
        # Rays cross cells whose centres are just outside of the beam.
        for down, right in np.ndindex(3, 3):
            row = cells.rows - round(bottom_m / 0.05) + down - 1
            column = cells.columns - round(left_m / 0.05) + right - 1
            inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
            touched[row[inside], column[inside]] = True
        # Where the robot is, nothing else stands.
        touched |= np.hypot(*np.moveaxis(centers_m - cone.pose.position_m[:2], -1, 0)) < 0.2
    prior = np.float32(logit(fusion.parameters.prior))
    assert 0 < np.count_nonzero(touched) < touched.size
    np.testing.assert_array_equal(occupancy.log_odds[~touched], prior)
    assert not occupancy.observed[~touched].any()


def test_one_ping_finds_nothing_for_certain_and_frees_no_cell_of_its_ring(
    make_cone: MakeCone,
) -> None:
    occupancy = fused(JointFusion(MappingParameters()), [make_cone((1.5, 0.3))])
    row, column = np.mgrid[tuple(slice(0, size) for size in occupancy.geometry.shape)]
    x_m, y_m = np.moveaxis(occupancy.geometry.cell_centers_m(row, column), -1, 0)
    ring = np.abs(np.hypot(x_m, y_m) - 1.5) < 0.03
    assert np.count_nonzero(ring) > 10
    assert not occupancy.observed[ring].any()
    assert not np.any(occupancy.trinary() == 100)


def test_a_prior_above_the_threshold_makes_nothing_observed_that_no_sound_reached(
    make_cone: MakeCone,
) -> None:
    cone = make_cone(max_range_m=1.0)
    occupancy = fused(JointFusion(MappingParameters(prior=0.4)), [cone])
    row, column = np.nonzero(occupancy.observed)
    ahead_m, aside_m = np.moveaxis(occupancy.geometry.cell_centers_m(row, column), -1, 0)
    assert len(row) > 10
    assert np.hypot(ahead_m, aside_m).max() < 1.05
    at_the_robot = np.hypot(ahead_m, aside_m) < 0.2
    assert np.all(at_the_robot | (np.abs(np.arctan2(aside_m, ahead_m)) < np.deg2rad(45)))


@pytest.mark.parametrize("resolution_m", [0.05, 0.03, 0.1])
def test_the_origin_is_a_whole_number_of_cells_from_the_worlds(
    kind: type[Fusion], make_cone: MakeCone, resolution_m: float
) -> None:
    cone = make_cone(1.0, x_m=-3.217, y_m=11.113, yaw_rad=2.1)
    occupancy = fused(kind(MappingParameters(resolution_m=resolution_m)), [cone])
    cells = np.array(occupancy.geometry.origin_m) / resolution_m
    np.testing.assert_allclose(cells, np.rint(cells), atol=1e-9)


def test_a_map_that_grows_does_not_shift(kind: type[Fusion], views: list[EchoCone]) -> None:
    fusion = kind(MappingParameters())
    alone = fused(fusion, views)
    grown = fused(fusion, [replace(views[0], pose=Pose.planar(-20.0, -9.0, 2.0))])
    offset = (np.array(alone.geometry.origin_m) - grown.geometry.origin_m) / 0.05
    np.testing.assert_allclose(offset, np.rint(offset), atol=1e-6)
    column, row = np.rint(offset).astype(int)
    rows, columns = alone.geometry.shape
    window = (slice(row, row + rows), slice(column, column + columns))
    np.testing.assert_array_equal(grown.trinary()[window] == 100, alone.trinary() == 100)
    if kind is not JointFusion:  # which explains all views anew
        np.testing.assert_array_equal(grown.log_odds[window], alone.log_odds)
        np.testing.assert_array_equal(grown.observed[window], alone.observed)


def test_a_centred_cone_gives_a_symmetric_map(kind: type[Fusion], make_cone: MakeCone) -> None:
    occupancy = fused(kind(MappingParameters()), [make_cone((0.9, 0.6), (1.6, 0.1), (2.2, 0.05))])
    assert occupancy.geometry.origin_m[1] == pytest.approx(-occupancy.geometry.extent_m[3])
    np.testing.assert_array_equal(occupancy.observed, occupancy.observed[::-1])
    np.testing.assert_allclose(occupancy.log_odds, occupancy.log_odds[::-1], atol=2e-5)


def test_an_exported_map_is_resumed_as_it_was(kind: type[Fusion], views: list[EchoCone]) -> None:
    parameters = MappingParameters()
    exported = fused(kind(parameters), views)
    resumed = kind(parameters)
    resumed.resume(exported)
    again = resumed.occupancy_map()
    assert again.geometry == exported.geometry
    np.testing.assert_array_equal(again.observed, exported.observed)
    np.testing.assert_allclose(again.log_odds, exported.log_odds, atol=1e-5)
    assert again.stamp_ns == exported.stamp_ns
    with pytest.raises(MalformedMessageError):
        resumed.fuse(replace(views[0], frame_id="odom"))


def test_a_resumed_map_stays_until_there_is_new_evidence(
    kind: type[Fusion], make_cone: MakeCone, views: list[EchoCone]
) -> None:
    """A ping elsewhere changes nothing here, however often passes end."""
    exported = fused(kind(MappingParameters()), views)
    resumed = kind(MappingParameters())
    resumed.resume(exported)
    grown = fused(resumed, [make_cone(1.0, x_m=30.0)] * 3)
    rows, columns = exported.geometry.shape
    assert grown.geometry.origin_m == exported.geometry.origin_m
    np.testing.assert_array_equal(grown.observed[:rows, :columns], exported.observed)
    np.testing.assert_allclose(grown.log_odds[:rows, :columns], exported.log_odds, atol=1e-5)


@pytest.mark.parametrize(
    ("geometry", "message"),
    [
        (GridGeometry(0.1, (0.0, 0.0), (2, 2)), "its cells are 0.1 m and not 0.05 m"),
        (GridGeometry(0.05, (0.02, 0.0), (2, 2)), "is not a multiple of the resolution"),
    ],
)
def test_a_map_that_does_not_fit_the_grid_is_not_resumed(
    geometry: GridGeometry, message: str
) -> None:
    occupancy = OccupancyMap(geometry, np.zeros((2, 2), np.float32), np.ones((2, 2), bool), "map")
    with pytest.raises(ValueError, match=message):
        JointFusion(MappingParameters()).resume(occupancy)


def test_silence_frees_only_near_to_where_the_way_is_known_to_be_open(make_cone: MakeCone) -> None:
    """Where the robot is, and little by little ahead of it, but not what nobody has proven."""
    fusion = JointFusion(MappingParameters())
    occupancy = fused(fusion, [make_cone()] * 20)
    assert probability_at(occupancy, 0.025, 0.025) < fusion.parameters.prior
    assert trinary_at(occupancy, 0.025, 0.025) == 0
    row, column = np.nonzero(occupancy.observed)
    reach_m = np.hypot(*np.moveaxis(occupancy.geometry.cell_centers_m(row, column), -1, 0))
    assert reach_m.max() < 1.5


def test_echoes_that_came_back_prove_the_way_to_them(views: list[EchoCone]) -> None:
    occupancy = fused(JointFusion(MappingParameters()), views * 3)
    for share in (0.3, 0.6, 0.85):
        x_m, y_m = share * OBJECTS[0][0], share * OBJECTS[0][1]
        assert trinary_at(occupancy, x_m, y_m) == 0


def test_views_from_several_sides_leave_the_objects_alone(views: list[EchoCone]) -> None:
    occupancy = fused(JointFusion(MappingParameters()), views)
    for x_m, y_m, _ in OBJECTS:
        assert probability_at(occupancy, x_m, y_m) > 0.8
    found = np.argwhere(occupancy.observed & (occupancy.probability() > 0.65))
    centers_m = occupancy.geometry.cell_centers_m(*found.T)
    away = np.abs(centers_m[:, np.newaxis] - np.array(OBJECTS)[:, :2]).max(axis=2).min(axis=1)
    assert np.all(away < 0.08)


def test_the_joint_method_draws_no_arcs_where_the_additive_method_does(make_cone: MakeCone) -> None:
    cone = make_cone((1.5, 0.3))
    counts = {}
    for kind in (JointFusion, AdditiveFusion):
        occupancy = fused(kind(MappingParameters()), [cone] * 4)
        counts[kind] = np.count_nonzero(occupancy.observed & (occupancy.probability() > 0.65))
    assert counts[JointFusion] == 0
    assert counts[AdditiveFusion] > 20


@pytest.mark.parametrize("window", [600, 20])
def test_an_object_that_went_away_is_forgotten(cone_of_objects: MakeCone, window: int) -> None:
    staying, moving = OBJECTS
    fusion = JointFusion(MappingParameters(window=window))
    seen = fused(fusion, [cone_of_objects(staying, moving, **view) for view in VIEWS])
    gone = fused(fusion, [cone_of_objects(staying, **view) for view in VIEWS * 2])
    assert probability_at(seen, *moving[:2]) > 0.8
    assert probability_at(gone, *moving[:2]) < 0.35
    assert probability_at(gone, *staying[:2]) > 0.8


def test_a_window_of_few_pings_slides(cone_of_objects: MakeCone) -> None:
    """Pings that come when it is full count as much as those that filled it."""
    staying, later = OBJECTS
    fusion = JointFusion(MappingParameters(window=4))
    fused(fusion, [cone_of_objects(staying, **view) for view in VIEWS[:4]])
    after = fused(fusion, [cone_of_objects(staying, later, **view) for view in VIEWS * 4])
    assert probability_at(after, *staying[:2]) > 0.65
    assert probability_at(after, *later[:2]) > 0.65


def test_an_object_too_weak_to_be_heard_again_is_not_freed(cone_of_objects: MakeCone) -> None:
    """Its power is known from close by, so silence from afar says nothing of it."""
    weak = (1.025, 0.175, 0.1)
    close = [
        {"x_m": 0.4, "y_m": 0.0}, {"x_m": 0.9, "y_m": 0.8, "yaw_rad": -1.4},
        {"x_m": 0.5, "y_m": -0.4, "yaw_rad": 0.7}, {"x_m": 1.6, "y_m": 0.1, "yaw_rad": 3.0},
    ]  # fmt: skip
    fusion = JointFusion(MappingParameters())
    before = fused(fusion, [cone_of_objects(weak, **view) for view in close * 2])
    far = cone_of_objects(x_m=-1.9, y_m=0.1, max_range_m=4.0, limit=0.03)
    after = fused(fusion, [far] * 10)
    assert probability_at(before, *weak[:2]) > 0.65
    assert probability_at(after, *weak[:2]) > 0.65


def test_poses_that_are_stated_to_be_off_are_forgiven(
    make_cone: MakeCone, cone_of_objects: MakeCone
) -> None:
    """The same echoes, 3 cm off, place the pole within a cell if the covariance says so."""
    generator, pole = np.random.default_rng(5), OBJECTS[0]
    found = {}
    for stated_m in (0.0, 0.03):
        fusion = JointFusion(MappingParameters())
        for view in VIEWS * 2:
            cone = cone_of_objects(pole, **view)
            off_m = generator.normal(0.0, 0.03, 2)
            pose = Pose.planar(
                view["x_m"] + off_m[0],
                view["y_m"] + off_m[1],
                view["yaw_rad"],
                planar_covariance=np.diag([stated_m**2, stated_m**2, 0.0]),
            )
            fusion.fuse(replace(cone, pose=pose))
        occupancy = fusion.occupancy_map()
        found[stated_m] = max(
            probability_at(occupancy, pole[0] + right_m, pole[1] + up_m)
            for right_m in (-0.05, 0.0, 0.05)
            for up_m in (-0.05, 0.0, 0.05)
        )
    assert found[0.03] > 0.65
    assert found[0.03] >= found[0.0]


def test_a_cone_that_sees_no_cell_is_taken_up_all_the_same(
    kind: type[Fusion], make_cone: MakeCone
) -> None:
    fusion = kind(MappingParameters(resolution_m=1.0))
    fusion.fuse(make_cone(min_range_m=0.1, max_range_m=0.2))
    assert not fusion.occupancy_map().observed.any()


def test_nothing_stands_where_a_robot_is(views: list[EchoCone], cone_of_objects: MakeCone) -> None:
    """Whatever echoes say: ten views find an object where a robot then goes through."""
    x_m, y_m, _ = OBJECTS[0]

    def is_observed_and_occupied(occupancy: OccupancyMap) -> tuple[bool, bool]:
        geometry = occupancy.geometry
        place = np.array((x_m, y_m)) - geometry.origin_m
        column, row = (place / geometry.resolution_m).astype(int)
        return bool(occupancy.observed[row, column]), bool(occupancy.predicted()[row, column])

    fusion = JointFusion(MappingParameters())
    assert is_observed_and_occupied(fused(fusion, views)) == (True, True)
    steps_m = 0.02 * np.arange(10) - 0.1
    through = [
        cone_of_objects(OBJECTS[1], stamp_ns=100 + n, x_m=x_m + step_m, y_m=y_m, yaw_rad=1.5)
        for n, step_m in enumerate(steps_m)
    ]
    assert is_observed_and_occupied(fused(fusion, through)) == (True, False)
