"""The sensing matrix of delays, and what a search makes of it, against columns in full."""

import numpy as np
import pytest

from usmap_ros.acoustics.propagation import Channel, FloorModel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.reconstruction.baseband import Baseband
from usmap_ros.reconstruction.delay_domain import RIDGE, DelayDictionary
from usmap_ros.reconstruction.delay_search import MOST_RIDGE, search
from usmap_ros.reconstruction.sampled.band import without_negatives
from usmap_ros.reconstruction.sampled.matched_filter import loudness
from usmap_ros.reconstruction.template import Template

HANN = Template(0.0, 3.2e-4, Pulse(PulseShape.HANN_BURST, 50e3, 3.2e-4))
LONGER = Template(0.0, 5e-4, Pulse(PulseShape.HANN_BURST, 47e3, 5e-4), mixed_by_hz=50e3)
CHIRP = Template(0.0, 4e-4, Pulse(PulseShape.CHIRP, 50e3, 4e-4, 9e3))
AIR = Channel(343.0)
FLOOR = Channel(343.0, 1.3, floor_height_m=0.5, floor_reflectivity=0.8)
CORNERS = Channel(343.0, floor_height_m=0.4, floor_reflectivity=0.6, floor_model=FloorModel.CORNER)
#: Nothing but what the matrix says: no threshold for an imperfect pulse, no step off the grid.
ON_GRID = ReconstructionParameters(model_error=0.0, refinements=0)


def make(templates=(HANN,), channel=AIR, start_delay_s=0.0):
    sampling = Sampling(25_000.0, start_delay_s, 300)
    return DelayDictionary(templates, sampling, channel, 0.2, 1.8, 4, [1e-4] * len(templates))


def received(dictionary, signal):
    return Baseband(signal, dictionary.sampling, 0.01, 0.007, dictionary.templates)


def columns(dictionary, block):
    """Columns of a block's paths on the grid, (samples, paths)."""
    template = dictionary.templates[dictionary.pulse_numbers(block)]
    delays_s = dictionary.sampled.delays_s[block % len(dictionary.ranges_m)]
    return template(dictionary.sampling.times_s[:, np.newaxis] - delays_s)


def noise(seed, count=300):
    parts = np.random.default_rng(seed).normal(size=(2, count))
    return parts[0] + 1j * parts[1]


@pytest.mark.parametrize("templates", [(HANN,), (CHIRP,), (HANN, LONGER, CHIRP)])
@pytest.mark.parametrize("channel", [AIR, FLOOR, CORNERS], ids=["air", "floor", "corners"])
def test_scores_are_what_columns_that_are_formed_say(templates, channel):
    dictionary, signal = make(templates, channel), 1e-6 * noise(0)
    found = search(dictionary, received(dictionary, signal), ON_GRID)

    assert len(found.support) == 0
    ranges = len(dictionary.ranges_m)
    for block in range(0, dictionary.block_count, 37):
        if dictionary.sampled.delays_s[block % ranges].max() > 0.011:
            # Of paths that go on behind the last sample, norms are of the whole echo.
            continue
        formed = columns(dictionary, block)
        heard = np.abs(formed.conj().T @ signal) / np.linalg.norm(formed, axis=0)
        expected = dictionary.path_weights[block] @ heard
        np.testing.assert_allclose(found.residual_scores[block], expected, rtol=2e-3, atol=1e-8)


@pytest.mark.parametrize("templates", [(HANN,), (CHIRP,), (HANN, LONGER)])
@pytest.mark.parametrize("channel", [AIR, FLOOR], ids=["air", "floor"])
def test_echoes_are_the_least_squares_of_their_columns(templates, channel):
    dictionary = make(templates, channel)
    blocks = [40, 160, dictionary.block_count - 100]
    paths = dictionary.path_weights.shape[1]
    strengths = np.array([3.0, 2.0, 1.5][:paths]) * np.exp(1j * np.arange(paths))
    signal = sum(columns(dictionary, block) @ strengths for block in blocks) + 0.01 * noise(1)
    found = search(dictionary, received(dictionary, signal), ON_GRID)

    formed = np.hstack([columns(dictionary, block) for block in found.support])
    gram = formed.conj().T @ formed
    noise_share = 0.01**2 / np.mean(np.abs(signal) ** 2)
    gram += np.diag((RIDGE if paths == 1 else min(noise_share, MOST_RIDGE)) * gram.diagonal())
    expected = np.linalg.solve(gram, formed.conj().T @ signal)
    assert set(blocks) <= {block + step for block in found.support for step in (-1, 0, 1)}
    np.testing.assert_allclose(found.residual, signal - formed @ expected, atol=1e-3)


def test_blocks_lie_within_the_range_limits():
    ranges_m = make().ranges_m

    assert ranges_m[0] >= 0.2
    assert ranges_m[-1] <= 1.8 + 1e-9
    np.testing.assert_allclose(np.diff(ranges_m), 343.0 / 2.0 / 100_000.0)


def test_late_trace_starts_where_it_can_hear():
    dictionary = make(start_delay_s=0.004)

    np.testing.assert_allclose(dictionary.ranges_m[0], 0.002 * 343.0, atol=HANN.duration_s * 343.0)
    assert np.linalg.norm(columns(dictionary, 20)) > 0.5


def test_bands_hold_their_block_and_end_with_the_blocks_of_their_pulse():
    dictionary = make((HANN, LONGER))
    count = len(dictionary.ranges_m)
    begins, ends = dictionary.bands(np.array([0, 100, count - 1, count, 2 * count - 1]))

    np.testing.assert_array_equal(begins, [0, 90, count - 11, count, 2 * count - 11])
    np.testing.assert_array_equal(ends, [11, 111, count, count + 11, 2 * count])


def test_unit_norm_is_the_norm_of_the_echo_of_amplitude_one():
    dictionary = make((HANN, LONGER))
    for block in (30, len(dictionary.ranges_m) + 30):
        formed = columns(dictionary, block)
        np.testing.assert_allclose(dictionary.unit_norms[block], np.linalg.norm(formed))


def test_what_is_not_finite_is_refused():
    dictionary = make()
    with pytest.raises(ValueError, match="not finite"):
        search(dictionary, received(dictionary, np.full(300, np.nan)), ON_GRID)


def test_loudest_within_reach():
    scores = np.random.default_rng(0).normal(size=200)
    expected = [scores[max(0, at - 7) : at + 8].max() for at in range(200)]

    np.testing.assert_array_equal(loudness(scores, 7), expected)


def test_least_squares_without_negatives():
    from scipy.optimize import nnls

    generator = np.random.default_rng(1)
    for _ in range(20):
        formed = generator.normal(size=(30, 8))
        signal = generator.normal(size=30)
        begins = np.zeros(8, dtype=np.int64)
        found = without_negatives(formed.T @ formed, begins, formed.T @ signal)
        np.testing.assert_allclose(found, nnls(formed, signal)[0], atol=1e-8)
