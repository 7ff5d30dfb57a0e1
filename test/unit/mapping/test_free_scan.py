"""What one ping says is free, and how nav2 is told."""

from collections.abc import Callable

import numpy as np
import pytest

from usmap_ros.io.conversions import scan_to_message
from usmap_ros.io.message_types import BagMessageTypes
from usmap_ros.mapping.free_scan import free_scan
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

PARAMETERS = MappingParameters()


def test_rays_end_before_the_first_echo_wherever_it_came_from(
    make_cone: Callable[..., EchoCone],
) -> None:
    free = free_scan(make_cone(1.5, 2.0, limit=1e-6), PARAMETERS)
    ahead = np.abs(free.angles_rad) < 0.5
    # A cell, and three times the echo's error.
    np.testing.assert_allclose(free.ranges_m[ahead], 1.5 - 0.05 - 0.003, atol=1e-6)


def test_without_an_echo_rays_end_where_a_faint_object_would_go_unheard(
    make_cone: Callable[..., EchoCone],
) -> None:
    cone = make_cone(limit=0.02)
    free = free_scan(cone, PARAMETERS)
    faint = PARAMETERS.reflectivity * np.exp(-PARAMETERS.reflectivity_spread)
    gain = cone.transducer.beam.gain(np.abs(free.angles_rad))
    unheard_m = np.sqrt(faint * gain / cone.limit_amplitudes()[0])
    heard = free.ranges_m > 0.0
    assert np.all(free.ranges_m[heard] <= unheard_m[heard] + 1e-9)
    assert np.all(free.ranges_m[heard] > unheard_m[heard] - cone.limit_step_m - 0.1)
    # At the rim of the beam nothing is heard, and nothing is known.
    assert free.ranges_m[0] == free.ranges_m[-1] == 0.0
    middle = len(free.ranges_m) // 2
    assert free.ranges_m[middle] == free.ranges_m.max()


def test_a_deaf_ping_clears_nothing(make_cone: Callable[..., EchoCone]) -> None:
    assert not free_scan(make_cone(limit=1e3), PARAMETERS).ranges_m.any()


def test_a_scan_has_the_rays_in_the_frame_of_the_transducer(
    make_cone: Callable[..., EchoCone],
) -> None:
    cone = make_cone(1.5, limit=1e-6)
    free = free_scan(cone, PARAMETERS)
    scan = scan_to_message(cone, *free, BagMessageTypes())
    assert scan.header.frame_id == cone.child_frame_id
    angles_rad = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
    np.testing.assert_allclose(angles_rad, free.angles_rad, atol=1e-9)
    assert angles_rad[-1] == pytest.approx(scan.angle_max)
    assert (scan.range_min, scan.range_max) == (0.1, 3.0)
    # Readings below the least range are none.
    valid = np.array(scan.ranges) >= scan.range_min
    np.testing.assert_array_equal(valid, free.ranges_m > 0.0)


def test_rays_through_the_whole_range_are_no_readings_that_nav2_drops(
    make_cone: Callable[..., EchoCone],
) -> None:
    cone = make_cone(limit=1e-6)
    free = free_scan(cone, PARAMETERS)
    assert free.ranges_m.max() == cone.transducer.max_range_m
    scan = scan_to_message(cone, *free, BagMessageTypes())
    # laser_geometry keeps what is below the greatest range: all that the obstacle layer gets.
    assert max(scan.ranges) < np.float32(scan.range_max)
    assert max(scan.ranges) == pytest.approx(scan.range_max)
