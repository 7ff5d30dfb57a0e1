"""The receiver: encodings, noise and converter."""

import numpy as np
import pytest

from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.pings.trace import Encoding
from usmap_ros.simulation.receiver import Arrivals, Converter, Receiver

HANN = Pulse(PulseShape.HANN_BURST, 50_000.0, 0.00032)
TONE = Pulse(PulseShape.TONE_BURST, 50_000.0, 0.0004)
SQUARE = Pulse(PulseShape.SQUARE, 0.0, 0.00032)


def receive(encoding, delays, amplitudes, *, rate=25_000.0, noise=0.0, pulse=HANN, **others):
    count, seed = others.pop("count", 750), others.pop("seed", 0)
    receiver = Receiver(encoding, rate, others.pop("start", 0.0), noise, **others)
    rng = np.random.default_rng(seed)
    arrivals = [Arrivals(pulse, np.array(delays), np.array(amplitudes))]
    return receiver.receive(arrivals, pulse, count, rng)


@pytest.mark.parametrize("pulse", [HANN, TONE, SQUARE])
def test_raw_is_the_pulse_delayed(pulse):
    delay, rate = 0.0101234, 250_000.0
    samples = receive(Encoding.RAW, [delay], [0.7], rate=rate, pulse=pulse, count=5000)
    expected = 0.7 * pulse.waveform(np.arange(5000) / rate - delay)
    np.testing.assert_allclose(samples, expected, atol=1e-6)


def test_iq_is_the_window_delayed_and_the_carrier_turned_by_the_delay():
    delay, rate = 0.0101234, 25_000.0
    signal = receive(Encoding.IQ, [delay], [0.7], rate=rate).view(np.complex64)
    window = HANN.window(np.arange(750) / rate - delay)
    expected = 0.7 * window * np.exp(-2j * np.pi * 50_000.0 * delay)
    np.testing.assert_allclose(signal, expected, atol=1e-6)


@pytest.mark.parametrize("pulse", [HANN, SQUARE])
def test_envelope_is_the_magnitude_of_iq_noise_included(pulse):
    echoes = [0.002, 0.00213, 0.02], [1.0, 0.6, 0.1]
    pairs = receive(Encoding.IQ, *echoes, noise=0.05, pulse=pulse).view(np.complex64)
    envelope = receive(Encoding.ENVELOPE, *echoes, noise=0.05, pulse=pulse)
    np.testing.assert_allclose(envelope, np.abs(pairs), rtol=1e-5)


def test_a_square_pulse_has_no_phase():
    pairs = receive(Encoding.IQ, [0.002], [1.0], pulse=SQUARE).view(np.complex64)
    np.testing.assert_array_equal(pairs.imag, 0.0)
    raw = receive(Encoding.RAW, [0.002], [1.0], pulse=SQUARE)
    np.testing.assert_array_equal(pairs.real, raw)


def test_echoes_at_either_end_are_cut_off():
    samples = receive(Encoding.RAW, [-0.0001, 0.0299], [1.0, 1.0], rate=250_000.0, count=7500)
    time = np.arange(7500) / 250_000.0
    expected = HANN.waveform(time + 0.0001) + HANN.waveform(time - 0.0299)
    np.testing.assert_allclose(samples, expected, atol=1e-6)


def test_samples_begin_at_the_start_delay():
    late = receive(Encoding.IQ, [0.01], [1.0], start=0.004, count=650)
    early = receive(Encoding.IQ, [0.01], [1.0], count=750)
    np.testing.assert_allclose(late, early[200:], atol=1e-6)
    assert Receiver(Encoding.IQ, 25_000.0, 0.004, 0.0).sample_count(0.03) == 650


@pytest.mark.parametrize(
    ("encoding", "stated"),
    [(Encoding.RAW, 0.01 / np.sqrt(2.0)), (Encoding.IQ, 0.01), (Encoding.ENVELOPE, 0.01)],
)
def test_noise_is_what_is_stated(encoding, stated):
    receiver = Receiver(encoding, 25_000.0, 0.0, 0.01)
    assert receiver.stated_noise_std == pytest.approx(stated)
    samples = receive(encoding, [], [], noise=0.01, count=100_000)
    if encoding is Encoding.IQ:
        samples = np.abs(samples.view(np.complex64))
    assert np.sqrt(np.mean(samples**2)) == pytest.approx(stated, rel=0.01)


def test_no_echo_and_no_noise_is_silence():
    for encoding in Encoding:
        samples = receive(encoding, [], [])
        assert samples.dtype == np.float32
        assert not samples.any()


@pytest.mark.parametrize(("signed", "bits"), [(True, 8), (False, 8), (True, 12)])
def test_converter_rounds_to_its_levels(signed, bits):
    converter = Converter(bits=bits, full_scale=2.0)
    step = converter.step(signed=signed)
    assert step == (4.0 if signed else 2.0) / 2**bits
    values = np.linspace(-1.0 if signed else 0.0, 1.9, 1001)
    converted = converter.convert(values, signed=signed)
    assert np.abs(converted - values).max() <= step / 2.0 + 1e-12
    np.testing.assert_allclose(np.rint(converted / step), converted / step)


def test_converter_saturates():
    converter = Converter(bits=8, full_scale=1.0)
    step = 2.0 / 256.0
    signed = converter.convert(np.array([-9.0, 9.0]), signed=True)
    np.testing.assert_allclose(signed, [-1.0, 1.0 - step])
    unsigned = converter.convert(np.array([-9.0, 9.0]), signed=False)
    np.testing.assert_allclose(unsigned, [0.0, 1.0 - step / 2.0])


@pytest.mark.parametrize("encoding", Encoding)
def test_a_converter_limits_every_encoding(encoding):
    converter = Converter(bits=8, full_scale=1.0)
    samples = receive(encoding, [0.01], [10.0], rate=250_000.0, converter=converter)
    pairs = receive(encoding, [0.001], [10.0], rate=250_000.0, converter=converter)
    for values in (samples, pairs):
        assert np.abs(values).max() <= 1.0
    levels = pairs / converter.step(signed=encoding is not Encoding.ENVELOPE)
    np.testing.assert_allclose(levels, np.rint(levels), atol=1e-4)
    assert np.abs(pairs).max() > 0.98


@pytest.mark.parametrize("encoding", [Encoding.RAW, Encoding.IQ])
def test_rounding_is_part_of_the_stated_noise(encoding):
    converter = Converter(bits=8, full_scale=2.0)
    receiver = Receiver(encoding, 25_000.0, 0.0, 0.02, converter)
    samples = receive(encoding, [], [], noise=0.02, count=100_000, converter=converter)
    if encoding is Encoding.IQ:
        samples = np.abs(samples.view(np.complex64))
    assert np.sqrt(np.mean(samples**2)) == pytest.approx(receiver.stated_noise_std, rel=0.02)
    assert receiver.stated_noise_std > 0.0141
