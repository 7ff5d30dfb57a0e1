"""What holds of cones' cells and of fusion, whatever the cone."""

import math
from itertools import permutations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.grids import OccupancyMap
from usmap_ros.mapping.footprint import footprint
from usmap_ros.mapping.fusion import Fusion
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.yardsticks.additive import AdditiveFusion
from usmap_ros.mapping.yardsticks.range_only import RangeSensorFusion
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

QUICK = settings(max_examples=40)
#: Each example is a map or two.
FEW = settings(max_examples=5)
KINDS = [JointFusion, AdditiveFusion]
PULSE = Pulse(PulseShape.HANN_BURST, 50e3, 3e-4)
#: Just short of, at and beyond a right angle the cone is no longer convex.
half_angles = st.one_of(
    st.floats(0.05, math.pi), st.sampled_from([math.pi / 2, math.pi / 2 - 1e-6, 1.6, 3.0])
)
yaws = st.one_of(st.floats(-math.pi, math.pi), st.sampled_from([0.0, math.pi / 2, math.pi]))


@st.composite
def cones(
    draw: st.DrawFn, x_m: float = 0.0, echoes: int = 6, with_covariance: bool = True
) -> EchoCone:
    min_range_m = draw(st.floats(0.0, 0.4))
    max_range_m = min_range_m + draw(st.floats(0.05, 1.5))
    half_angle_rad = draw(half_angles)
    count = draw(st.integers(0, echoes))
    amplitudes = st.one_of(st.just(0.0), st.floats(1e-6, 1e3))
    covariance = np.zeros((3, 3))
    if with_covariance:
        root = np.array(draw(st.lists(st.floats(-0.1, 0.1), min_size=9, max_size=9)))
        covariance = draw(st.sampled_from([0.0, 1.0])) * np.outer(root[:3], root[:3])
        covariance += np.diag(root[3:6] ** 2)
    ranges_m = st.floats(min_range_m, max_range_m)
    columns = [
        np.array(draw(st.lists(values, min_size=count, max_size=count)), dtype=np.float32)
        for values in (ranges_m, st.floats(0.0, 0.05), amplitudes, amplitudes)
    ]
    limits = draw(st.lists(st.integers(0, 255), min_size=1, max_size=20))
    return EchoCone(
        stamp_ns=draw(st.integers(0, 10)),
        frame_id="map",
        child_frame_id="sonar",
        pose=Pose.planar(
            x_m + draw(st.floats(-3.0, 3.0)),
            draw(st.floats(-3.0, 3.0)),
            draw(yaws),
            0.0,
            covariance,
        ),
        transducer=Transducer(PULSE, BeamPattern.linear(half_angle_rad), min_range_m, max_range_m),
        attenuation_db_m=draw(st.floats(0.0, 10.0)),
        ranges_m=np.sort(columns[0]),
        range_stds_m=columns[1],
        amplitudes=columns[2],
        amplitude_stds=columns[3],
        limit_step_m=draw(st.floats(0.01, 0.2)),
        detection_limits=np.array(limits, dtype=np.uint8),
        residual=0.0,
    )


