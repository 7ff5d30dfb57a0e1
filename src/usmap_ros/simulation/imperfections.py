"""What real receivers do beside receiving: ring, keep silent, mute themselves, and count late."""

from dataclasses import dataclass

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, Signal
from usmap_ros.parameters import ParameterGroup, quantity
from usmap_ros.pings.trace import Encoding

#: What a receiver that is silent lets through, of amplitudes.
SILENT_GAIN = 0.03


class RingDown(ParameterGroup):
    """The transmitter, heard by the receiver beside it."""

    amplitude: float = quantity(
        ..., "While it sends; an ideal point target at 1 m gives 1.", gt=0.0, le=1e6
    )
    decay_s: float = quantity(..., "Time in which it falls to 1/e afterwards.", "s", gt=0.0, le=1.0)

    def envelope(self, time_s: FloatArray, duration_s: float) -> FloatArray:
        """Amplitude at times after the start of a burst of `duration_s`."""
        ringing = np.exp(-np.maximum(time_s - duration_s, 0.0) / self.decay_s)
        return np.where(time_s >= 0.0, self.amplitude * ringing, 0.0)


class Muting(ParameterGroup):
    """A receiver that stops listening once it has detected something."""

    threshold: float = quantity(
        ..., "Amplitude that it detects; an ideal point target at 1 m gives 1.", gt=0.0, le=1e6
    )
    hold_s: float = quantity(0.002, "How long it goes on listening.", "s", ge=0.0, le=10.0)
    from_s: float = quantity(
        0.0, "When it begins to look for something, after the emission.", "s", ge=0.0, le=10.0
    )


@dataclass(frozen=True)
class Imperfections:
    """All that is beside the point of a receiver; nothing of it by default."""

    #: Samples are so many times what they should be.
    gain: float = 1.0
    #: Added to every sample behind the gain, as by a converter that has no sign.
    offset: float = 0.0
    #: Samples are taken so much earlier than the trace says: echoes come out later.
    latency_s: float = 0.0
    #: The transmitter beside it.
    ring_down: RingDown | None = None
    #: Until then after the start of emission the receiver is silent.
    blanking_s: float = 0.0
    #: Whether it stops listening.
    muting: Muting | None = None
    #: Delay (s) and amplitude of what casing and mount return of every ping.
    own_echoes: tuple[tuple[float, float], ...] = ()

    def ringing(
        self, times_s: FloatArray, duration_s: float, carrier_hz: float, encoding: Encoding
    ) -> Signal | None:
        """What is heard of the transmitter in raw samples, or over the carrier; None: nothing.

        Parameters
        ----------
        times_s : (n,) array
            When samples are taken, as the trace says.
        duration_s, carrier_hz : float
            Of the burst that it sends.
        encoding : Encoding
            Of the trace.
        """
        if self.ring_down is None:
            return None
        age_s = times_s - self.latency_s
        envelope = self.ring_down.envelope(age_s, duration_s)
        if encoding is Encoding.RAW and carrier_hz > 0.0:
            return envelope * np.sin(2.0 * np.pi * carrier_hz * age_s)
        return envelope

    def sensitivity(self, times_s: FloatArray, envelope: FloatArray) -> FloatArray | None:
        """Share of every sample that comes through; None: all of it.

        Parameters
        ----------
        times_s : (n,) array
            When samples are taken.
        envelope : (n,) array
            Magnitude of what there is to hear, without noise.
        """
        if self.blanking_s == 0.0 and self.muting is None:
            return None
        silent = times_s < self.blanking_s + self.latency_s
        if self.muting is not None:
            looked = ~silent & (times_s >= self.muting.from_s + self.latency_s)
            detected = np.flatnonzero(looked & (envelope > self.muting.threshold))
            if len(detected):
                silent |= times_s > times_s[detected[0]] + self.muting.hold_s
        return np.where(silent, SILENT_GAIN, 1.0)


#: Of an ideal receiver.
NO_IMPERFECTIONS = Imperfections()
