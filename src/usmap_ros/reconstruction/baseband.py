"""From the samples of a trace to a baseband signal, one front end for all three encodings.

An echo in the baseband is w(t − τ) times an unknown complex coefficient: its carrier phase is
free, which is what lets delays be found between samples although a wavelength is 7 mm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.signal import firwin, upfirdn

from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.arrays import FloatArray, Signal
from usmap_ros.reconstruction.pulses import check_pulses
from usmap_ros.trace import EchoTrace, Emission, Encoding

#: Baseband samples per second and hertz of the pulse's bandwidth, at least, after decimation of a
#: raw trace: eight samples on a pulse without a sweep.
SAMPLES_PER_BANDWIDTH = 2
#: Taps of the decimation filter per decimated sample, and its pass band (of the half rate).
TAPS_PER_SAMPLE = 8
PASS_BAND = 0.8
#: Points a raw sample at which the filtered pulse is tabulated.
TABLE_POINTS = 4
#: Points at which the overlap of two echoes is tabulated, and further ones a cycle of its phase.
LAGS = 257
LAGS_PER_CYCLE = 16
#: Mean and standard deviation of the modulus of complex noise of RMS 1 (Rayleigh).
RAYLEIGH_MEAN = float(np.sqrt(np.pi) / 2.0)
RAYLEIGH_STD = float(np.sqrt(1.0 - np.pi / 4.0))
RAYLEIGH_SKEWNESS = 0.631


@dataclass(frozen=True)
class Template:
    """The envelope that an echo has in the baseband, or its filtered form; a chirp's is complex.

    Parameters
    ----------
    start_s, duration_s : float
        The interval on which it is not zero.
    pulse : Pulse
        Evaluated where `table` is None.
    table : (n,) array, optional
        Values on an even grid over the interval.
    mixed_by_hz : float, optional
        Frequency that the signal was mixed down by; None: the pulse's carrier.
    """

    start_s: float
    duration_s: float
    pulse: Pulse
    table: tuple[complex, ...] | None = None
    mixed_by_hz: float | None = None

    def __call__(self, time_s: FloatArray) -> Signal:
        """Envelope at times after the echo's delay."""
        if self.table is None:
            return self.pulse.envelope_above(self._centre_hz, time_s)
        values = np.asarray(self.table)
        grid = np.linspace(self.start_s, self.start_s + self.duration_s, len(values))
        envelope: Signal = np.interp(time_s, grid, values, left=0.0, right=0.0)
        return envelope

    def slope(self, time_s: FloatArray) -> Signal:
        """Derivative with respect to time, by central difference."""
        step_s = self.pulse.resolution_s * 1e-4
        slope: Signal = (self(time_s + step_s) - self(time_s - step_s)) / (2.0 * step_s)
        return slope

    def overlap(self, delay_s: FloatArray) -> FloatArray:
        """Correlation of two echoes whose delays differ by `delay_s`, 1 at 0; its magnitude."""
        lags_s, correlation = _autocorrelation(self)
        return np.interp(delay_s, lags_s, correlation)

    @property
    def highest_hz(self) -> float:
        """Highest frequency by which its phase turns, either way."""
        return abs(self.pulse.carrier_hz - self._centre_hz) + 0.5 * abs(self.pulse.sweep_hz)

    @property
    def _centre_hz(self) -> float:
        return self.pulse.carrier_hz if self.mixed_by_hz is None else self.mixed_by_hz

    @property
    def is_smooth(self) -> bool:
        """Whether a delay can be told finer than a sample from it."""
        smooth = (PulseShape.HANN_BURST, PulseShape.CHIRP)
        return self.table is not None or self.pulse.shape in smooth


@lru_cache(maxsize=16)
def _autocorrelation(template: Template) -> tuple[FloatArray, FloatArray]:
    """Lags from 0 to the template's length, and its normalised autocorrelation there."""
    cycles = template.highest_hz * template.duration_s
    count = LAGS + int(LAGS_PER_CYCLE * cycles)
    time_s = np.linspace(template.start_s, template.start_s + template.duration_s, count)
    values = template(time_s)
    correlation = np.abs(np.correlate(values, values, mode="full")[count - 1 :])
    return time_s - template.start_s, correlation / correlation[0]


