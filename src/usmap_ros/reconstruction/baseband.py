"""From the samples of a trace to a baseband signal, one front end for all three encodings.

An echo in the baseband is w(t − τ) times an unknown complex coefficient: its carrier phase is
free, which is what lets delays be found between samples although a wavelength is 7 mm.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.numerics.arrays import FloatArray, Signal
from usmap_ros.numerics.compiled import compiled
from usmap_ros.pings.trace import EchoTrace, Encoding
from usmap_ros.reconstruction.pulses import check_pulses
from usmap_ros.reconstruction.template import Template

#: Baseband samples per second and hertz of the pulse's bandwidth, at least, after decimation of a
#: raw trace: eight samples on a pulse without a sweep.
SAMPLES_PER_BANDWIDTH = 2
#: Taps of the decimation filter per decimated sample, and its pass band (of the half rate).
TAPS_PER_SAMPLE = 8
PASS_BAND = 0.8
#: Points a raw sample at which the filtered pulse is tabulated.
TABLE_POINTS = 4
#: Points times taps that are worked out at once.
TABLE_ENTRIES = 1_000_000
#: Delays at which a raw echo is tried for what sampling does to it, spread by this irrational step.
JITTER_DELAYS = 64
GOLDEN_RATIO = 0.6180339887
#: Mean and standard deviation of the modulus of complex noise of RMS 1 (Rayleigh).
RAYLEIGH_MEAN = float(np.sqrt(np.pi) / 2.0)
RAYLEIGH_STD = float(np.sqrt(1.0 - np.pi / 4.0))
RAYLEIGH_SKEWNESS = 0.631


@dataclass(frozen=True)
class Baseband:
    """A trace ready for the matched filter."""

    #: (samples,) array: complex for I/Q and raw traces of a carrier, else real.
    signal: Signal
    #: When its samples were taken.
    sampling: Sampling
    #: Standard deviation of the noise in `signal` (of the complex value, where complex), or of
    #: white noise as dense as it is within the pulse's band.
    noise_std: float
    #: The same for the part of the noise that is in phase with an echo, within it.
    echo_noise_std: float
    #: What one echo of each pulse in the air looks like in it, in the order of `EchoTrace.sent`.
    templates: tuple[Template, ...]
    #: Third standardised moment of the noise: 0 unless the trace is an envelope.
    noise_skewness: float = 0.0

    @property
    def template(self) -> Template:
        """What an echo of its own pulse looks like, or of the first one if it sent none."""
        return self.templates[0]


def to_baseband(trace: EchoTrace) -> Baseband:
    """Bring a trace of any encoding to the baseband.

    Raises
    ------
    MalformedMessageError
        If the trace is sampled too slowly for its pulse, or the pulse is not known.
    """
    check_pulses(trace)
    if trace.encoding is Encoding.RAW and trace.transducer.pulse.has_carrier:
        return _demodulated(trace)
    signal = trace.signal()
    noise_std = echo_noise_std = trace.noise_std or _estimate_noise(signal)
    if trace.encoding is not Encoding.RAW:
        # Of complex noise an echo feels the half that is in phase with it.
        echo_noise_std = noise_std / math.sqrt(2.0)
    is_envelope, carrier_hz = trace.encoding is Encoding.ENVELOPE, trace.transducer.pulse.carrier_hz
    templates = tuple(
        _sampled_template(emission.transducer.pulse, carrier_hz, is_envelope)
        for emission in trace.sent
    )
    if is_envelope:
        signal = signal - RAYLEIGH_MEAN * noise_std
        noise_std = RAYLEIGH_STD * noise_std
        return Baseband(
            signal, trace.sampling, noise_std, echo_noise_std, templates, RAYLEIGH_SKEWNESS
        )
    return Baseband(signal, trace.sampling, noise_std, echo_noise_std, templates)


@lru_cache(maxsize=16)
def _sampled_template(pulse: Pulse, carrier_hz: float, is_envelope: bool) -> Template:
    """What an echo looks like in samples that are taken as they are."""
    if not is_envelope:
        return Template(0.0, pulse.length_s, pulse, None, carrier_hz)
    if pulse.sweep_hz != 0.0:
        # A magnitude knows nothing of a sweep: what is left of a chirp is its window.
        pulse = replace(pulse, shape=PulseShape.HANN_BURST, sweep_hz=0.0)
    if pulse.profile is not None:
        pulse = replace(pulse, profile=pulse.profile.magnitude)
    return Template(0.0, pulse.length_s, pulse)


def _demodulated(trace: EchoTrace) -> Baseband:
    """Mix a raw trace down with e^(−j 2π f t), low-pass and decimate it."""
    pulse, rate_hz = trace.transducer.pulse, trace.sample_rate_hz
    sent = [emission.transducer.pulse for emission in trace.sent]
    bandwidth_hz = max(2.0 * abs(p.carrier_hz - pulse.carrier_hz) + p.bandwidth_hz for p in sent)
    decimation = max(1, int(rate_hz / (SAMPLES_PER_BANDWIDTH * bandwidth_hz)))
    filtered = _mixed_down(
        trace.samples, decimation, pulse.carrier_hz / rate_hz, trace.start_delay_s * rate_hz
    )
    noise_std = trace.noise_std * 2.0 / math.sqrt(decimation)
    if noise_std == 0.0:
        # The low-pass takes the edges of the band from the noise, where the pulse has nothing:
        # what is left is as dense as white noise that is stronger by this factor.
        taps = _low_pass(decimation, pulse.carrier_hz / rate_hz)
        noise_std = _estimate_noise(filtered) / float(np.sqrt(decimation * np.sum(taps**2)))
    templates = tuple(
        _filtered_template(one, pulse.carrier_hz, rate_hz, decimation) for one in sent
    )
    sampling = Sampling(rate_hz / decimation, trace.start_delay_s, len(filtered))
    return Baseband(filtered, sampling, noise_std, noise_std / math.sqrt(2.0), templates)


@lru_cache(maxsize=16)
def _low_pass(decimation: int, carrier_per_sample: float) -> FloatArray:
    """Taps that pass the decimated band and stop the image at twice the carrier."""
    cutoff = min(PASS_BAND / decimation, 2.0 * carrier_per_sample)
    count = TAPS_PER_SAMPLE * decimation + 1
    # Of a sinc under a Hamming window, which passes a constant as it is.
    taps = np.sinc(cutoff * (np.arange(count) - 0.5 * (count - 1))) * np.hamming(count)
    return np.asarray(taps / taps.sum())


def _mixed_down(
    samples: NDArray[np.floating],
    decimation: int,
    carrier_per_sample: float,
    start_samples: float,
) -> NDArray[np.complex128]:
    """Samples times 2 e^(−j 2π f t), low-passed and decimated.

    Mixing first and then filtering is the same as filtering with taps that are mixed the other
    way, and then mixing what is left: so the exponential is of the decimated samples only.
    """
    # Of one kind, whoever owns the memory: for each kind all would be compiled once more.
    doubles = samples.astype(np.float64)
    band = _band_pass(decimation, carrier_per_sample)
    filtered = _decimated(doubles, band, decimation)
    filtered *= _carrier(carrier_per_sample, start_samples, decimation, len(filtered))
    return filtered


@lru_cache(maxsize=16)
def _band_pass(decimation: int, carrier_per_sample: float) -> FloatArray:
    """Twice the taps of the low-pass, mixed up to the carrier, the last first: shape (2, taps)."""
    taps = _low_pass(decimation, carrier_per_sample)
    band = 2.0 * taps * np.exp(2j * np.pi * carrier_per_sample * np.arange(len(taps)))
    return np.array([band.real[::-1], band.imag[::-1]])


@lru_cache(maxsize=16)
def _carrier(
    carrier_per_sample: float, start_samples: float, decimation: int, count: int
) -> NDArray[np.complex128]:
    """What mixes decimated samples down."""
    at = start_samples + decimation * np.arange(count)
    return np.asarray(np.exp(-2j * np.pi * carrier_per_sample * at))


@compiled
def _decimated(samples: FloatArray, taps: FloatArray, decimation: int) -> NDArray[np.complex128]:
    """Every so many samples of the convolution with complex taps, given the last first."""
    count, length = taps.shape[1], len(samples) + taps.shape[1] - 1
    filtered = np.empty((length + decimation - 1) // decimation, np.complex128)
    for number in range(len(filtered)):
        begin = number * decimation - count + 1
        first, end = max(0, -begin), min(count, len(samples) - begin)
        heard = samples[begin + first : begin + end]
        in_phase, quadrature = taps[0, first:end], taps[1, first:end]
        real = imaginary = 0.0
        for tap in range(len(heard)):
            real += in_phase[tap] * heard[tap]
            imaginary += quadrature[tap] * heard[tap]
        filtered[number] = complex(real, imaginary)
    return filtered


@lru_cache(maxsize=16)
def _filtered_template(
    pulse: Pulse, carrier_hz: float, rate_hz: float, decimation: int
) -> Template:
    """Envelope of an echo behind the mixer at `carrier_hz` and the low-pass, tabulated."""
    taps = _low_pass(decimation, carrier_hz / rate_hz)
    duration_s = pulse.length_s + (len(taps) - 1) / rate_hz
    points = int(np.ceil(duration_s * rate_hz * TABLE_POINTS)) + 1
    time_s = np.arange(points) / (rate_hz * TABLE_POINTS)
    tap_s = np.arange(len(taps)) / rate_hz
    # Some points at a time: all of a long pulse's, times all taps, would take gigabytes.
    table = np.concatenate(
        [
            _envelope_between_samples(pulse, carrier_hz, rate_hz, some[:, np.newaxis] - tap_s)
            @ taps
            for some in np.array_split(time_s, math.ceil(points * len(taps) / TABLE_ENTRIES))
        ]
    )
    template = Template(0.0, float(time_s[-1]), pulse, tuple(table), carrier_hz)
    delay_s, amplitude, misfit = map(float, _sampling_errors(template, rate_hz, decimation))
    return replace(template, delay_jitter_s=delay_s, amplitude_jitter=amplitude, misfit=misfit)


def _envelope_between_samples(
    pulse: Pulse, carrier_hz: float, rate_hz: float, age_s: FloatArray
) -> Signal:
    """Envelope of an echo in raw samples as a smooth function of its delay.

    An edge takes effect from one raw sample to the next: as a function of the delay, an echo with
    edges is a staircase, which has no slope; the line through the middles of its stairs has.
    """
    if pulse.shape is not PulseShape.TONE_BURST or pulse.profile is not None:
        return pulse.envelope_above(carrier_hz, age_s)
    begun = (age_s * rate_hz + 0.5).clip(0.0, 1.0)
    ended = ((age_s - pulse.duration_s) * rate_hz + 0.5).clip(0.0, 1.0)
    offset_hz = pulse.carrier_hz - carrier_hz
    window: Signal = (begun - ended).astype(np.complex128)
    if offset_hz == 0.0:
        return window.real
    window *= np.exp(2j * np.pi * offset_hz * age_s)
    return window


def _sampling_errors(template: Template, rate_hz: float, decimation: int) -> FloatArray:
    """RMS error of delay (s) and amplitude, and misfit, of an echo without any noise, (3,).

    They come from how edges fall among raw samples, and from what the low-pass lets through of the
    mixer's image at twice the carrier.  Measured on echoes at evenly spread delays.
    """
    pulse, carrier_hz = template.pulse, template.mixed_by_hz or 0.0
    raw_s = np.arange(int(np.ceil(template.duration_s * rate_hz)) + 3 * decimation) / rate_hz
    errors = []
    for share in (np.arange(JITTER_DELAYS) * GOLDEN_RATIO) % 1.0:
        delay_s = (1.0 + share) * decimation / rate_hz
        waveform = pulse.waveform(raw_s - delay_s)
        heard = _mixed_down(waveform, decimation, carrier_hz / rate_hz, 0.0)
        age_s = np.arange(len(heard)) * decimation / rate_hz - delay_s
        shape = template(age_s)
        amplitude = np.vdot(shape, heard) / np.vdot(shape, shape)
        slope = -amplitude * template.slope(age_s)
        free = slope - shape * (np.vdot(shape, slope) / np.vdot(shape, shape))
        step_s = np.vdot(free, heard - amplitude * shape).real / np.vdot(free, free).real
        left = heard - amplitude * shape - step_s * free
        misfit = np.linalg.norm(left) / np.linalg.norm(heard)
        errors.append((step_s, np.abs(amplitude) - 1.0, misfit))
    rms: FloatArray = np.sqrt(np.mean(np.square(errors), axis=0))
    return rms


def estimated_noise_std(trace: EchoTrace) -> float:
    """Noise of a trace as `EchoTrace.noise_std` has it, estimated from its quietest part.

    Raises
    ------
    MalformedMessageError
        If the trace cannot be brought to the baseband.
    """
    if trace.encoding is Encoding.RAW and trace.transducer.pulse.has_carrier:
        silent = to_baseband(replace(trace, noise_std=0.0))
        decimation = trace.sample_rate_hz / silent.sampling.sample_rate_hz
        return silent.noise_std * float(np.sqrt(decimation)) / 2.0
    return _estimate_noise(trace.signal())


def _estimate_noise(signal: Signal) -> float:
    """Noise level from the quietest quarter of the samples, for a receiver that states none.

    The squared modulus of complex noise is exponential, so its lower quartile is
    σ² ln(4/3); echoes, which are few, hardly move it.
    """
    power = np.abs(signal) ** 2
    if np.iscomplexobj(signal) or np.all(signal >= 0.0):
        return float(np.sqrt(np.quantile(power, 0.25) / np.log(4.0 / 3.0)))
    return float(np.quantile(np.abs(signal), 0.25) / 0.3186)
