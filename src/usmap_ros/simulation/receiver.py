"""The receiver: noise, converter and encoding of what arrives."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from usmap_ros.acoustics.pulse import Pulse
from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.numerics.arrays import FloatArray, Signal
from usmap_ros.parameters import ParameterGroup, quantity
from usmap_ros.pings.trace import Encoding
from usmap_ros.simulation.imperfections import NO_IMPERFECTIONS, Imperfections


class Converter(ParameterGroup):
    """Analogue-to-digital converter."""

    bits: int = quantity(12, "Resolution.", "bit", ge=2, le=24)
    full_scale: float = quantity(
        2.0, "Amplitude at which it saturates, in units of the samples.", gt=0.0, le=1e9
    )
    unipolar: bool = quantity(
        False, "Whether it has no sign at all, so that samples of either sign need an offset."
    )

    def step(self, *, signed: bool) -> float:
        """Difference between neighbouring levels; a sign takes one of the bits."""
        return self.full_scale / 2.0 ** (self.bits - 1 if signed else self.bits)

    def convert(self, values: FloatArray, *, signed: bool) -> FloatArray:
        """Nearest level to each value; saturated beyond the last one at either end."""
        levels = 2 ** (self.bits - 1 if signed else self.bits)
        lowest = -levels if signed else 0
        step = self.step(signed=signed)
        return np.clip(np.rint(values / step), lowest, levels - 1) * step


@dataclass(frozen=True)
class Arrivals:
    """Paths by which one pulse arrives."""

    pulse: Pulse
    #: (paths,) arrays: of every path.
    delays_s: FloatArray
    amplitudes: FloatArray


@dataclass(frozen=True)
class Receiver:
    """What turns sound into the samples of a trace."""

    encoding: Encoding
    #: Rate of samples, or of I/Q pairs.
    sample_rate_hz: float
    #: From the start of emission to the first sample.
    start_delay_s: float
    #: RMS of the complex baseband noise.  A raw sample's is 1/√2 of it: the I and Q parts share the
    #: power of the complex noise, and either has that of the signal at the carrier.
    noise_std: float
    #: None: samples are as exact as a float.
    converter: Converter | None = None
    #: What it does beside receiving.
    imperfections: Imperfections = NO_IMPERFECTIONS

    @property
    def stated_noise_std(self) -> float:
        """RMS noise in units of the samples, as `EchoTrace.noise_std` has it.

        Rounding by the converter adds its variance of step² / 12, twice for an I/Q pair.
        """
        is_raw = self.encoding is Encoding.RAW
        heard_std = self.imperfections.gain * self.noise_std
        variance = heard_std**2 / (2.0 if is_raw else 1.0)
        if self.converter is not None:
            step = self.converter.step(signed=self._is_signed)
            variance += step**2 / 12.0 * (2.0 if self.encoding is Encoding.IQ else 1.0)
        return float(np.sqrt(variance))

    @property
    def _is_signed(self) -> bool:
        unipolar = self.converter is not None and self.converter.unipolar
        return self.encoding is not Encoding.ENVELOPE and not unipolar

    def sample_count(self, duration_s: float) -> int:
        """Samples (or pairs) from the first one to the last before `duration_s`."""
        return max(1, int(np.ceil((duration_s - self.start_delay_s) * self.sample_rate_hz)))

    def receive(
        self,
        arrivals: Sequence[Arrivals],
        pulse: Pulse,
        count: int,
        rng: np.random.Generator,
        *,
        emits: bool = True,
    ) -> NDArray[np.float32]:
        """Samples of a sum of echoes.

        Parameters
        ----------
        arrivals : sequence of Arrivals
            Of each pulse in the air.
        pulse : Pulse
            The receiver's own, whose carrier I/Q is mixed down by.
        count : int
            Number of samples (or pairs) to take.
        rng : numpy.random.Generator
            For the noise.
        emits : bool
            Whether its own transmitter sent it, and can be heard ringing and in its mount.

        Returns
        -------
        (count,) or (2 count,) float32 array
            As in `EchoTrace.samples`.
        """
        noise_std = self.noise_std / np.sqrt(2.0)
        sampling = Sampling(self.sample_rate_hz, self.start_delay_s, count)
        late_s, carrier_hz = self.imperfections.latency_s, pulse.carrier_hz
        if emits and self.imperfections.own_echoes:
            delays_s, amplitudes = np.array(self.imperfections.own_echoes).T
            arrivals = [*arrivals, Arrivals(pulse, delays_s, amplitudes)]
        if late_s:
            arrivals = [replace(one, delays_s=one.delays_s + late_s) for one in arrivals]
        if self.encoding is Encoding.RAW:
            raw = np.zeros(sampling.sample_count)
            for one in arrivals:
                raw += _superposed(one.pulse.waveform, one, one.amplitudes, sampling).real
            noise = noise_std * rng.standard_normal(raw.shape)
            return self._digitise(self._received(raw, noise, pulse, sampling, emits=emits).real)
        baseband = np.zeros(sampling.sample_count, dtype=np.complex128)
        for one in arrivals:
            shape = partial(one.pulse.envelope_above, carrier_hz)
            turned = one.amplitudes * np.exp(-2j * np.pi * carrier_hz * one.delays_s)
            baseband += _superposed(shape, one, turned, sampling)
        drawn = noise_std * rng.standard_normal((len(baseband), 2))
        noise = drawn.view(np.complex128)[:, 0]
        baseband = self._received(baseband, noise, pulse, sampling, emits=emits)
        if self.encoding is Encoding.ENVELOPE:
            return self._digitise(np.hypot(baseband.real, baseband.imag))
        return self._digitise(np.stack([baseband.real, baseband.imag], axis=-1).ravel())

    def _received(
        self, heard: Signal, noise: Signal, pulse: Pulse, sampling: Sampling, *, emits: bool
    ) -> Signal:
        """What comes out of the receiver for what there is to hear, and its noise."""
        faults, times_s = self.imperfections, sampling.times_s
        sensitivity = faults.sensitivity(times_s, np.abs(heard))
        ringing = None
        if emits:
            ringing = faults.ringing(times_s, pulse.duration_s, pulse.carrier_hz, self.encoding)
        total = heard + noise
        if ringing is not None:
            total = total + ringing
        return total if sensitivity is None else sensitivity * total

    def _digitise(self, values: FloatArray) -> NDArray[np.float32]:
        faults = self.imperfections
        if faults.gain != 1.0 or faults.offset != 0.0:
            values = faults.gain * values + faults.offset
        if self.converter is not None:
            values = self.converter.convert(values, signed=self._is_signed)
        return values.astype(np.float32)


def _superposed(
    shape: Callable[[FloatArray], Signal],
    arrivals: Arrivals,
    amplitudes: Signal,
    sampling: Sampling,
) -> Signal:
    """Σ a · shape(t − τ) at the sample times; a path touches only what its pulse covers."""
    samples, ages_s = sampling.touched(arrivals.delays_s, arrivals.pulse.length_s)
    taken = sampling.takes(samples)
    values = (amplitudes[:, np.newaxis] * shape(ages_s))[taken]
    total = np.zeros(sampling.sample_count, dtype=np.complex128)
    total.real = np.bincount(samples[taken], values.real, minlength=sampling.sample_count)
    total.imag = np.bincount(samples[taken], values.imag, minlength=sampling.sample_count)
    return total