@dataclass(frozen=True)
class Baseband:
    """A trace ready for the matched filter.

    Parameters
    ----------
    signal : (samples,) array
        Complex for I/Q and raw traces of a carrier, else real.
    sampling : Sampling
        When its samples were taken.
    noise_std : float
        Standard deviation of the noise in `signal` (of the complex value, where complex), or of
        white noise as dense as it is within the pulse's band.
    noise_skewness : float
        Third standardised moment of the noise: 0 unless the trace is an envelope.
    templates : tuple of Template
        What one echo of each pulse in the air looks like in it, in the order of `EchoTrace.sent`.
    """

    signal: Signal
    sampling: Sampling
    noise_std: float
    noise_skewness: float
    templates: tuple[Template, ...]

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
    signal, noise_std = trace.signal(), trace.noise_std
    if noise_std == 0.0:
        noise_std = _estimate_noise(signal)
    skewness = 0.0
    if trace.encoding is Encoding.ENVELOPE:
        signal = signal - RAYLEIGH_MEAN * noise_std
        noise_std, skewness = RAYLEIGH_STD * noise_std, RAYLEIGH_SKEWNESS
    return Baseband(
        signal=signal,
        sampling=trace.sampling,
        noise_std=noise_std,
        noise_skewness=skewness,
        templates=tuple(_sampled_template(trace, emission) for emission in trace.sent),
    )


def _sampled_template(trace: EchoTrace, emission: Emission) -> Template:
    """What an echo looks like in samples that are taken as they are."""
    pulse = emission.transducer.pulse
    if trace.encoding is not Encoding.ENVELOPE:
        return Template(0.0, pulse.duration_s, pulse, None, trace.transducer.pulse.carrier_hz)
    if pulse.sweep_hz != 0.0:
        # A magnitude knows nothing of a sweep: what is left of a chirp is its window.
        pulse = replace(pulse, shape=PulseShape.HANN_BURST, sweep_hz=0.0)
    return Template(0.0, pulse.duration_s, pulse)


def _demodulated(trace: EchoTrace) -> Baseband:
    """Mix a raw trace down with e^(−j 2π f t), low-pass and decimate it."""
    pulse, rate_hz = trace.transducer.pulse, trace.sample_rate_hz
    sent = [emission.transducer.pulse for emission in trace.sent]
    bandwidth_hz = max(2.0 * abs(p.carrier_hz - pulse.carrier_hz) + p.bandwidth_hz for p in sent)
    decimation = max(1, int(rate_hz / (SAMPLES_PER_BANDWIDTH * bandwidth_hz)))
    taps = _low_pass(decimation, pulse.carrier_hz / rate_hz)
    phase = 2.0 * np.pi * pulse.carrier_hz * trace.sample_times_s()
    mixed = 2.0 * trace.signal() * np.exp(-1j * phase)
    filtered = upfirdn(taps, mixed, up=1, down=decimation)
    # The low-pass takes the edges of the band from the noise, where the pulse has nothing: what
    # is left is as dense as white noise that is stronger by this factor.
    passed = float(np.sqrt(decimation * np.sum(taps**2)))
    gain = 2.0 / float(np.sqrt(decimation))
    noise_std = trace.noise_std * gain or _estimate_noise(filtered) / passed
    return Baseband(
        signal=filtered,
        sampling=Sampling(rate_hz / decimation, trace.start_delay_s, len(filtered)),
        noise_std=noise_std,
        noise_skewness=0.0,
        templates=tuple(
            _filtered_template(one, pulse.carrier_hz, rate_hz, decimation) for one in sent
        ),
    )


@lru_cache(maxsize=16)
def _low_pass(decimation: int, carrier_per_sample: float) -> FloatArray:
    """Taps that pass the decimated band and stop the image at twice the carrier."""
    cutoff = min(PASS_BAND / decimation, 2.0 * carrier_per_sample)
    taps: FloatArray = firwin(TAPS_PER_SAMPLE * decimation + 1, cutoff)
    return taps


@lru_cache(maxsize=16)
def _filtered_template(
    pulse: Pulse, carrier_hz: float, rate_hz: float, decimation: int
) -> Template:
    """Envelope of an echo behind the mixer at `carrier_hz` and the low-pass, tabulated."""
    taps = _low_pass(decimation, carrier_hz / rate_hz)
    duration_s = pulse.duration_s + (len(taps) - 1) / rate_hz
    points = int(np.ceil(duration_s * rate_hz * TABLE_POINTS)) + 1
    time_s = np.linspace(0.0, duration_s, points)
    tap_delay_s = np.arange(len(taps)) / rate_hz
    table = pulse.envelope_above(carrier_hz, time_s[:, np.newaxis] - tap_delay_s) @ taps
    return Template(0.0, duration_s, pulse, tuple(table), carrier_hz)


def _estimate_noise(signal: Signal) -> float:
    """Noise level from the quietest quarter of the samples, for a receiver that states none.

    The squared modulus of complex noise is exponential, so its lower quartile is
    σ² ln(4/3); echoes, which are few, hardly move it.
    """
    power = np.abs(signal) ** 2
    if np.iscomplexobj(signal) or np.all(signal >= 0.0):
        return float(np.sqrt(np.quantile(power, 0.25) / np.log(4.0 / 3.0)))
    return float(np.quantile(np.abs(signal), 0.25) / 0.3186)
