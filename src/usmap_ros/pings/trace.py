"""One ping's echo trace: what was received, and where from."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from usmap_ros import bounds
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.transducer_array import TransducerArray

#: A trace counts as saturated if so many samples repeat its largest or least value, and that is
#: this many times its noise: a coarse converter gives the noise, too, few values to take.
SATURATED_SAMPLES, SATURATED_OVER_NOISE = 2, 6.0
#: Where a transducer is in its own frame.
HERE = Pose.planar(0.0, 0.0, 0.0)


class Encoding(enum.IntEnum):
    """How `EchoTrace.samples` are to be read; the values are those of ``usmap_msgs/EchoTrace``."""

    RAW = 0
    ENVELOPE = 1
    IQ = 2


@dataclass(frozen=True)
class Emission:
    """A pulse that was in the air while a trace was received."""

    #: Frame of the transducer that sent it.
    child_frame_id: str
    #: Of that frame in the frame of the transducer that listened.
    mount: Pose
    transducer: Transducer


@dataclass(frozen=True)
class EchoTrace:
    """One ping (``usmap_msgs/EchoTrace``).

    Parameters
    ----------
    stamp_ns : int
        Start of emission, nanoseconds since the epoch.
    frame_id : str
        World frame of `pose`.
    child_frame_id : str
        The transducer's frame, +x along the beam axis.
    pose : Pose
        Of the transducer at the stamp.
    transducer : Transducer
        What it was sent and heard with.
    channel : Channel
        What the sound travelled through: sound speed, attenuation, floor.
    encoding : Encoding
        Raw samples, their envelope, or I/Q pairs.
    sample_rate_hz : float
        Rate of samples, or of I/Q pairs.
    start_delay_s : float
        From the stamp to the first sample.
    noise_std : float
        RMS of the receiver's noise in units of `samples`; 0: unknown.
    samples : (n,) float32 array
        As in the message; I and Q interleaved where the encoding is IQ.
    array : TransducerArray, optional
        Transducers that pinged at once, this one among them; None: it pinged alone.  The message
        has no field for it: it comes in a message of its own.
    """

    stamp_ns: int
    frame_id: str
    child_frame_id: str
    pose: Pose
    transducer: Transducer
    channel: Channel
    encoding: Encoding
    sample_rate_hz: float
    start_delay_s: float
    noise_std: float
    samples: NDArray[np.float32]
    array: TransducerArray | None = None

    @classmethod
    def from_signal(
        cls,
        signal: ArrayLike,
        sample_rate_hz: float,
        *,
        pose: Pose,
        transducer: Transducer,
        channel: Channel,
        stamp_ns: int = 0,
        noise_std: float = 0.0,
        is_envelope: bool = False,
    ) -> EchoTrace:
        """Trace of an array: complex baseband, raw samples, or their envelope.

        Its first sample is taken at the start of emission, its frames are ``map`` and ``sonar``;
        `dataclasses.replace` makes them others.

        Parameters
        ----------
        signal : (n,) array-like
            Complex: I + jQ; real: raw samples, or an envelope if `is_envelope`.  An ideal point
            target on axis at 1 m has an amplitude of 1.
        sample_rate_hz : float
            Of the signal.
        pose, transducer, channel, stamp_ns, noise_std
            See `EchoTrace`.

        Raises
        ------
        MalformedMessageError
            If it cannot be true.
        """
        values = np.asarray(signal)
        is_complex = np.iscomplexobj(values)
        real = Encoding.ENVELOPE if is_envelope else Encoding.RAW
        trace = cls(
            stamp_ns=stamp_ns,
            frame_id="map",
            child_frame_id="sonar",
            pose=pose,
            transducer=transducer,
            channel=channel,
            encoding=Encoding.IQ if is_complex else real,
            sample_rate_hz=sample_rate_hz,
            start_delay_s=0.0,
            noise_std=noise_std,
            samples=(
                np.ascontiguousarray(values, dtype=np.complex64).view(np.float32)
                if is_complex
                else values.astype(np.float32)
            ),
        )
        trace.validate()
        return trace

    def signal(self) -> FloatArray | NDArray[np.complex128]:
        """Samples as the receiver saw them: complex for I/Q, real otherwise."""
        if self.encoding is Encoding.IQ:
            pairs = np.asarray(self.samples, dtype=np.float64)
            return pairs.view(np.complex128)
        return np.asarray(self.samples, dtype=np.float64)

    @property
    def sampling(self) -> Sampling:
        """When its samples (or I/Q pairs) were taken, after the stamp."""
        count = len(self.samples) // (2 if self.encoding is Encoding.IQ else 1)
        return Sampling(self.sample_rate_hz, self.start_delay_s, count)

    @cached_property
    def sent(self) -> tuple[Emission, ...]:
        """Every pulse in the air, its own first if that was sent."""
        listener = None if self.array is None else self.array.element(self.child_frame_id)
        if self.array is None or listener is None:
            return (Emission(self.child_frame_id, HERE, self.transducer),)
        towards = listener.mount.inverse()
        emissions = [
            Emission(one.child_frame_id, towards.compose(one.mount), one.transducer)
            for one in self.array.elements
            if one.emits
        ]
        return tuple(sorted(emissions, key=self.is_own, reverse=True))

    def is_own(self, emission: Emission) -> bool:
        """Whether the transducer that listened sent a pulse itself."""
        return emission.child_frame_id == self.child_frame_id

    def in_array(self, array: TransducerArray) -> EchoTrace:
        """The trace, with the array that its transducer is of and what that says of its pulse.

        Raises
        ------
        MalformedMessageError
            If the trace says something else of its pulse.
        """
        listener = array.element(self.child_frame_id)
        if listener is None:
            return self
        told = self.with_sweep(listener.transducer.pulse.sweep_hz)
        if told.transducer.pulse != listener.transducer.pulse:
            raise MalformedMessageError(
                "transducer.pulse_shape",
                f"or another number of the pulse is not what the TransducerArray says of"
                f" {self.child_frame_id!r}",
            )
        return replace(told, array=array)

    def with_sweep(self, sweep_hz: float) -> EchoTrace:
        """The trace, with a sweep for its chirp if nobody has said yet how far it goes."""
        pulse = self.transducer.pulse
        if not pulse.lacks_sweep or sweep_hz == 0.0:
            return self
        transducer = replace(self.transducer, pulse=replace(pulse, sweep_hz=sweep_hz))
        return replace(self, transducer=transducer)

    def sample_times_s(self) -> FloatArray:
        """Delay of every sample (or I/Q pair) after the stamp."""
        return self.sampling.times_s

    def cut(self, first: int, stop: int | None = None) -> EchoTrace:
        """Only the samples (or I/Q pairs) from `first` to before `stop`."""
        values = 2 if self.encoding is Encoding.IQ else 1
        part = object.__new__(EchoTrace)
        # For every ping: `replace` takes ten times as long, and forgets which pulses were sent.
        vars(part).update(
            vars(self),
            start_delay_s=self.start_delay_s + first / self.sample_rate_hz,
            samples=self.samples[values * first : None if stop is None else values * stop],
        )
        return part

    @property
    def is_saturated(self) -> bool:
        """Whether several samples sit at either end of its scale, as behind a clipping converter.

        Its echoes are where they seem to be, but louder than they seem.
        """
        return len(self.saturated_s()) > 0

    def saturated_s(self) -> FloatArray:
        """Delays of samples (or I/Q pairs) at either end of its scale; none unless it clips."""
        # An envelope clips at one end only; I and Q have half of the noise's power each.
        noise_std = self.noise_std * (math.sqrt(0.5) if self.encoding is Encoding.IQ else 1.0)
        ends = {float(self.samples.max()), min(0.0, float(self.samples.min()))} - {0.0}
        loud = [end for end in ends if abs(end) > SATURATED_OVER_NOISE * noise_std]
        # Counted first, for nearly no trace clips.
        if sum(np.count_nonzero(self.samples == end) - 1 for end in loud) < SATURATED_SAMPLES:
            return np.empty(0)
        at_end = [np.flatnonzero(self.samples == end) for end in loud]
        at_end = [which for which in at_end if len(which) > 1]
        values = 2 if self.encoding is Encoding.IQ else 1
        return self.sample_times_s()[np.unique(np.concatenate(at_end) // values)]

    def validate(self) -> None:
        """Raise `MalformedMessageError` naming the first field that cannot be true."""
        bounds.check_name("header.frame_id", self.frame_id)
        bounds.check_name("child_frame_id", self.child_frame_id, may_be_empty=True)
        self.pose.validate()
        self.transducer.validate()
        self.channel.validate()
        self.transducer.validate_loss(self.channel.attenuation_db_m)
        self._validate_sampling()
        self._validate_samples()

    def _validate_sampling(self) -> None:
        bounds.check("sample_rate", self.sample_rate_hz, bounds.SAMPLE_RATE)
        samples_in_pulse = self.sample_rate_hz * self.transducer.pulse.duration_s
        is_mixed_down = self.encoding is Encoding.RAW and self.transducer.pulse.carrier_hz > 0.0
        most = bounds.MAX_RAW_PULSE_SAMPLES if is_mixed_down else bounds.MAX_PULSE_SAMPLES
        if not 1.0 <= samples_in_pulse <= most:
            raise MalformedMessageError(
                "sample_rate",
                f"of {self.sample_rate_hz:g} Hz puts {samples_in_pulse:.3g} samples on a pulse,"
                f" between 1 and {most} may be",
            )
        bounds.check("start_delay", self.start_delay_s, bounds.START_DELAY)
        bounds.check("noise_std", self.noise_std, bounds.LOUDNESS)

    def _validate_samples(self) -> None:
        if len(self.samples) == 0:
            raise MalformedMessageError("samples", "is empty")
        bounds.check_count("samples", len(self.samples), bounds.MAX_SAMPLES)
        if self.encoding is Encoding.IQ and len(self.samples) % 2:
            raise MalformedMessageError(
                "samples", f"has {len(self.samples)} entries, which are not I/Q pairs"
            )
        # What is not a number is the least and the greatest of those beside it.
        least, greatest = np.minimum.reduce(self.samples), np.maximum.reduce(self.samples)
        if bounds.AMPLITUDE.least <= least and greatest <= bounds.AMPLITUDE.greatest:
            return
        bad = np.count_nonzero(~np.isfinite(self.samples))
        if bad:
            raise MalformedMessageError("samples", f"has {bad} of {len(self.samples)} not finite")
        bounds.check_all("samples", self.samples, bounds.AMPLITUDE)
