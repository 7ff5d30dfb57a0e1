"""The pulse that a transducer emits (Sanchez & Andersson 2018, sections 3 and 4)."""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

import numpy as np

from usmap_ros import bounds
from usmap_ros.acoustics.profile import Profile
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.arrays import FloatArray, Signal

#: Width of the matched filter's peak behind a chirp, in units of 1 / sweep.  At 0.35 of it, as at
#: 0.35 of the length of a Hann burst, two echoes overlap by about 0.4.
_CHIRP_RESOLUTION = 4.0


class PulseShape(enum.IntEnum):
    """Shape of the pulse; the values are those of ``usmap_msgs/Transducer``."""

    SQUARE = 0
    TONE_BURST = 1
    HANN_BURST = 2
    CHIRP = 3


@dataclass(frozen=True)
class Pulse:
    """One emitted pulse p(t), as the transducer sends it out.

    Parameters
    ----------
    shape : PulseShape
        A square pulse without a carrier, a sine under a rectangular or a Hann window, or a sine
        whose frequency changes linearly, under a Hann window.
    carrier_hz : float
        Carrier frequency, at the middle of a chirp; 0 for a square pulse.
    duration_s : float
        Length of the window.
    sweep_hz : float
        How far a chirp's frequency rises from its beginning to its end, negative if it falls.
        ``usmap_msgs/Transducer`` has no field for it: 0 in a chirp means that it is unknown.
    profile : Profile, optional
        Envelope of an echo as it is received, where transducers make something else of the burst
        that drives them; None: they follow it.  The message has no field for it either.
    """

    shape: PulseShape
    carrier_hz: float
    duration_s: float
    sweep_hz: float = 0.0
    profile: Profile | None = None

    @property
    def has_carrier(self) -> bool:
        """Whether the pulse modulates a carrier, so that an echo has a phase."""
        return self.shape is not PulseShape.SQUARE

    @property
    def lacks_sweep(self) -> bool:
        """Whether it is a chirp of which nobody has said how far it sweeps."""
        return self.shape is PulseShape.CHIRP and self.sweep_hz == 0.0

    @property
    def length_s(self) -> float:
        """How long an echo lasts."""
        return self.duration_s if self.profile is None else self.profile.duration_s

    @property
    def peak_s(self) -> float:
        """When an echo is loudest, after its beginning."""
        return 0.5 * self.duration_s if self.profile is None else self.profile.peak_s

    @property
    def driven(self) -> Pulse:
        """The burst that drives the transducer, which is what messages state."""
        return self if self.profile is None else replace(self, profile=None)

    @property
    def bandwidth_hz(self) -> float:
        """Width of the band that the pulse fills: its sweep, and the main lobe of its window."""
        if self.profile is not None:
            return self.profile.bandwidth_hz
        return abs(self.sweep_hz) + 4.0 / self.duration_s

    @property
    def resolution_s(self) -> float:
        """Delay at which two echoes are apart: the pulse's length, or that of a chirp compressed.

        The matched filter of a chirp has a peak of about 1 / sweep, however long the chirp is.
        """
        if self.profile is not None:
            return self.profile.resolution_s
        if self.sweep_hz == 0.0:
            return self.duration_s
        return min(self.duration_s, _CHIRP_RESOLUTION / abs(self.sweep_hz))

    def window(self, time_s: FloatArray) -> FloatArray:
        """Magnitude w(t) of the envelope: 0 outside [0, length], with a peak of 1 inside."""
        if self.profile is not None:
            return np.abs(self.profile(time_s))
        phase = np.asarray(time_s, dtype=float) / self.duration_s
        inside = (phase >= 0.0) & (phase <= 1.0)
        if self.shape in (PulseShape.HANN_BURST, PulseShape.CHIRP):
            return np.where(inside, np.sin(np.pi * phase) ** 2, 0.0)
        return inside.astype(float)

    def envelope(self, time_s: FloatArray) -> Signal:
        """What modulates the carrier: w(t), times exp(j φ(t)) in a chirp.

        The phase φ(t) = π B t (t / T - 1), with B the sweep and T the duration, makes the
        frequency go from -B / 2 to B / 2 about the carrier's.
        """
        if self.profile is not None:
            return self.profile(time_s)
        if self.sweep_hz == 0.0:
            return self.window(time_s)
        envelope: Signal = self.window(time_s) * np.exp(1j * self._swept_phase(time_s))
        return envelope

    def envelope_above(self, frequency_hz: float, time_s: FloatArray) -> Signal:
        """What modulates a carrier of another frequency so that this pulse comes of it."""
        offset_hz = self.carrier_hz - frequency_hz
        if offset_hz == 0.0:
            return self.envelope(time_s)
        shifted: Signal = self.envelope(time_s) * np.exp(2j * np.pi * offset_hz * time_s)
        return shifted

    def waveform(self, time_s: FloatArray) -> FloatArray:
        """Transmitted signal p(t) = w(t) sin(2π f t + φ(t)), or w(t) itself without a carrier."""
        carrier = 2.0 * np.pi * self.carrier_hz * np.asarray(time_s)
        if self.profile is not None:
            return np.asarray((self.profile(time_s) * np.exp(1j * carrier)).imag)
        window = self.window(time_s)
        if not self.has_carrier:
            return window
        return window * np.sin(carrier + self._swept_phase(time_s))

    def _swept_phase(self, time_s: FloatArray) -> FloatArray:
        time_s = np.asarray(time_s, dtype=float)
        phase: FloatArray = np.pi * self.sweep_hz * time_s * (time_s / self.duration_s - 1.0)
        return phase

    def validate(self) -> None:
        """Raise `MalformedMessageError` unless the pulse can be emitted."""
        if not (np.isfinite(self.duration_s) and self.duration_s > 0.0):
            raise MalformedMessageError(
                "transducer.pulse_duration", f"is {self.duration_s:g} s, must be above 0"
            )
        bounds.check("transducer.pulse_duration", self.duration_s, bounds.PULSE_DURATION)
        if self.has_carrier and not (np.isfinite(self.carrier_hz) and self.carrier_hz > 0.0):
            raise MalformedMessageError(
                "transducer.carrier_frequency", f"is {self.carrier_hz:g} Hz, must be above 0"
            )
        if self.has_carrier:
            bounds.check("transducer.carrier_frequency", self.carrier_hz, bounds.CARRIER)
        if self.profile is not None:
            self.profile.validate()
            if not self.has_carrier:
                raise MalformedMessageError("pulse", "has a profile but no carrier")
        if self.sweep_hz == 0.0:
            return
        if self.shape is not PulseShape.CHIRP:
            raise MalformedMessageError("sweep", f"is {self.sweep_hz:g} Hz, only a chirp has one")
        if not (np.isfinite(self.sweep_hz) and abs(self.sweep_hz) < 2.0 * self.carrier_hz):
            raise MalformedMessageError(
                "sweep", f"is {self.sweep_hz:g} Hz, must be less than twice the carrier either way"
            )
