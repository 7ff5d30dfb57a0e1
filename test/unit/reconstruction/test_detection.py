"""Thresholds, and what may have gone unheard."""

import numpy as np
import pytest

from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.reconstruction.baseband import to_baseband
from usmap_ros.reconstruction.delay_domain import DelayDictionary
from usmap_ros.reconstruction.delay_search import search
from usmap_ros.reconstruction.detection import binned_maximum, unreported


def dictionary_of(baseband, trace):
    return DelayDictionary(
        baseband.templates, baseband.sampling, trace.channel, 0.2, 5.0, 4, [1e-4]
    )


@pytest.mark.parametrize("reception", ["iq", "envelope", "square"])
def test_noise_exceeds_its_threshold_as_seldom_as_asked(hear, reception):
    pings, loud, parameters = 150, 0, ReconstructionParameters(false_alarms_per_ping=0.2)
    for seed in range(pings):
        trace = hear([], reception=reception, noise_std=0.01, seed=seed)
        baseband = to_baseband(trace)
        loud += len(search(dictionary_of(baseband, trace), baseband, parameters).ranges_m) > 0

    # Neighbouring delays are not independent, so the share may be off by a factor.
    assert 0.05 <= loud / pings <= 0.5


def test_a_second_object_under_an_echo_may_go_unreported(hear):
    trace = hear([])
    dictionary = dictionary_of(to_baseband(trace), trace)
    thresholds = np.full(dictionary.block_count, 0.1)
    residual = np.zeros(dictionary.block_count)
    residual[100] = 0.3
    limits = unreported(dictionary, thresholds, residual, np.array([800]), np.array([5.0]), 2.0)
    limits *= dictionary.unit_norms

    np.testing.assert_allclose(limits[[50, 100, 800]], [0.1, 0.3, 10.1])


def test_bins_take_the_largest_and_are_unlimited_where_empty():
    binned = binned_maximum(
        np.array([1.0, 3.0, 2.0, 9.0]), np.array([0.21, 0.22, 0.41, 0.95]), 0.2, 0.1, 0.6
    )
    np.testing.assert_array_equal(binned, [3.0, np.inf, 2.0, np.inf])
