"""Compiled, the search finds what it finds by the sensing operator alone."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.acoustics.propagation import Channel, FloorModel
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.reconstruction.baseband import to_baseband
from usmap_ros.reconstruction.cosamp import Halt
from usmap_ros.reconstruction.delay_domain import DelayDomainOperator
from usmap_ros.reconstruction.delay_search import compiled_search, operator_search
from usmap_ros.reconstruction.sampled.band import without_negatives
from usmap_ros.reconstruction.sampled.matched_filter import loudness

FLOOR = Channel(343.0, 1.3, floor_height_m=0.4, floor_reflectivity=0.6)
CORNERS = replace(FLOOR, floor_model=FloorModel.CORNER)
PINGS = 12


def scene(seed):
    """Echoes of which many overlap, and some are too faint to be found."""
    generator = np.random.default_rng(seed)
    range_m = generator.uniform(0.4, 4.8, 14)
    bearing = generator.uniform(-0.3, 0.3, len(range_m))
    points = range_m[:, np.newaxis] * np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    return points, generator.uniform(0.1, 2.0, len(range_m))


def both(trace, **fields):
    parameters = ReconstructionParameters(**fields)
    baseband = to_baseband(trace)
    operator = DelayDomainOperator(
        baseband.template, baseband.sampling, trace.channel, 0.2, 5.0, 4, 1.1e-4
    )
    return (
        compiled_search(operator, baseband, parameters),
        operator_search(operator, baseband, parameters),
    )


@pytest.mark.parametrize(
    "reception", ["iq", "envelope", "raw", "square", "tone_iq", "chirp_iq", "chirp_envelope"]
)
@pytest.mark.parametrize(
    "channel", [Channel(343.0), FLOOR, CORNERS], ids=["air", "floor", "corners"]
)
def test_the_same_echoes(hear, reception, channel):
    different, residuals = 0, []
    for seed in range(PINGS):
        trace = hear(*scene(seed), reception=reception, channel=channel, noise_std=0.01, seed=seed)
        found, expected = both(trace)
        np.testing.assert_allclose(found.thresholds, expected.thresholds, rtol=1e-5)
        residuals.append(found.solution.residual_norm / expected.solution.residual_norm)
        different += not (
            np.array_equal(found.solution.support, expected.solution.support)
            and np.all(np.abs(found.ranges_m - expected.ranges_m) <= 0.1 * stds_m(expected))
        )
    # Where rounding decides, both are as good.
    assert different <= 1
    assert 0.99 < np.mean(residuals) < 1.01


def stds_m(found):
    return 0.5 * 343.0 * found.delay_stds_s


def test_the_same_solution_where_nothing_is_refined(hear):
    found, expected = both(hear(*scene(3), noise_std=0.01), refinements=0)

    np.testing.assert_array_equal(found.solution.support, expected.solution.support)
    np.testing.assert_allclose(
        found.solution.coefficients, expected.solution.coefficients, rtol=1e-4, atol=1e-5
    )
    np.testing.assert_allclose(found.solution.residual, expected.solution.residual, atol=1e-5)
    # Of its own blocks nothing is said, which the limits about an echo do not go by.
    others = np.delete(np.arange(len(found.residual_scores)), found.solution.support)
    np.testing.assert_allclose(
        found.residual_scores[others], expected.residual_scores[others], atol=1e-4
    )
    np.testing.assert_allclose(found.strengths, expected.strengths, rtol=1e-4)
    np.testing.assert_allclose(found.delay_stds_s, expected.delay_stds_s, rtol=1e-2)
    assert found.solution.halt is expected.solution.halt
    assert found.solution.iterations == expected.solution.iterations


@pytest.mark.parametrize("reception", ["iq", "envelope"])
def test_silence(hear, reception):
    found, _ = both(hear([], reception=reception))

    assert found.solution.halt is Halt.SILENCE
    assert len(found.ranges_m) == 0


def test_what_is_not_finite_is_refused(hear):
    trace = hear(*scene(0))
    trace.samples[40] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        both(trace)


def test_loudest_within_reach():
    scores = np.random.default_rng(0).normal(size=200)
    expected = [scores[max(0, at - 7) : at + 8].max() for at in range(200)]

    np.testing.assert_array_equal(loudness(scores, 7), expected)


def test_least_squares_without_negatives():
    from scipy.optimize import nnls

    generator = np.random.default_rng(1)
    for _ in range(20):
        columns = generator.normal(size=(30, 8))
        signal = generator.normal(size=30)
        begins = np.zeros(8, dtype=np.int64)
        found = without_negatives(columns.T @ columns, begins, columns.T @ signal)
        np.testing.assert_allclose(found, nnls(columns, signal)[0], atol=1e-8)
