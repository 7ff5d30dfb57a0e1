from collections.abc import Callable

import numpy as np
import pytest

from usmap_ros.mapping.yardsticks.range_only import (
    FARTHEST_M,
    LEAST_NEWS,
    RangeSensorFusion,
    occupied_probability,
)
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone


def test_a_reading_frees_what_is_before_it_and_fills_what_is_at_it() -> None:
    before, at, behind, beside = occupied_probability(
        np.array([0.5, 1.0, 1.2, 1.0]), np.array([0.0, 0.0, 0.0, 1.0]), 1.0, 0.05
    )
    assert before < 0.1
    assert at > 0.75
    assert behind == beside == 0.5


def test_silence_frees_the_whole_beam() -> None:
    probability = occupied_probability(np.array([0.5, 1.0]), np.zeros(2), np.inf, 0.05)
    assert (probability < 0.5).all()


@pytest.mark.parametrize("echo_m", [FARTHEST_M, np.inf])
def test_what_is_far_off_is_no_news(echo_m: float) -> None:
    at, beyond = occupied_probability(FARTHEST_M + np.array([-0.01, 0.0]), np.zeros(2), echo_m, 0.1)
    assert abs(at - 0.5) > LEAST_NEWS >= abs(beyond - 0.5) - 1e-12


@pytest.mark.parametrize("others", [(), (1.5, 2.0)])
def test_only_the_first_echo_counts(
    make_cone: Callable[..., EchoCone], others: tuple[float, ...]
) -> None:
    fusion = RangeSensorFusion(MappingParameters())
    fusion.fuse(make_cone(0.825, *others))
    occupancy = fusion.occupancy_map()
    x, _ = occupancy.geometry.cell_centers_m(
        *np.nonzero(occupancy.observed & (occupancy.probability() > 0.65))
    ).T
    assert x.max() < 0.9
    assert (occupancy.frame_id, occupancy.stamp_ns) == ("map", 7)
