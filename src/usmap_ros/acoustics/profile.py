"""What an echo looks like as received, where transducers round off the burst that drives them.

A resonant transducer follows its drive as a resonator does: an echo rises over several periods of
the carrier and rings out over more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from usmap_ros.bounds import LEAST_PROFILE_POINTS, MAX_PROFILE_GRID, MAX_PROFILE_POINTS
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.arrays import FloatArray, Signal

#: Share of the energy in the core of a profile's band, and how much wider the band counts: so much
#: wider is the main lobe of a Hann burst.
_CORE_ENERGY, _BAND_OVER_CORE = 0.99, 1.5
#: Two echoes this much alike are as far apart as `Pulse.resolution_s` counts 0.35: see there.
_APART_OVERLAP, _APART_SHARE = 0.4, 0.35
#: A resonator's ring counts until so little of the peak is left; grid points a time constant.
_RUNG_OUT = 0.003
_POINTS_PER_CONSTANT = 64


@dataclass(frozen=True)
class Profile:
    """Complex envelope of an echo over the carrier, from its beginning on."""

    rate_hz: float
    #: Its values, as `values` has them: bytes are compared and hashed at once.
    packed: bytes = field(repr=False)

    @classmethod
    def of(cls, values: Signal, rate_hz: float) -> Profile:
        """Profile of values of any scale."""
        scaled = values / max(np.abs(values).max(initial=0.0), np.finfo(float).tiny)
        return cls(rate_hz, np.asarray(scaled, dtype=np.complex128).tobytes())

    @property
    def values(self) -> Signal:
        """Complex values with a peak magnitude of 1; linear between them, 0 beyond the ends."""
        return np.frombuffer(self.packed, dtype=np.complex128)

    @property
    def duration_s(self) -> float:
        """From the first value to the last."""
        return (len(self.values) - 1) / self.rate_hz

    @property
    def peak_s(self) -> float:
        """When its magnitude is greatest."""
        return float(np.argmax(np.abs(self.values))) / self.rate_hz

    @property
    def bandwidth_hz(self) -> float:
        """Width of the band about the carrier that it fills, as `Pulse.bandwidth_hz`."""
        return _widths(self)[0]

    @property
    def resolution_s(self) -> float:
        """Delay of which 0.35 leaves two echoes an overlap of 0.4, as in a Hann burst."""
        return _widths(self)[1]

    @property
    def magnitude(self) -> Profile:
        """What a receiver of envelopes makes of it."""
        return Profile.of(np.abs(self.values), self.rate_hz)

    def __call__(self, time_s: FloatArray) -> Signal:
        """Value at times after the echo's beginning."""
        values: Signal = np.interp(
            np.asarray(time_s, dtype=float) * self.rate_hz,
            np.arange(len(self.values)),
            self.values,
            left=0.0,
            right=0.0,
        )
        return values

    def validate(self) -> None:
        """Raise `MalformedMessageError` unless it is an envelope of some length."""
        if not (np.isfinite(self.rate_hz) and self.rate_hz > 0.0):
            raise MalformedMessageError("pulse.rate", f"is {self.rate_hz:g} Hz, must be above 0")
        count = len(self.values)
        if not LEAST_PROFILE_POINTS <= count <= MAX_PROFILE_POINTS:
            raise MalformedMessageError(
                "pulse.template",
                f"has {count} values, must have {LEAST_PROFILE_POINTS} to {MAX_PROFILE_POINTS}",
            )
        values = self.values
        if not np.all(np.isfinite(values)) or not np.any(values):
            raise MalformedMessageError("pulse.template", "is not finite, or nothing but zeros")


def resonant_profile(
    drive: Callable[[FloatArray], Signal],
    duration_s: float,
    carrier_hz: float,
    resonances: Sequence[tuple[float, float]],
) -> Profile:
    """What resonators in a row make of the burst that drives them.

    Parameters
    ----------
    drive : callable
        Envelope of the burst over the carrier, at times after its beginning.
    duration_s : float
        Length of the burst that drives the transducer, s.
    carrier_hz : float
        Frequency of that burst, Hz.
    resonances : sequence of (float, float)
        Frequency (Hz) and quality factor of each resonator.

    Raises
    ------
    MalformedMessageError
        If burst and ring last so long, and resonate so widely, that it would take too many values.

    Notes
    -----
    About its frequency f, a resonator of quality Q answers an impulse with an envelope
    exp(-(π f / Q) t), turning by f less the carrier (Kinsler, Frey, Coppens & Sanders, Fundamentals
    of Acoustics, 4th ed., sections 1.6 and 1.10).
    """
    # Takes longer to import than all else together, and few pulses have a resonance.
    from scipy.signal import fftconvolve

    decays_hz = [np.pi * frequency / quality for frequency, quality in resonances]
    rate_hz = _POINTS_PER_CONSTANT * max(*decays_hz, 1.0 / duration_s)
    # Equal resonators in a row ring on as t exp(-t/τ), which takes a little longer.
    ring_s = (2.0 + np.log(1.0 / _RUNG_OUT)) * sum(1.0 / decay for decay in decays_hz)
    points = np.ceil((duration_s + ring_s) * rate_hz)
    if points > MAX_PROFILE_GRID:
        raise MalformedMessageError(
            "pulse.resonances",
            f"take {points:.3g} values of an envelope of {duration_s + ring_s:.3g} s, at most"
            f" {MAX_PROFILE_GRID} are taken",
        )
    time_s = np.arange(int(points)) / rate_hz
    envelope: Signal = np.asarray(drive(time_s), dtype=np.complex128)
    for (frequency_hz, _), decay_hz in zip(resonances, decays_hz, strict=True):
        turned = 2j * np.pi * (frequency_hz - carrier_hz)
        answer = np.exp((turned - decay_hz) * time_s)
        envelope = fftconvolve(envelope, answer)[: len(time_s)]
    magnitude = np.abs(envelope)
    last = int(np.flatnonzero(magnitude > _RUNG_OUT * magnitude.max())[-1])
    return Profile.of(envelope[: last + 1], float(rate_hz))


@lru_cache(maxsize=16)
def _widths(profile: Profile) -> tuple[float, float]:
    """`Profile.bandwidth_hz` and `Profile.resolution_s`."""
    # Here, because few pulses have a profile, and it takes long to load.
    from scipy.fft import next_fast_len

    values = profile.values
    count = next_fast_len(8 * len(values))
    energy = np.abs(np.fft.fft(values, count)) ** 2
    frequency_hz = np.abs(np.fft.fftfreq(count, 1.0 / profile.rate_hz))
    order = np.argsort(frequency_hz)
    within = np.cumsum(energy[order]) >= _CORE_ENERGY * energy.sum()
    core_hz = float(frequency_hz[order][int(np.argmax(within))])
    overlap = np.abs(np.fft.ifft(energy)[: len(values)])
    alike = overlap > _APART_OVERLAP * overlap[0]
    # The first lag at which two are no longer alike, to a part of the grid.
    lag = len(values) if alike.all() else int(np.argmin(alike))
    return 2.0 * _BAND_OVER_CORE * core_hz, lag / (_APART_SHARE * profile.rate_hz)
