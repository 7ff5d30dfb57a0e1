"""Cones become a map: what every way of fusing promises, and what the noisy-OR does better."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logit

from usmap_ros.cone import EchoCone
from usmap_ros.errors import MalformedMessageError
from usmap_ros.grids import GridGeometry, OccupancyMap
from usmap_ros.mapping.additive import AdditiveFusion
from usmap_ros.mapping.footprint import footprint
from usmap_ros.mapping.fusion import Fusion
from usmap_ros.mapping.noisy_or import NoisyOrFusion
from usmap_ros.mapping.range_sensor import RangeSensorFusion
from usmap_ros.parameters import MappingParameters

MakeCone = Callable[..., EchoCone]
FUSIONS = [NoisyOrFusion, AdditiveFusion, RangeSensorFusion]
#: Two objects, and places from where both are heard.
OBJECTS = ((1.525, 0.425, 0.6), (1.775, -0.325, 0.4))
VIEWS = [
    {"x_m": x, "y_m": y, "yaw_rad": yaw}
    for x, y, yaw in [
        (0.0, 0.0, 0.0), (0.3, 0.9, -0.5), (0.2, -1.0, 0.6), (1.6, 1.7, -1.6), (1.5, -1.9, 1.5),
        (3.2, 0.3, 3.0), (2.9, -0.9, 2.6), (0.5, 0.4, -0.2), (2.9, 1.1, -2.5), (0.1, -0.4, 0.2),
    ]
]  # fmt: skip


@pytest.fixture(params=FUSIONS, ids=[kind.__name__ for kind in FUSIONS])
def kind(request: pytest.FixtureRequest) -> type[Fusion]:
    return request.param


@pytest.fixture(scope="module")
def views(cone_of_objects: MakeCone) -> list[EchoCone]:
    return [cone_of_objects(*OBJECTS, stamp_ns=number, **view) for number, view in enumerate(VIEWS)]


def fused(fusion: Fusion, cones: list[EchoCone]) -> OccupancyMap:
    for cone in cones:
        fusion.fuse(cone)
    return fusion.occupancy_map()


def probability_at(occupancy: OccupancyMap, x_m: float, y_m: float) -> float:
    resolution_m, (left_m, bottom_m) = occupancy.geometry.resolution_m, occupancy.geometry.origin_m
    row, column = int((y_m - bottom_m) // resolution_m), int((x_m - left_m) // resolution_m)
    return float(occupancy.probability()[row, column])


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
    parameters = MappingParameters(
        prior=0.1, least_log_odds=-3.0, greatest_log_odds=1.5, fluctuation=0.05
    )
    occupancy = fused(kind(parameters), [cone_of_objects(*OBJECTS)] * 60)
    log_odds = occupancy.log_odds[occupancy.observed]
    assert log_odds.min() == pytest.approx(-3.0)
    assert log_odds.max() <= 1.5
    if kind is not NoisyOrFusion:  # which leaves mirror images in doubt for ever
        assert log_odds.max() == 1.5


def test_cells_that_no_cone_touched_hold_the_prior(
    kind: type[Fusion], views: list[EchoCone]
) -> None:
    fusion = kind(MappingParameters(prior=0.01))
    occupancy = fused(fusion, views[:2])
    (left_m, bottom_m), (rows, columns) = occupancy.geometry.origin_m, occupancy.geometry.shape
    touched = np.zeros((rows, columns), dtype=bool)
    for cone in views[:2]:
        cells = footprint(cone, 0.05)
        row, column = cells.rows - round(bottom_m / 0.05), cells.columns - round(left_m / 0.05)
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        touched[row[inside], column[inside]] = True
    prior = np.float32(logit(fusion.parameters.prior))
    assert 0 < np.count_nonzero(touched) < touched.size
    np.testing.assert_array_equal(occupancy.log_odds[~touched], prior)
    assert not occupancy.observed[~touched].any()


def test_a_cell_in_doubt_is_unobserved_but_keeps_its_log_odds(make_cone: MakeCone) -> None:
    """One echo says nothing certain of any cell of its ring, but ranks them."""
    occupancy = fused(NoisyOrFusion(MappingParameters()), [make_cone((1.5, 0.3))])
    row, column = np.unravel_index(occupancy.log_odds.argmax(), occupancy.log_odds.shape)
    x_m, y_m = occupancy.geometry.cell_centers_m(row, column)
    assert np.hypot(x_m, y_m) == pytest.approx(1.5, abs=0.03)
    assert logit(0.0002) < occupancy.log_odds[row, column] < logit(0.35)
    assert not occupancy.observed[row, column]


def test_a_prior_above_the_threshold_makes_nothing_observed(make_cone: MakeCone) -> None:
    cone = make_cone(max_range_m=1.0)
    observed = {
        prior: fused(NoisyOrFusion(MappingParameters(prior=prior)), [cone]).observed.sum()
        for prior in (0.0002, 0.4)
    }
    assert observed[0.4] < 1.2 * observed[0.0002]


@pytest.mark.parametrize("resolution_m", [0.05, 0.03, 0.1])
def test_the_origin_is_a_whole_number_of_cells_from_the_worlds(
    kind: type[Fusion], make_cone: MakeCone, resolution_m: float
) -> None:
    cone = make_cone(1.0, x_m=-3.217, y_m=11.113, yaw_rad=2.1)
    occupancy = fused(kind(MappingParameters(resolution_m=resolution_m)), [cone])
    cells = np.array(occupancy.geometry.origin_m) / resolution_m
    np.testing.assert_allclose(cells, np.rint(cells), atol=1e-9)


def test_a_map_that_grows_does_not_shift(make_cone: MakeCone) -> None:
    near = make_cone(1.0)
    parameters = MappingParameters(revisits=0)
    alone = fused(NoisyOrFusion(parameters), [near])
    grown = fused(NoisyOrFusion(parameters), [near, make_cone(x_m=-20.0, y_m=-9.0)])
    offset = (np.array(alone.geometry.origin_m) - grown.geometry.origin_m) / 0.05
    column, row = np.rint(offset).astype(int)
    rows, columns = alone.geometry.shape
    window = (slice(row, row + rows), slice(column, column + columns))
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
    assert_same(resumed.occupancy_map(), exported)
    assert resumed.occupancy_map().stamp_ns == exported.stamp_ns
    with pytest.raises(MalformedMessageError):
        resumed.fuse(replace(views[0], frame_id="odom"))


def test_resuming_goes_on_as_if_never_interrupted_where_nothing_is_recalled(
    make_cone: MakeCone, views: list[EchoCone]
) -> None:
    """Where later cones touch other cells; what was learnt of reflectivities is not exported."""
    elsewhere = make_cone(1.0, x_m=30.0)
    parameters = MappingParameters(revisits=0)
    continued = fused(NoisyOrFusion(parameters), [*views, elsewhere])
    resumed = NoisyOrFusion(parameters)
    resumed.resume(fused(NoisyOrFusion(parameters), views))
    assert_same(fused(resumed, [elsewhere]), continued)


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
        NoisyOrFusion(MappingParameters()).resume(occupancy)


def test_silence_frees_what_would_have_been_heard(make_cone: MakeCone) -> None:
    prior = 1e-3
    occupancy = fused(NoisyOrFusion(MappingParameters(prior=prior)), [make_cone()])
    assert probability_at(occupancy, 1.0, 0.1) < 0.1 * prior
    # At the edge of the beam an object would have to be a strong one.
    assert probability_at(occupancy, 1.9, 1.525) > 0.5 * prior


def test_views_from_several_sides_leave_the_objects_alone(views: list[EchoCone]) -> None:
    occupancy = fused(NoisyOrFusion(MappingParameters()), views)
    for x_m, y_m, _ in OBJECTS:
        assert probability_at(occupancy, x_m, y_m) > 0.8
    found = np.argwhere(occupancy.observed & (occupancy.probability() > 0.65))
    centers_m = occupancy.geometry.cell_centers_m(*found.T)
    away = np.abs(centers_m[:, np.newaxis] - np.array(OBJECTS)[:, :2]).max(axis=2).min(axis=1)
    assert np.all(away < 0.08)


def test_the_noisy_or_draws_no_arcs_where_the_additive_method_does(make_cone: MakeCone) -> None:
    cone = make_cone((1.5, 0.3))
    counts = {}
    for kind in (NoisyOrFusion, AdditiveFusion):
        occupancy = fused(kind(MappingParameters()), [cone] * 4)
        counts[kind] = np.count_nonzero(occupancy.observed & (occupancy.probability() > 0.65))
    assert counts[NoisyOrFusion] == 0
    assert counts[AdditiveFusion] > 20


def test_an_object_that_went_away_is_forgotten(cone_of_objects: MakeCone) -> None:
    staying, moving = OBJECTS
    parameters = MappingParameters(window=len(VIEWS))
    fusion = NoisyOrFusion(parameters)
    seen = fused(fusion, [cone_of_objects(staying, moving, **view) for view in VIEWS])
    gone = fused(fusion, [cone_of_objects(staying, **view) for view in VIEWS * 2])
    assert probability_at(seen, *moving[:2]) > 0.8
    assert probability_at(gone, *moving[:2]) < 0.35
    assert probability_at(gone, *staying[:2]) > 0.8


def test_an_object_too_weak_to_be_heard_again_is_not_freed(cone_of_objects: MakeCone) -> None:
    """Its reflectivity is known from close by, so silence from afar says nothing of it."""
    weak = (1.025, 0.175, 0.05)
    close = [
        {"x_m": 0.4, "y_m": 0.0}, {"x_m": 0.9, "y_m": 0.8, "yaw_rad": -1.4},
        {"x_m": 0.5, "y_m": -0.4, "yaw_rad": 0.7}, {"x_m": 1.6, "y_m": 0.1, "yaw_rad": 3.0},
    ]  # fmt: skip
    fusion = NoisyOrFusion(MappingParameters())
    before = fused(fusion, [cone_of_objects(weak, **view) for view in close])
    far = cone_of_objects(x_m=-1.9, y_m=0.1, max_range_m=4.0, limit=0.03)
    after = fused(fusion, [far] * 10)
    assert probability_at(before, *weak[:2]) > 0.65
    assert probability_at(after, *weak[:2]) > 0.65


def test_revisits_let_later_views_settle_earlier_echoes(views: list[EchoCone]) -> None:
    """Without them, the first ping's echo stays spread over all of its ring."""
    sharpness = []
    for revisits in (0, 8):
        fusion = NoisyOrFusion(MappingParameters(revisits=revisits))
        probability = fused(fusion, views[:2]).probability()
        sharpness.append(np.sum(probability**2) / np.sum(probability))
    assert sharpness[1] > 1.1 * sharpness[0]


def test_the_pose_covariance_widens_what_an_echo_fills(make_cone: MakeCone) -> None:
    raised = []
    for variance in (0.0, 0.05**2):
        cone = make_cone((1.5, 0.3), planar_covariance=np.diag([variance, variance, 0.0]))
        occupancy = fused(NoisyOrFusion(MappingParameters()), [cone])
        raised.append(np.count_nonzero(occupancy.log_odds > logit(0.0002) + 0.1))
    assert raised[1] > 1.5 * raised[0] > 0


def test_a_cone_that_sees_no_cell_is_taken_up_all_the_same(
    kind: type[Fusion], make_cone: MakeCone
) -> None:
    fusion = kind(MappingParameters(resolution_m=1.0))
    fusion.fuse(make_cone(min_range_m=0.1, max_range_m=0.2))
    assert not fusion.occupancy_map().observed.any()
