"""The part of a trace in which the receiver listened.

At first the transmitter rings on, and clips whatever receives; some receivers mute themselves once
they have detected something.  Neither part has anything to say: not of echoes, not of their
absence, and not of the noise.
"""

import math

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, median
from usmap_ros.pings.trace import EchoTrace

#: Samples in a segment, at least, and segments of a trace, at least.
_SEGMENT_SAMPLES = 16
_LEAST_SEGMENTS = 8
#: The transmitter is heard if the first pulse length is so loud, relative to the loudest sample and
#: to the usual one; it rings until it has fallen to so little, and not beyond this part of a trace.
_RINGING_OVER_LOUDEST, _RINGING_OVER_USUAL = 0.3, 10.0
_RUNG_OUT = 0.1
_LONGEST_RINGING = 0.3
#: A trigger may be so late, if so many samples are at the end of the scale; what rings falls by
#: this factor from half a pulse length to the next, down to so many times the usual sample.
_LATEST_START_S, _CLIPPED_SAMPLES = 0.001, 3
_STILL_FALLING, _OVER_QUIET = 0.95, 3.0
#: A muted end is so much quieter (power) than the noise before it, and than the noise that is
#: stated; segments belong to it that are not louder than this, and it has this part of a trace.
_MUTED_BELOW_NOISE, _MUTED_BELOW_STATED = 0.04, 0.1
_MUTED_EVENNESS = 4.0
_LEAST_MUTED = 0.1
#: Quantile of the segments before it that is taken for noise.
_QUIET = 0.1


def valid_part(trace: EchoTrace, from_s: float = 0.0, until_s: float = 0.0) -> EchoTrace:
    """Return the part of `trace` in which its receiver listened.

    It begins where an echo from the transducer's least range would, or where the transmitter has
    rung out if that is later, and ends where the receiver is muted for the rest of the trace.

    Parameters
    ----------
    trace : EchoTrace
        As recorded; it stays as it is.
    from_s, until_s : float
        When its samples begin and cease to be valid, after the start of emission; 0: that is found.
    """
    rate_hz, start_s = trace.sample_rate_hz, trace.start_delay_s
    count = trace.sampling.sample_count
    # Sound of another transducer may come a shorter way, but by no more than their distance.
    apart_m = max(math.hypot(*one.mount.position_m.tolist()) for one in trace.sent)
    nearest_m = 2.0 * trace.transducer.min_range_m - apart_m
    nearest_s = nearest_m / trace.channel.sound_speed_m_s
    magnitude = np.abs(trace.signal())
    nearest = max(0, math.floor((nearest_s - start_s) * rate_hz))
    if from_s:
        valid = math.ceil((from_s - start_s) * rate_hz)
    else:
        valid = _rung_out(trace, magnitude, nearest)
    first = max(nearest, valid)
    # Without a single sample left there would be nothing to reconstruct, and no error either.
    first = min(first, count - 1)
    if until_s:
        stop = min(count, max(first + 1, math.ceil((until_s - start_s) * rate_hz)))
    else:
        stop = first + _muted_from(trace, magnitude[first:])
    return trace if (first, stop) == (0, count) else trace.cut(first, stop)


def _rung_out(trace: EchoTrace, magnitude: FloatArray, nearest: int) -> int:
    """First sample at which the transmitter is no longer heard; 0 if it never is.

    Nothing else is heard before the sample `nearest`.
    """
    pulse_s, rate_hz = trace.transducer.pulse.duration_s, trace.sample_rate_hz
    emitting = int((pulse_s - trace.start_delay_s) * rate_hz)
    if emitting >= len(magnitude):
        return 0
    start = _ringing_from(magnitude, emitting, int(_LATEST_START_S * rate_hz), nearest)
    if start is None:
        return 0
    # A trace that begins after the burst may still begin with its ringing.
    emitting = max(1, emitting if emitting > 0 else int(pulse_s * rate_hz))
    loudest = float(magnitude[start : start + emitting].max())
    segment = max(2, emitting // 2)
    first, longest = start + emitting, int(_LONGEST_RINGING * len(magnitude))
    heard, quiet = loudest, _OVER_QUIET * median(magnitude)
    while first < longest:
        now = float(magnitude[first : first + segment].max())
        # It is over when it is no longer heard, or something else begins.
        if now < _RUNG_OUT * loudest and (now < quiet or now > _STILL_FALLING * heard):
            return first
        heard = now
        first += segment
    return max(longest, emitting)


def _ringing_from(magnitude: FloatArray, emitting: int, latest: int, nearest: int) -> int | None:
    """Sample from which on the transmitter is heard; None if it is not.

    With a trigger that comes late, or resonances that rise slowly, it begins late; then it has to
    be the loudest of all from before any echo, or to clip, as no echo does so early.
    """
    loudest = int(magnitude.argmax())
    peak = magnitude[loudest]
    begins = []
    if emitting > 0 and (at_first := magnitude[:emitting].max()) >= _RINGING_OVER_LOUDEST * peak:
        begins.append((0, at_first))
    if loudest < nearest:
        begins.append((loudest, peak))
    # The first of the samples that clip is the loudest one, too.
    if emitting > 0 and loudest < emitting + latest:
        early = magnitude[: emitting + latest]
        if np.count_nonzero(early == peak) >= _CLIPPED_SAMPLES:
            begins.append((loudest, peak))
    # What is usual is asked for last, and rarely, because that takes longest.
    if not any(_may_be_unusual(heard, magnitude) for _, heard in begins):
        return None
    usual = _RINGING_OVER_USUAL * median(magnitude)
    return next((begin for begin, heard in begins if heard >= usual), None)


def _may_be_unusual(heard: float, magnitude: FloatArray) -> bool:
    """False only of what is too faint, whatever is usual."""
    louder = np.count_nonzero(_RINGING_OVER_USUAL * magnitude > heard)
    return bool(2 * louder <= len(magnitude) + 1)


def _muted_from(trace: EchoTrace, magnitude: FloatArray) -> int:
    """First sample of those at the end that are muted; their number if none is."""
    count = len(magnitude)
    segment = max(_SEGMENT_SAMPLES, count // 64)
    segments = count // segment
    if segments < _LEAST_SEGMENTS:
        return count
    at_end = float(magnitude[-segment:].sum()) / segment
    if at_end**2 > _MUTED_BELOW_STATED * trace.noise_std**2 > 0.0:
        return count
    # From the end, so that it is a whole number of segments long.
    blocks = magnitude[count - segments * segment :].reshape(segments, segment)
    power = np.median(blocks, axis=1) ** 2
    floor = float(power[-2:].max())
    even = power <= _MUTED_EVENNESS * floor
    loud = np.flatnonzero(~even)
    first = int(loud[-1]) + 1 if len(loud) else 0
    if first == 0 or segments - first < max(2.0, _LEAST_MUTED * segments):
        return count
    noise = float(np.quantile(power[:first], _QUIET))
    is_muted = floor < _MUTED_BELOW_NOISE * noise
    return count - (segments - first) * segment if is_muted else count
