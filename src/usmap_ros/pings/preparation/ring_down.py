"""Traces and cones without what their transducer hears of itself in every ping."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from usmap_ros.errors import MalformedMessageError
from usmap_ros.parameters import RingingParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace, Encoding

#: How far from where the ringing was found its echoes may be, and how much louder.
_WIDTH_M, _LOUDER = 0.02, 1.5
#: Part of a sample by which samples taken at the same times may be apart.
_SAME_TIME = 0.02


def without_own_sound(trace: EchoTrace, ringing: RingingParameters) -> EchoTrace:
    """Take off a trace what its transducer hears of itself, sample by sample.

    Parameters
    ----------
    trace : EchoTrace
        Corrected, and its valid part alone; it stays as it is.
    ringing : RingingParameters
        With the waveform of what is heard. Traces that are sampled between its values are left.

    Raises
    ------
    MalformedMessageError
        If the trace is an envelope, or of another rate.
    """
    if not ringing.waveform_rate_hz:
        return trace
    if trace.encoding is Encoding.ENVELOPE:
        raise MalformedMessageError(
            "encoding", "is of an envelope, which reconstruction.ringing.waveform cannot be in"
        )
    if trace.sample_rate_hz != ringing.waveform_rate_hz:
        raise MalformedMessageError(
            "sample_rate",
            f"is {trace.sample_rate_hz:g} Hz, reconstruction.ringing.waveform is of"
            f" {ringing.waveform_rate_hz:g} Hz",
        )
    after = on_grid(trace, ringing.waveform_start_s)
    if after is None:
        return trace
    values = 2 if trace.encoding is Encoding.IQ else 1
    own = _as_samples(tuple(ringing.waveform))[values * max(0, after) :]
    first = values * max(0, -after)
    samples = trace.samples.copy()
    heard = samples[first : first + len(own)]
    heard -= own[: len(heard)]
    return replace(trace, samples=samples)


def on_grid(trace: EchoTrace, start_s: float) -> int | None:
    """After how many samples from a time on its first is taken; None if between two of them."""
    after = (trace.start_delay_s - start_s) * trace.sample_rate_hz
    return round(after) if abs(after - round(after)) < _SAME_TIME else None


@lru_cache(maxsize=16)
def _as_samples(waveform: tuple[float, ...]) -> NDArray[np.float32]:
    return np.array(waveform, dtype=np.float32)


def without_ringing(cone: EchoCone, ringing: RingingParameters) -> EchoCone:
    """Drop echoes that are no louder than the ringing where they are, and say what it hides.

    Parameters
    ----------
    cone : EchoCone
        As reconstructed, with what the transducer hears of itself among its echoes.
    ringing : RingingParameters
        What is heard in every ping.
    """
    if not any(ringing.amplitudes):
        return cone
    loudness = _LOUDER * np.asarray(ringing.amplitudes)
    at_m = np.asarray(ringing.ranges_m)
    near = np.abs(cone.ranges_m[:, np.newaxis] - at_m) < _WIDTH_M
    begin_m = cone.transducer.min_range_m + cone.limit_step_m * np.arange(
        len(cone.detection_limits)
    )
    reached = (begin_m[:, np.newaxis] < at_m + _WIDTH_M) & (
        begin_m[:, np.newaxis] + cone.limit_step_m > at_m - _WIDTH_M
    )
    return cone.louder_than(
        np.max(np.where(near, loudness, -1.0), axis=1),
        np.max(np.where(reached, loudness, 0.0), axis=1),
    )
