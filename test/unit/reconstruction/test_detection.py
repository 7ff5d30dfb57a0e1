"""Thresholds, and what may have gone unheard."""

import numpy as np
import pytest

from usmap_ros.reconstruction.baseband import to_baseband
from usmap_ros.reconstruction.delay_domain import DelayDomainOperator
from usmap_ros.reconstruction.detection import (
    binned_maximum,
    noise_thresholds,
    unreported,
)


def operator_of(baseband, trace):
    return DelayDomainOperator(
        baseband.template, baseband.sampling, trace.channel, 0.2, 5.0, 4, 1e-4
    )


@pytest.mark.parametrize("reception", ["iq", "envelope", "square"])
def test_noise_exceeds_its_threshold_as_seldom_as_asked(hear, reception):
    pings, loud = 150, 0
    for seed in range(pings):
        trace = hear([], reception=reception, noise_std=0.01, seed=seed)
        baseband = to_baseband(trace)
        operator = operator_of(baseband, trace)
        scores = operator.scores(operator.adjoint(baseband.signal))
        loud += np.any(scores > noise_thresholds(operator, baseband, 0.2))

    # Neighbouring delays are not independent, so the share may be off by a factor.
    assert 0.05 <= loud / pings <= 0.5


def test_loudness_reaches_as_far_as_a_pulse(hear):
    trace = hear([])
    operator = operator_of(to_baseband(trace), trace)
    scores = np.zeros(operator.block_count)
    scores[500] = 2.0
    loud = np.flatnonzero(operator.loudness(scores) == 2.0)

    assert (loud[0], loud[-1]) == (500 - operator.pulse_blocks, 500 + operator.pulse_blocks)


def test_a_second_object_under_an_echo_may_go_unreported(hear):
    trace = hear([])
    operator = operator_of(to_baseband(trace), trace)
    thresholds = np.full(operator.block_count, 0.1)
    residual = np.zeros(operator.block_count)
    residual[100] = 0.3
    limits = unreported(operator, thresholds, residual, np.array([800]), np.array([5.0]), 2.0)
    limits *= operator.unit_norms

    np.testing.assert_allclose(limits[[50, 100, 800]], [0.1, 0.3, 10.1])


def test_bins_take_the_largest_and_are_unlimited_where_empty():
    binned = binned_maximum(
        np.array([1.0, 3.0, 2.0, 9.0]), np.array([0.21, 0.22, 0.41, 0.95]), 0.2, 0.1, 0.6
    )
    np.testing.assert_array_equal(binned, [3.0, np.inf, 2.0, np.inf])
