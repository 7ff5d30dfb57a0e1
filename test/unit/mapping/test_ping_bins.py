"""A ping in bins of range."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.mapping.ping_bins import (
    DEAF_AMPLITUDE,
    ECHO,
    GAIN_STEPS,
    SILENCE,
    UNJUDGED,
    PingBins,
)
from usmap_ros.mapping.ping_table import ping_in_row, ping_table_of
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone, encode_limits

MakeCone = Callable[..., EchoCone]
PARAMETERS = MappingParameters()


def ping_bins_of(cone: EchoCone, parameters: MappingParameters) -> PingBins:
    return ping_in_row(ping_table_of([cone], parameters), 0)


def test_echoes_fall_into_bins_of_a_quarter_of_a_cell(make_cone: MakeCone) -> None:
    ping = ping_bins_of(make_cone((1.006, 0.3), (1.007, 0.4), (2.005, 0.1)), PARAMETERS)
    assert ping.bin_m == 0.0125
    assert len(ping.kind) == 232
    first, second = int((1.0065 - 0.1) / 0.0125), int((2.005 - 0.1) / 0.0125)
    assert np.flatnonzero(ping.kind == ECHO).tolist() == [first, second]
    assert ping.power[first] == pytest.approx(0.3**2 + 0.4**2)
    assert ping.power[second] == pytest.approx(0.1**2)
    beside = [first - 1, first + 1, second - 1, second + 1]
    assert np.flatnonzero(ping.kind == UNJUDGED).tolist() == beside
    assert np.count_nonzero(ping.kind == SILENCE) == 232 - 6


def test_neighbouring_echoes_both_count(make_cone: MakeCone) -> None:
    ping = ping_bins_of(make_cone((1.006, 0.3), (1.018, 0.4)), PARAMETERS)
    assert np.count_nonzero(ping.kind == ECHO) == 2


def test_limits_are_squared_and_noise_lies_below_them(make_cone: MakeCone) -> None:
    ping = ping_bins_of(make_cone(limit=0.02), PARAMETERS)
    np.testing.assert_allclose(ping.limit, 0.02**2, rtol=0.2)
    assert ping.noise == pytest.approx(ping.limit[0] / 16.0)


def test_what_was_not_listened_to_is_not_judged(make_cone: MakeCone) -> None:
    cone = make_cone()
    limits = np.full(len(cone.detection_limits), 0.01)
    limits[:10] = 10.0 * DEAF_AMPLITUDE
    ping = ping_bins_of(replace(cone, detection_limits=encode_limits(limits)), PARAMETERS)
    deaf = 10 * cone.limit_step_m / ping.bin_m
    np.testing.assert_array_equal(
        ping.kind, np.where(np.arange(len(ping.kind)) + 0.5 < deaf, UNJUDGED, SILENCE)
    )


def test_the_table_of_gains_is_the_beams_squared(make_cone: MakeCone) -> None:
    beam = BeamPattern.linear()
    ping = ping_bins_of(make_cone(beam=beam), PARAMETERS)
    cosine = 1.0 - np.linspace(0.0, 1.0 - ping.cos_half_angle, GAIN_STEPS + 1)
    np.testing.assert_allclose(ping.power_gain, beam.gain(np.arccos(cosine)) ** 2, atol=1e-6)


def test_gains_are_averaged_over_the_headings_that_the_pose_allows(make_cone: MakeCone) -> None:
    beam, std = BeamPattern.linear(), 0.1
    exact = ping_bins_of(make_cone(beam=beam), PARAMETERS)
    ping = ping_bins_of(
        make_cone(beam=beam, planar_covariance=np.diag([0.0, 0.0, std**2])), PARAMETERS
    )
    assert ping.half_angle_rad == pytest.approx(exact.half_angle_rad + 2.0 * std)
    headings = std * np.random.default_rng(1).standard_normal(20_000)
    for off_axis in (0.0, 0.5 * exact.half_angle_rad, exact.half_angle_rad + std):
        step = (1.0 - np.cos(off_axis)) / (1.0 - ping.cos_half_angle) * GAIN_STEPS
        gain = np.interp(step, np.arange(GAIN_STEPS + 1), ping.power_gain)
        assert gain == pytest.approx(np.mean(beam.gain(off_axis + headings) ** 2), rel=0.05)


def test_what_a_position_is_off_across_turns_bearings_too(make_cone: MakeCone) -> None:
    cone = make_cone(planar_covariance=np.diag([0.03**2, 0.03**2, 0.0]))
    exact, ping = ping_bins_of(make_cone(), PARAMETERS), ping_bins_of(cone, PARAMETERS)
    turned = 0.03 / (0.5 * cone.transducer.max_range_m)
    assert ping.half_angle_rad - exact.half_angle_rad == pytest.approx(2.0 * turned, abs=1e-3)


@pytest.mark.parametrize("yaw_rad", [0.0, 2.0, -3.0])
def test_the_axis_is_where_the_transducer_looks(make_cone: MakeCone, yaw_rad: float) -> None:
    ping = ping_bins_of(make_cone(yaw_rad=yaw_rad), PARAMETERS)
    assert (ping.axis_x, ping.axis_y) == pytest.approx((np.cos(yaw_rad), np.sin(yaw_rad)))
    assert ping.axis_z == 0.0
    assert ping.heading_rad == pytest.approx(yaw_rad)


def test_a_tilted_axis_rises(make_cone: MakeCone) -> None:
    """A rotation about y by a negative angle turns x up."""
    up = 0.3
    pose = Pose(np.zeros(3), np.array([0.0, np.sin(-up / 2), 0.0, np.cos(-up / 2)]))
    ping = ping_bins_of(replace(make_cone(), pose=pose), PARAMETERS)
    assert (ping.axis_x, ping.axis_z) == pytest.approx((np.cos(up), np.sin(up)))


def test_the_error_of_range_is_the_poses_and_what_nobody_states(make_cone: MakeCone) -> None:
    cone = make_cone(planar_covariance=np.diag([0.03**2, 0.03**2, 0.0]))
    ping = ping_bins_of(cone, MappingParameters(range_error_m=0.04))
    assert ping.range_std_m == pytest.approx(0.05)


def test_a_measured_bearing_stands_in_its_echos_bin(make_cone: MakeCone) -> None:
    cone = make_cone((1.006, 0.3), (2.005, 0.1))
    cone = replace(
        cone,
        bearings_rad=np.array([0.2, np.nan], np.float32),
        bearing_stds_rad=np.array([0.1, np.nan], np.float32),
    )
    ping = ping_bins_of(cone, PARAMETERS)
    (known,) = np.flatnonzero(ping.bearing_weight)
    assert ping.kind[known] == ECHO
    assert ping.bearing[known] == pytest.approx(0.2)
    assert ping.bearing_weight[known] == pytest.approx(0.5 / 0.1**2)
    pose = make_cone(planar_covariance=np.diag([0.0, 0.0, 0.05**2])).pose
    uncertain = ping_bins_of(replace(cone, pose=pose), PARAMETERS)
    assert uncertain.bearing_weight[known] == pytest.approx(0.5 / (0.1**2 + 0.05**2))
