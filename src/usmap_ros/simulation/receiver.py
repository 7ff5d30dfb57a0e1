"""The receiver: noise, converter and encoding of what arrives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usmap_ros.acoustics.pulse import Pulse
from usmap_ros.arrays import FloatArray, Signal
from usmap_ros.trace import Encoding


@dataclass(frozen=True)
class Converter:
    """Analogue-to-digital converter.

    Parameters
    ----------
    bits : int
        Resolution; one of them is the sign, except for an envelope, which has none.
    full_scale : float
        Largest amplitude that it can express, in units of the samples.
    """

    bits: int
    full_scale: float

    def step(self, *, signed: bool) -> float:
        """Difference between neighbouring levels."""
        return self.full_scale / 2.0 ** (self.bits - 1 if signed else self.bits)

    def convert(self, values: FloatArray, *, signed: bool) -> FloatArray:
        """Nearest level to each value; saturated beyond the last one at either end."""
        levels = 2 ** (self.bits - 1 if signed else self.bits)
        lowest = -levels if signed else 0
        step = self.step(signed=signed)
        return np.clip(np.rint(values / step), lowest, levels - 1) * step


@dataclass(frozen=True)
class Receiver:
    """What turns sound into the samples of a trace.

    Parameters
    ----------
    encoding : Encoding
        Raw samples, envelope or I/Q pairs.
    sample_rate_hz : float
        Rate of samples, or of I/Q pairs.
    start_delay_s : float
        From the start of emission to the first sample.
    noise_std : float
        RMS of the complex baseband noise.  A raw sample's is 1/√2 of it: the I and Q parts
        share the power of the complex noise, and either has that of the signal at the carrier.
    converter : Converter or None
        None: samples are as exact as a float.
    """

    encoding: Encoding
    sample_rate_hz: float
    start_delay_s: float
    noise_std: float
    converter: Converter | None = None

    @property
    def stated_noise_std(self) -> float:
        """RMS noise in units of the samples, as `EchoTrace.noise_std` has it.

        Rounding by the converter adds its variance of step² / 12, twice for an I/Q pair.
        """
        is_raw = self.encoding is Encoding.RAW
        variance = self.noise_std**2 / (2.0 if is_raw else 1.0)
        if self.converter is not None:
            step = self.converter.step(signed=self.encoding is not Encoding.ENVELOPE)
            variance += step**2 / 12.0 * (2.0 if self.encoding is Encoding.IQ else 1.0)
        return float(np.sqrt(variance))

    def sample_count(self, duration_s: float) -> int:
        """Samples (or pairs) from the first one to the last before `duration_s`."""
        return max(1, int(np.ceil((duration_s - self.start_delay_s) * self.sample_rate_hz)))

    def receive(
        self,
        pulse: Pulse,
        delays_s: FloatArray,
        amplitudes: FloatArray,
        count: int,
        rng: np.random.Generator,
    ) -> NDArray[np.float32]:
        """Samples of a sum of echoes.

        Parameters
        ----------
        pulse : Pulse
            What was emitted.
        delays_s, amplitudes : (paths,) arrays
            Of every path by which it arrives.
        count : int
            Number of samples (or pairs) to take.
        rng : numpy.random.Generator
            For the noise.

        Returns
        -------
        (count,) or (2 count,) float32 array
            As in `EchoTrace.samples`.
        """
        noise_std = self.noise_std / np.sqrt(2.0)
        if self.encoding is Encoding.RAW:
            raw = self._superpose(pulse.waveform, pulse, delays_s, amplitudes, count).real
            return self._digitise(raw + noise_std * rng.standard_normal(count))
        carrier = np.exp(-2j * np.pi * pulse.carrier_hz * delays_s)
        baseband = self._superpose(pulse.envelope, pulse, delays_s, amplitudes * carrier, count)
        pairs = np.stack([baseband.real, baseband.imag], axis=-1)
        pairs += noise_std * rng.standard_normal(pairs.shape)
        if self.encoding is Encoding.ENVELOPE:
            return self._digitise(np.hypot(pairs[:, 0], pairs[:, 1]))
        return self._digitise(pairs.ravel())

    def _digitise(self, values: FloatArray) -> NDArray[np.float32]:
        if self.converter is not None:
            signed = self.encoding is not Encoding.ENVELOPE
            values = self.converter.convert(values, signed=signed)
        return values.astype(np.float32)

    def _superpose(
        self,
        shape: Callable[[FloatArray], Signal],
        pulse: Pulse,
        delays_s: FloatArray,
        amplitudes: Signal,
        count: int,
    ) -> Signal:
        """Σ a · shape(t − τ) at the sample times; a path touches only what its pulse covers."""
        rate = self.sample_rate_hz
        first = np.ceil((delays_s - self.start_delay_s) * rate).astype(np.int64)
        covered = np.arange(int(np.ceil(pulse.duration_s * rate)) + 1)
        index = first[:, np.newaxis] + covered
        age = index / rate + self.start_delay_s - delays_s[:, np.newaxis]
        inside = (index >= 0) & (index < count)
        values = (amplitudes[:, np.newaxis] * shape(age))[inside]
        total = np.zeros(count, dtype=np.complex128)
        total.real = np.bincount(index[inside], values.real, minlength=count)
        total.imag = np.bincount(index[inside], values.imag, minlength=count)
        return total
