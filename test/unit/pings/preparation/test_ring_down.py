"""What a transducer hears of itself is taken off its traces, sample by sample."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.errors import MalformedMessageError
from usmap_ros.parameters import RingingParameters
from usmap_ros.pings.preparation.ring_down import without_own_sound
from usmap_ros.pings.trace import Encoding


def waveform(trace, first, count):
    """Parameters with so many samples, or pairs, of a trace."""
    part = trace.cut(first, first + count)
    return RingingParameters(
        waveform=part.samples.tolist(),
        waveform_rate_hz=trace.sample_rate_hz,
        waveform_start_s=part.start_delay_s,
    )


@pytest.mark.parametrize("reception", ["iq", "raw", "square"])
@pytest.mark.parametrize("begins", [0, 7, 20])
def test_it_is_taken_off_where_it_is_and_nowhere_else(hear, reception, begins):
    trace = hear([(1.0, 0.0)], noise_std=0.01, reception=reception)
    ringing = waveform(trace, 12, 30)
    rest = without_own_sound(trace.cut(begins), ringing).signal()
    expected = trace.signal().copy()
    expected[12:42] = 0.0
    assert rest == pytest.approx(expected[begins:], abs=1e-7)


def test_it_may_be_longer_than_a_trace(hear):
    trace = hear([(1.0, 0.0)], noise_std=0.01)
    ringing = waveform(trace, 0, len(trace.signal()))
    assert not np.any(without_own_sound(trace.cut(5, 50), ringing).samples)


def test_the_trace_stays_as_it_is(hear):
    trace = hear([(1.0, 0.0)], noise_std=0.01)
    before = trace.samples.copy()
    without_own_sound(trace, waveform(trace, 3, 9))
    assert np.array_equal(trace.samples, before)


def test_a_trace_that_is_sampled_between_its_values_is_left(hear):
    trace = hear([(1.0, 0.0)], noise_std=0.01)
    between = replace(trace, start_delay_s=trace.start_delay_s + 0.4 / trace.sample_rate_hz)
    assert without_own_sound(between, waveform(trace, 3, 9)) is between


@pytest.mark.parametrize(
    ("change", "field"),
    [({"encoding": Encoding.ENVELOPE}, "encoding"), ({"sample_rate_hz": 1e4}, "sample_rate")],
)
def test_a_trace_that_it_cannot_be_of_is_refused(hear, change, field):
    trace = hear([(1.0, 0.0)], noise_std=0.01)
    with pytest.raises(MalformedMessageError, match=field):
        without_own_sound(replace(trace, **change), waveform(trace, 3, 9))


@pytest.mark.parametrize("content", [{"waveform": [1.0]}, {"waveform_rate_hz": 1e4}])
def test_a_waveform_needs_its_rate(content):
    with pytest.raises(ValueError, match="waveform_rate_hz"):
        RingingParameters(**content)
