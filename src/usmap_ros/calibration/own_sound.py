"""What a transducer hears of itself in every ping, sample by sample.

Casing and mount answer each ping alike, often louder than all objects, and a ring-down that does
not clip falls alike.  Sampled with its phase, an echo is never the same from two places; what is,
of a robot that moves, is the sensor's own, and can be taken off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from usmap_ros.calibration.ringing import could_stand_as_far
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.arrays import BoolArray, FloatArray, IndexArray, Signal
from usmap_ros.parameters import ReconstructionParameters, RingingParameters
from usmap_ros.pings.preparation.prepare import prepared
from usmap_ros.pings.preparation.ring_down import on_grid
from usmap_ros.pings.trace import EchoTrace, Encoding

#: Traces that are needed, and the share of them that must be alike.
_LEAST_TRACES, _SHARE = 12, 0.7
#: What is the same is so many times as loud as what differs; the median of a dozen traces of noise
#: alone comes to a half.
_LOUDER = 2.0
#: How far from a line, or a circle, a path must be: a millimetre turns an echo's phase, but poses
#: may be off by centimetres.
_OFF_M = 0.05


@dataclass(frozen=True)
class OwnSound:
    """What is the same in every trace, once it is prepared."""

    #: (n,) values as `EchoTrace.signal` has them, from the first to the last that is not 0.
    signal: Signal
    #: Rate of the values, and time of the first one after the start of emission.
    rate_hz: float
    start_s: float

    @property
    def end_s(self) -> float:
        """Time of the last value."""
        return self.start_s + (len(self.signal) - 1) / self.rate_hz

    def added_to(self, ringing: RingingParameters) -> RingingParameters:
        """Parameters by which it is taken off."""
        values = np.ascontiguousarray(self.signal).view(np.float64)
        waveform = {
            "waveform": [float(f"{one:.4g}") for one in values],
            "waveform_rate_hz": self.rate_hz,
            "waveform_start_s": self.start_s,
        }
        return ringing.model_copy(update=waveform)


def own_sound_of(
    traces: Sequence[EchoTrace], parameters: ReconstructionParameters
) -> OwnSound | None:
    """What a transducer hears of itself; None: nothing, or that cannot be told.

    Parameters
    ----------
    traces : sequence of EchoTrace
        Of one transducer, from places apart.
    parameters : ReconstructionParameters
        What is known of them.
    """
    placed = _on_one_grid(_with_phase(traces, parameters))
    if len(placed) < _LEAST_TRACES:
        return None
    signals, start_s = _stacked(placed)
    heard = [trace for trace, _ in placed]
    rate_hz = heard[0].sample_rate_hz
    usual = _quantile(signals.real, 0.5) + 1j * _quantile(signals.imag, 0.5)
    is_own = _is_alike(signals, usual, heard[0])
    for first, stop in _stretches(is_own):
        range_m = 0.5 * heard[0].channel.sound_speed_m_s * (start_s + first / rate_hz)
        members = _members(signals[:, first:stop], usual[first:stop])
        positions_m = np.array([heard[row].pose.position_m[:2] for row in members])
        if len(members) < _LEAST_TRACES or could_stand_as_far(positions_m, range_m, _OFF_M):
            is_own[first:stop] = False
    if not is_own.any():
        return None
    first, stop = np.flatnonzero(is_own)[[0, -1]] + (0, 1)
    signal = np.where(is_own, usual, 0.0)[first:stop]
    is_real = heard[0].encoding is Encoding.RAW
    return OwnSound(signal.real if is_real else signal, rate_hz, start_s + first / rate_hz)


def _is_alike(signals: Signal, usual: Signal, trace: EchoTrace) -> BoolArray:
    """When most signals, (traces, samples), are like the usual one, (samples,), and it is loud."""
    samples = max(1, round(trace.transducer.pulse.duration_s * trace.sample_rate_hz))
    differing = _quantile(np.abs(signals - usual), _SHARE)
    alike: BoolArray = _power(usual, samples) > _LOUDER**2 * _power(differing, samples)
    return alike


def _members(signals: Signal, usual: Signal) -> IndexArray:
    """Which signals are like the usual one for most of a stretch, since it may hold an echo."""
    apart = np.nan_to_num(np.abs(signals - usual), nan=np.inf)
    level = np.sqrt(np.mean(np.abs(usual) ** 2))
    return np.flatnonzero(_LOUDER * np.median(apart, axis=1) < level)


def _with_phase(
    traces: Sequence[EchoTrace], parameters: ReconstructionParameters
) -> list[EchoTrace]:
    """Traces as they are reconstructed; those that cannot be, and envelopes, are left out."""
    found = []
    for trace in traces:
        if trace.encoding is Encoding.ENVELOPE:
            continue
        try:
            found.append(prepared(trace, parameters))
        except MalformedMessageError:
            # Its reconstruction will say why it cannot be used.
            continue
    return found


def _on_one_grid(traces: list[EchoTrace]) -> list[tuple[EchoTrace, int]]:
    """Those sampled at the same times as the middle one, and how many samples later they begin."""
    if not traces:
        return []
    middle = traces[len(traces) // 2]
    return [
        (trace, begin)
        for trace in traces
        if trace.encoding is middle.encoding
        and trace.sample_rate_hz == middle.sample_rate_hz
        and (begin := on_grid(trace, middle.start_delay_s)) is not None
    ]


def _stacked(traces: list[tuple[EchoTrace, int]]) -> tuple[Signal, float]:
    """Their signals by time, (traces, samples), NaN where one did not listen; and when they begin.

    Only times at which enough of them listened.
    """
    earliest, least = min(traces, key=itemgetter(1))
    samples = max(begin - least + trace.sampling.sample_count for trace, begin in traces)
    signals = np.full((len(traces), samples), np.nan, dtype=np.complex128)
    for row, (trace, begin) in zip(signals, traces, strict=True):
        row[begin - least :][: trace.sampling.sample_count] = trace.signal()
    listening = np.sum(~np.isnan(signals.real), axis=0)
    enough = np.flatnonzero(listening >= max(_LEAST_TRACES, _SHARE * len(traces)))
    first, stop = (enough[0], enough[-1] + 1) if len(enough) else (0, 0)
    return signals[:, first:stop], earliest.start_delay_s + first / earliest.sample_rate_hz


def _quantile(values: FloatArray, share: float) -> FloatArray:
    """Quantile of each column's values that are not NaN."""
    last = np.sum(~np.isnan(values), axis=0) - 1
    columns = np.arange(values.shape[1])
    # NaN are sorted to the end.
    return np.asarray(np.sort(values, axis=0)[np.round(share * last).astype(int), columns])


def _power(signal: Signal, samples: int) -> FloatArray:
    """Mean power of so many samples about each."""
    return np.convolve(np.abs(signal) ** 2, np.full(samples, 1.0 / samples), "same")[: len(signal)]


def _stretches(mask: BoolArray) -> list[tuple[int, int]]:
    """First and one past the last of those in a row."""
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
