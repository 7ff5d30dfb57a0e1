"""Traces of all encodings at the baseband."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.errors import MalformedMessageError
from usmap_ros.reconstruction.baseband import to_baseband
from usmap_ros.reconstruction.template import Template

RECEPTIONS = ["iq", "envelope", "raw", "square", "tone_iq"]


@pytest.mark.parametrize("reception", RECEPTIONS)
def test_one_echo_is_its_template(hear, reception):
    baseband = to_baseband(hear([(2.0, 0.0)], reception=reception))
    times_s = baseband.sampling.times_s
    expected = 0.25 * np.abs(baseband.template(times_s - 4.0 / 343.0))

    # The low-pass of a raw trace lets a little of the image at twice the carrier through.
    np.testing.assert_allclose(np.abs(baseband.signal), expected, atol=0.25 * 0.003)


@pytest.mark.parametrize("reception", ["iq", "raw"])
def test_phase_is_that_of_the_delay(hear, reception):
    phases = []
    for range_m in (2.0, 2.0 + 343.0 / 50_000.0 / 8.0):
        signal = to_baseband(hear([(range_m, 0.0)], reception=reception)).signal
        phases.append(np.angle(signal[np.argmax(np.abs(signal))]))

    # An eighth of a wavelength farther, and back.
    assert np.angle(np.exp(1j * (phases[1] - phases[0]))) == pytest.approx(-np.pi / 2.0, abs=0.02)


def test_raw_trace_is_decimated_but_keeps_samples_on_the_pulse(hear):
    trace = hear([(2.0, 0.0)], reception="raw")
    baseband = to_baseband(trace)

    assert baseband.sampling.sample_rate_hz < 0.2 * trace.sample_rate_hz
    assert baseband.sampling.sample_rate_hz * trace.transducer.pulse.duration_s >= 8.0


@pytest.mark.parametrize("reception", RECEPTIONS)
def test_noise_level_is_that_behind_the_matched_filter(hear, reception):
    heard = []
    for seed in range(3):
        baseband = to_baseband(hear([], reception=reception, noise_std=0.01, seed=seed))
        template = baseband.template
        times_s = np.arange(
            template.start_s, template.duration_s, 1.0 / baseband.sampling.sample_rate_hz
        )
        shape = template(times_s) / np.linalg.norm(template(times_s))
        heard.append(np.convolve(baseband.signal, shape, "valid") / baseband.noise_std)

    assert np.std(heard) == pytest.approx(1.0, rel=0.1)
    assert abs(np.mean(heard)) < 0.2


@pytest.mark.parametrize("reception", RECEPTIONS)
def test_unknown_noise_level_is_estimated(hear, reception):
    points = [(1.0, 0.1), (2.0, 0.0), (3.0, -0.5)]
    stated = to_baseband(hear(points, reception=reception, noise_std=0.01))
    estimated = to_baseband(hear(points, reception=reception, noise_std=0.01, stated_noise_std=0.0))

    assert estimated.noise_std == pytest.approx(stated.noise_std, rel=0.3)


def test_raw_trace_below_twice_the_carrier_is_refused(hear):
    trace = replace(hear([], reception="raw"), sample_rate_hz=90_000.0)
    with pytest.raises(MalformedMessageError, match="sample_rate"):
        to_baseband(trace)


def test_slope_is_the_derivative():
    template = Template(0.0, 3e-4, Pulse(PulseShape.HANN_BURST, 50e3, 3e-4))
    times_s = np.linspace(1e-5, 2.9e-4, 30)
    expected = np.pi / 3e-4 * np.sin(2.0 * np.pi * times_s / 3e-4)

    np.testing.assert_allclose(template.slope(times_s), expected, rtol=1e-4, atol=1e-2)


def test_only_smooth_templates_can_be_placed_between_samples():
    def smooth(shape):
        return Template(0.0, 3e-4, Pulse(shape, 50e3, 3e-4)).is_smooth

    assert smooth(PulseShape.HANN_BURST)
    assert not smooth(PulseShape.TONE_BURST)
    assert not smooth(PulseShape.SQUARE)
