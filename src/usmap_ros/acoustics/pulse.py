"""The pulse that a transducer emits (Sanchez & Andersson 2018, sections 2 and 4)."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from usmap_ros.arrays import FloatArray
from usmap_ros.errors import MalformedMessageError


class PulseShape(enum.IntEnum):
    """Shape of the pulse; the values are those of ``usmap_msgs/Transducer``."""

    SQUARE = 0
    TONE_BURST = 1
    HANN_BURST = 2


@dataclass(frozen=True)
class Pulse:
    """One emitted pulse p(t), as the transducer sends it out.

    Parameters
    ----------
    shape : PulseShape
        A square pulse without a carrier, or a sine under a rectangular or a Hann window.
    carrier_hz : float
        Carrier frequency; 0 for a square pulse.
    duration_s : float
        Length of the window.
    """

    shape: PulseShape
    carrier_hz: float
    duration_s: float

    @property
    def has_carrier(self) -> bool:
        """Whether the pulse modulates a carrier, so that an echo has a phase."""
        return self.shape is not PulseShape.SQUARE

    def window(self, time_s: FloatArray) -> FloatArray:
        """Envelope w(t): 0 outside [0, duration], with a peak of 1 inside."""
        phase = np.asarray(time_s, dtype=float) / self.duration_s
        inside = (phase >= 0.0) & (phase <= 1.0)
        if self.shape is PulseShape.HANN_BURST:
            return np.where(inside, np.sin(np.pi * phase) ** 2, 0.0)
        return inside.astype(float)

    def waveform(self, time_s: FloatArray) -> FloatArray:
        """Transmitted signal p(t) = w(t) sin(2π f t), or w(t) itself without a carrier."""
        window = self.window(time_s)
        if not self.has_carrier:
            return window
        return window * np.sin(2.0 * np.pi * self.carrier_hz * np.asarray(time_s))

    def validate(self) -> None:
        """Raise `MalformedMessageError` unless the pulse can be emitted."""
        if not (np.isfinite(self.duration_s) and self.duration_s > 0.0):
            raise MalformedMessageError(
                "transducer.pulse_duration", f"is {self.duration_s:g} s, must be above 0"
            )
        if self.has_carrier and not (np.isfinite(self.carrier_hz) and self.carrier_hz > 0.0):
            raise MalformedMessageError(
                "transducer.carrier_frequency", f"is {self.carrier_hz:g} Hz, must be above 0"
            )
