"""Pulses."""

import numpy as np
import pytest

from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.errors import MalformedMessageError

HANN = Pulse(PulseShape.HANN_BURST, 50_000.0, 0.00032)
TONE = Pulse(PulseShape.TONE_BURST, 50_000.0, 0.00032)
SQUARE = Pulse(PulseShape.SQUARE, 0.0, 0.00032)
CHIRP = Pulse(PulseShape.CHIRP, 50_000.0, 0.002, 20_000.0)


@pytest.mark.parametrize("pulse", [HANN, TONE, SQUARE, CHIRP])
def test_window_peaks_at_one_and_is_silent_outside(pulse):
    assert pulse.window(np.array(pulse.duration_s / 2.0)) == 1.0
    outside = np.array([-1e-9, pulse.duration_s + 1e-9, -1.0, 1.0])
    np.testing.assert_array_equal(pulse.window(outside), 0.0)
    np.testing.assert_array_equal(pulse.waveform(outside), 0.0)


def test_hann_window_is_a_raised_cosine():
    phase = np.linspace(0.0, 1.0, 21)
    expected = 0.5 - 0.5 * np.cos(2.0 * np.pi * phase)
    np.testing.assert_allclose(HANN.window(phase * HANN.duration_s), expected, atol=1e-12)


def test_waveform_is_a_sine_under_the_window():
    time = np.linspace(0.0, 0.00032, 500)
    sine = np.sin(2.0 * np.pi * 50_000.0 * time)
    np.testing.assert_allclose(TONE.waveform(time), sine, atol=1e-12)
    np.testing.assert_allclose(HANN.waveform(time), HANN.window(time) * sine, atol=1e-12)


def test_square_pulse_has_no_carrier():
    assert not SQUARE.has_carrier
    assert TONE.has_carrier
    np.testing.assert_array_equal(SQUARE.waveform(np.array([1e-5, 3e-4])), 1.0)


def test_a_chirp_sweeps_its_band_evenly():
    time = np.linspace(0.0, CHIRP.duration_s, 20_001)[1:-1]
    phase = np.unwrap(np.angle(CHIRP.envelope(time)))
    frequency = np.gradient(phase, time) / (2.0 * np.pi)

    np.testing.assert_allclose(frequency, np.linspace(-10e3, 10e3, len(time)), atol=20.0)
    np.testing.assert_allclose(np.abs(CHIRP.envelope(time)), CHIRP.window(time), atol=1e-12)


def test_a_chirps_waveform_is_its_envelope_on_the_carrier():
    time = np.linspace(-1e-4, 2.1e-3, 5000)
    carried = np.imag(CHIRP.envelope(time) * np.exp(2j * np.pi * CHIRP.carrier_hz * time))

    np.testing.assert_allclose(CHIRP.waveform(time), carried, atol=1e-12)


def test_a_chirp_resolves_by_its_sweep():
    assert CHIRP.resolution_s == pytest.approx(4.0 / 20e3)
    assert HANN.resolution_s == HANN.duration_s


@pytest.mark.parametrize(
    ("pulse", "field"),
    [
        (Pulse(PulseShape.HANN_BURST, 50e3, 1e-3, 1e3), "sweep"),
        (Pulse(PulseShape.CHIRP, 50e3, 1e-3, 1e5), "sweep"),
        (Pulse(PulseShape.CHIRP, 50e3, 1e-3, float("nan")), "sweep"),
        (Pulse(PulseShape.HANN_BURST, 0.0, 1e-3), "carrier_frequency"),
        (Pulse(PulseShape.TONE_BURST, float("nan"), 1e-3), "carrier_frequency"),
        (Pulse(PulseShape.SQUARE, 0.0, 0.0), "pulse_duration"),
        (Pulse(PulseShape.SQUARE, 0.0, float("inf")), "pulse_duration"),
    ],
)
def test_impossible_pulse_is_refused(pulse, field):
    with pytest.raises(MalformedMessageError, match=field):
        pulse.validate()