@QUICK
@given(cones(echoes=0, with_covariance=False), st.sampled_from([0.05, 0.11]))
def test_a_footprint_holds_exactly_the_cells_in_beam_and_range(
    cone: EchoCone, resolution_m: float
) -> None:
    x_m, y_m = cone.pose.position_m[:2]
    reach = int(cone.transducer.max_range_m / resolution_m) + 3
    row, column = (int(value // resolution_m) for value in (y_m, x_m))
    rows, columns = np.mgrid[row - reach : row + reach, column - reach : column + reach]
    east_m, north_m = (columns + 0.5) * resolution_m - x_m, (rows + 0.5) * resolution_m - y_m
    range_m = np.hypot(east_m, north_m)
    bearing_rad = np.abs(np.angle((east_m + 1j * north_m) * np.exp(-1j * cone.pose.yaw_rad)))
    margin_m = np.minimum(
        range_m - cone.transducer.min_range_m, cone.transducer.max_range_m - range_m
    )
    margin_rad = cone.transducer.beam.half_angle_rad - bearing_rad
    # Where rounding decides, either is right.  The cosine is flat near 0 and π.
    unclear = (np.abs(margin_m) < 1e-9) | (np.abs(margin_rad) < 1e-6)
    inside = (margin_m > 0.0) & (margin_rad > 0.0) & ~unclear
    edge = set(zip(rows[unclear].tolist(), columns[unclear].tolist(), strict=True))
    expected = set(zip(rows[inside].tolist(), columns[inside].tolist(), strict=True))

    cells = footprint(cone, resolution_m)
    found = list(zip(cells.rows.tolist(), cells.columns.tolist(), strict=True))
    assert len(set(found)) == len(found)
    assert set(found) - edge == expected


@FEW
@given(st.lists(cones(), min_size=1, max_size=3), st.sampled_from([JointFusion, AdditiveFusion]))
def test_any_valid_cone_leaves_a_map_of_finite_numbers_between_the_clamps(
    views: list[EchoCone], kind: type[Fusion]
) -> None:
    parameters = MappingParameters()
    fusion = kind(parameters)
    for cone in views:
        cone.validate()
        fusion.fuse(cone)
    log_odds = fusion.occupancy_map().log_odds
    assert np.all(np.isfinite(log_odds))
    assert log_odds.min() >= np.float32(parameters.least_log_odds)
    assert log_odds.max() <= np.float32(parameters.greatest_log_odds)


def fused(fusion: Fusion, views: list[EchoCone]) -> OccupancyMap:
    for cone in views:
        fusion.fuse(cone)
    return fusion.occupancy_map()


@FEW
@given(st.tuples(cones(), cones(x_m=20.0), cones(x_m=-20.0)))
def test_robots_in_areas_of_their_own_may_come_in_any_order(views: tuple[EchoCone, ...]) -> None:
    """What a revisit takes back and deals again must not depend on what others did meanwhile."""
    first, *others = (
        fused(JointFusion(MappingParameters()), list(order)) for order in permutations(views)
    )
    for other in others:
        assert other.geometry == first.geometry
        # Log-odds nearly: what a look counts depends on how many there are, wherever they are.
        np.testing.assert_array_equal(other.predicted(), first.predicted())


@QUICK
@given(st.permutations(range(4)), st.data())
def test_methods_that_only_add_up_do_not_care_for_order(
    order: list[int], data: st.DataObject
) -> None:
    """While no clamp is reached."""
    views = [data.draw(cones()) for _ in order]
    parameters = MappingParameters(least_log_odds=-50.0, greatest_log_odds=50.0)
    for kind in (AdditiveFusion, RangeSensorFusion):
        first = fused(kind(parameters), views)
        assume(np.abs(first.log_odds).max() < 49.0)
        second = fused(kind(parameters), [views[index] for index in order])
        assert second.geometry == first.geometry
        np.testing.assert_allclose(second.log_odds, first.log_odds, atol=1e-3)


@FEW
@given(cones(with_covariance=False), st.integers(-40, 40), st.integers(-40, 40))
def test_moving_everything_by_whole_cells_moves_the_map(
    cone: EchoCone, rows: int, columns: int
) -> None:
    # A power of two, so that shifted coordinates are exact, or nearly so.
    resolution_m = 0.0625
    parameters = MappingParameters(resolution_m=resolution_m)
    x_m, y_m = np.round(cone.pose.position_m[:2] * 1024.0) / 1024.0
    maps = []
    for shift in ((0, 0), (columns, rows)):
        pose = Pose.planar(
            x_m + shift[0] * resolution_m, y_m + shift[1] * resolution_m, cone.pose.yaw_rad
        )
        shifted = EchoCone(**{**vars(cone), "pose": pose})
        maps.append(fused(JointFusion(parameters), [shifted]))
    assume(maps[0].geometry.shape != (1, 1))
    assert maps[1].geometry.shape == maps[0].geometry.shape
    moved = np.subtract(maps[1].geometry.origin_m, maps[0].geometry.origin_m) / resolution_m
    assert moved == pytest.approx([columns, rows], abs=1e-6)
    np.testing.assert_allclose(maps[1].log_odds, maps[0].log_odds, atol=1e-3)
