"""What silence and echoes say of a cell by itself, held against integrals over its reflectivity."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from usmap_ros.mapping.footprint import footprint
from usmap_ros.mapping.ring import find_ring
from usmap_ros.mapping.yardsticks.additive import fit_to_ring, log_reflectivity_bound, silence
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone, encode_limits

MakeCone = Callable[..., EchoCone]
LN_S = np.linspace(-15.0, 15.0, 60_001)


@pytest.mark.parametrize("detection_probability", [0.05, 0.5, 0.95])
@pytest.mark.parametrize(("mean", "std"), [(-0.7, 0.9), (0.3, 0.3), (0.0, 2.0)])
def test_silence_is_the_integral_over_all_reflectivities(
    mean: float, std: float, detection_probability: float
) -> None:
    parameters = MappingParameters(
        reflectivity=np.exp(mean),
        reflectivity_spread=std,
        detection_probability=detection_probability,
    )
    density = np.exp(-0.5 * ((LN_S - mean) / std) ** 2)
    bounds = np.array([-6.0, -2.0, -0.7, 0.0, 1.5, 5.0])
    below = ndtr((bounds[:, np.newaxis] - LN_S) / parameters.fluctuation)
    silent = 1.0 - detection_probability + detection_probability * below
    expected = np.log(silent @ density / density.sum())
    np.testing.assert_allclose(silence(bounds, parameters), expected, rtol=1e-6, atol=1e-9)


def test_far_tails_stay_finite_and_never_speak_for_an_object() -> None:
    log_ratio = silence(np.array([-1e6, -200.0, 0.0, 40.0, 1e6]), MappingParameters())
    least = np.log(1.0 - MappingParameters().detection_probability)
    assert np.all((log_ratio >= least - 1e-9) & (log_ratio <= 0.0))


@pytest.mark.parametrize("log_reflectivity", [-0.7, 0.3, 6.0])
def test_the_fit_is_the_normal_likelihood_relative_to_that_of_a_known_reflectivity(
    make_cone: MakeCone, log_reflectivity: float
) -> None:
    parameters = MappingParameters(reflectivity=np.exp(-0.7), reflectivity_spread=0.9)
    cone = make_cone((1.0, 0.4))
    ring = find_ring(cone, footprint(cone, 0.05), parameters)
    pairs = len(ring.cell)
    ring = replace(
        ring,
        range_fit=np.ones(pairs),
        log_reflectivity=np.full(pairs, log_reflectivity),
        variance=np.full(pairs, 0.02),
    )
    expected = np.sqrt(0.02 / 0.83) * np.exp(-0.5 * (log_reflectivity + 0.7) ** 2 / 0.83)
    expected *= parameters.detection_probability
    np.testing.assert_allclose(fit_to_ring(ring, parameters), expected, rtol=1e-12)


def test_an_echo_of_no_strength_fits_no_cell_and_stays_finite(make_cone: MakeCone) -> None:
    cone = make_cone((1.0, 0.0), amplitude_std=0.0)
    ring = find_ring(cone, footprint(cone, 0.05), MappingParameters())
    assert len(ring.cells) > 10
    assert np.all(np.isfinite(ring.log_reflectivity))
    assert np.all(fit_to_ring(ring, MappingParameters()) < 1e-100)


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
