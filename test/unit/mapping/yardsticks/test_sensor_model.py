"""How loud an object must be to be heard."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.mapping.footprint import footprint
from usmap_ros.mapping.yardsticks.sensor_model import log_reflectivity_bound, prior_reflectivity
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone, encode_limits

MakeCone = Callable[..., EchoCone]


def with_limits(cone: EchoCone, first: float, rest: float, change_m: float) -> EchoCone:
    """A cone whose limit changes at a range."""
    starts_m = 0.1 + cone.limit_step_m * np.arange(len(cone.detection_limits))
    limits = encode_limits(np.where(starts_m < change_m, first, rest))
    return replace(cone, detection_limits=limits)


def test_an_object_at_the_bound_would_return_an_echo_at_the_limit(make_cone: MakeCone) -> None:
    cone = make_cone(limit=0.01)
    cells = footprint(cone, 0.05)
    echo = log_reflectivity_bound(cone, cells) + cells.log_unit_amplitude
    np.testing.assert_allclose(np.exp(echo), 0.01, rtol=1e-6)


@pytest.mark.parametrize("range_std_m", [0.0, 0.2])
def test_the_highest_limit_counts_among_the_ranges_where_a_cell_may_lie(
    make_cone: MakeCone, range_std_m: float
) -> None:
    covariance = np.diag([range_std_m**2, range_std_m**2, 0.0])
    cone = with_limits(make_cone(planar_covariance=covariance), 1.0, 0.01, change_m=1.0)
    cells = footprint(cone, 0.05)
    limit = np.exp(log_reflectivity_bound(cone, cells) + cells.log_unit_amplitude)
    near = cells.range_m < 1.0
    beyond = cells.range_m > 1.15 + 1.5 * range_std_m
    at_the_change = (cells.range_m > 1.0) & (cells.range_m < 1.0 + 1.5 * range_std_m)
    np.testing.assert_allclose(limit[near | at_the_change], 1.0, rtol=1e-6)
    np.testing.assert_allclose(limit[beyond], 0.01, rtol=1e-6)


def test_nothing_learnt_leaves_the_prior() -> None:
    parameters = MappingParameters(reflectivity=0.5, reflectivity_spread=0.9)
    belief = prior_reflectivity(parameters, np.array([0.0, -1e-7]), np.zeros(2))
    np.testing.assert_allclose(belief.mean, np.log(0.5))
    np.testing.assert_allclose(belief.variance, 0.81)
