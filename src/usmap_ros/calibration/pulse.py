"""The pulse as it is received, measured on the strongest echo of many pings.

`usmap_ros.calibration.aligned_echoes` shifts and scales them onto one another: their mean is the
pulse, and what is left of each tells how far it can be relied on.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usmap_ros.acoustics.profile import Profile, resonant_profile
from usmap_ros.acoustics.pulse import Pulse
from usmap_ros.calibration.aligned_echoes import FINER, AlignedEchoes, align, misfits
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.arrays import FloatArray, Signal
from usmap_ros.parameters import PulseParameters, ReconstructionParameters
from usmap_ros.pings.preparation.prepare import prepared
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.reconstruction.baseband import Baseband, to_baseband
from usmap_ros.reconstruction.shared_noise import SharedNoise
from usmap_ros.reconstruction.template import Template

#: Time before and behind the loudest sample that is looked at, beside the burst's length.
_BEFORE_S, _BEHIND_S = 0.4e-3, 1.6e-3
#: Loudness over noise of an echo that tells the pulse, and echoes that are needed.
_LOUD = 20.0
_LEAST_ECHOES = 12
#: Echoes of each trace that tell a pulse which is not the stated one.
_MORE = 3
#: The template begins and ends where so little of its peak is left.
_SILENT = 0.02
#: Misfit of the stated pulse from which on a measured one is worth having; by how much that of the
#: latter must be smaller where other echoes are beside most; and what it may leave of the echo that
#: it explains best, over what the stated one does: resonant sensors come to 0.22 at most, rough
#: walls heard by sensors as stated to 0.41 at least.
_STATED_MISFIT, _IMPROVEMENT, _LONELIEST = 0.12, 0.8, 0.3
#: A little misfit counts too where no echo is without it, as of bursts whose edges were rounded:
#: the least that is left of one, and the same limits.  Bursts that a wave equation carried come to
#: 0.68 and 0.46 at most; where sensors are as stated, the loneliest keeps 0.73 at least.
_ALWAYS_LEFT, _BUT_LITTLE = 0.04, (0.7, 0.6)
#: Share of the echoes that have least beside them, quantile of those whose leftovers the model
#: error covers, and its least value.
_LONELY_SHARE, _COVERED, _LEAST_ERROR = 0.25, 0.75, 0.02
#: Qualities to start from, and bounds of quality and of the resonance over the carrier.
_QUALITIES = (5.0, 20.0, 60.0)
_LEAST_QUALITY, _GREATEST_QUALITY = 1.0, 300.0
_DETUNED = 0.1
#: Misfit of resonators, relative to the pulse, from which on they do not explain it.
_EXPLAINED = 0.3
#: Samples before a stated pulse, in which its beginning is smeared.
_LEAD = 6
#: Points that are compared.
_POINTS = 160


@dataclass(frozen=True)
class MeasuredPulse:
    """A pulse as it is received."""

    #: What reconstruction is to be told of it; the stated pulse where that fits as well.
    parameters: PulseParameters
    #: Median over echoes: norm of what the pulse leaves of one, relative to its own.
    residual: float
    #: The same of the pulse that traces state.
    stated_residual: float
    #: Amplitude of what is left beside an echo, relative to the echo, or stands beside most.
    model_error: float
    #: From how many it was measured.
    echoes: int
    #: Amplitude of what the pulse leaves of an echo that is freed of others, relative to it.
    own_error: float = _LEAST_ERROR

    @property
    def is_known(self) -> bool:
        """Whether it is not what traces state."""
        return self.parameters.kind == "measured"


def measure_pulse(
    traces: Sequence[EchoTrace], parameters: ReconstructionParameters
) -> MeasuredPulse | None:
    """Measure the pulse on the strongest echoes of traces; None if too few are loud.

    Parameters
    ----------
    traces : sequence of EchoTrace
        Of transducers of one kind.
    parameters : ReconstructionParameters
        What is known of them beside.
    """
    snippets, rate_hz, seen = _snippets(traces, parameters, 1)
    if len(snippets) < _LEAST_ECHOES:
        snippets, rate_hz, seen = _snippets(traces, parameters, _MORE)
    if len(snippets) < _LEAST_ECHOES or seen is None or not seen.pulse.has_carrier:
        return None
    pulse = seen.pulse
    apart = max(2, round(pulse.length_s * rate_hz))
    finely = _finely(seen, snippets.shape[1], rate_hz)
    as_stated = [_as_sampled(finely)]
    left_as_stated = misfits(snippets, as_stated, apart)
    if left_as_stated.min() > _ALWAYS_LEFT:
        # Of a pulse that nothing filtered, edges may fall anywhere between two samples.
        as_stated += [finely[part::FINER] for part in range(FINER)]
        left_as_stated = misfits(snippets, as_stated, apart)
    stated = residual = float(np.median(left_as_stated))
    is_much = stated > _STATED_MISFIT
    is_better = is_much or left_as_stated.min() > _ALWAYS_LEFT
    if is_better:
        improvement, loneliest = (_IMPROVEMENT, _LONELIEST) if is_much else _BUT_LITTLE
        residual = float(np.median(align(snippets, apart).misfits))
        is_better = (
            residual < improvement * stated
            and _least_left(snippets, apart) < loneliest * left_as_stated.min()
        )
    if not is_better:
        return MeasuredPulse(PulseParameters(), residual, stated, _LEAST_ERROR, len(snippets))
    # Others than the loudest may be lonelier, and take longer to look at.
    aligned = align(_snippets(traces, parameters, _MORE)[0], apart)
    return _measured(aligned, FINER * rate_hz, pulse, stated)


def _measured(
    aligned: AlignedEchoes, rate_hz: float, pulse: Pulse, stated_residual: float
) -> MeasuredPulse:
    """The pulse that echoes are aligned to, whose template has values at a rate."""
    # What is farther beside it in every ping, as it is while a robot stands, is not the pulse.
    risen, faded = _extent(aligned.template, rate_hz, pulse)
    template = _from_onset(aligned.template, risen, faded, rate_hz, pulse)
    own_error = _own_error(aligned)
    return MeasuredPulse(
        parameters=PulseParameters(
            kind="measured",
            template_rate_hz=float(rate_hz),
            template_i=[float(f"{one:.4g}") for one in template.real],
            template_q=[float(f"{one:.4g}") for one in template.imag],
        ),
        residual=float(np.median(aligned.misfits)),
        stated_residual=stated_residual,
        model_error=_model_error(aligned, len(template), own_error),
        echoes=len(aligned.crowded),
        own_error=own_error,
    )


def _snippets(
    traces: Sequence[EchoTrace], parameters: ReconstructionParameters, most: int
) -> tuple[Signal, float, Template | None]:
    """Baseband around so many echoes of each loud trace, (echoes, samples), and its rate.

    And what an echo of the stated pulse looks like in it.
    """
    found: list[Signal] = []
    rate_hz, seen = 0.0, None
    noise = SharedNoise(parameters)
    for trace in traces:
        try:
            known = prepared(noise.with_noise(trace), parameters)
            baseband = to_baseband(known)
        except MalformedMessageError:
            continue
        seen = seen or baseband.template
        rate_hz = rate_hz or baseband.sampling.sample_rate_hz
        if seen != baseband.template or baseband.sampling.sample_rate_hz != rate_hz:
            continue
        found += _around_loudest(baseband, seen.pulse, most)
    return np.array(found), rate_hz, seen


def _around_loudest(baseband: Baseband, pulse: Pulse, most: int) -> list[Signal]:
    """Around the loudest sample, and the loudest of those that are not near it, in turn."""
    magnitude = np.abs(baseband.signal)
    rate_hz = baseband.sampling.sample_rate_hz
    before = int(np.ceil((_BEFORE_S + pulse.length_s) * rate_hz))
    behind = int(np.ceil((_BEHIND_S + pulse.length_s) * rate_hz))
    found: list[Signal] = []
    for _ in range(most):
        loudest = int(np.argmax(magnitude))
        first, stop = loudest - before, loudest + behind
        if magnitude[loudest] < _LOUD * baseband.noise_std:
            break
        if first >= 0 and stop <= len(magnitude):
            found.append(np.asarray(baseband.signal[first:stop], dtype=np.complex128))
        magnitude[max(0, first) : loudest + before] = 0.0
    return found


def _least_left(snippets: Signal, apart: int) -> float:
    """What a mean of half of the echoes leaves of that which it explains best in the other half.

    Echoes that overlap, as those of rough walls do, are longer than the pulse: their mean explains
    most of them better than the pulse does, but not the loneliest, and none that is not in it.
    """
    halves = snippets[::2], snippets[1::2]
    return min(
        float(misfits(others, [align(half, apart).template[::FINER]], apart).min())
        for half, others in (halves, halves[::-1])
    )


def _finely(seen: Template, samples: int, rate_hz: float) -> Signal:
    """An echo of a pulse, `FINER` values to each sample."""
    time_s = seen.start_s + (np.arange(FINER * samples) - FINER * _LEAD) / (FINER * rate_hz)
    return np.asarray(seen(time_s), dtype=np.complex128)


def _as_sampled(finely: Signal) -> Signal:
    """Samples of an echo: of edges they keep what is below half of their rate."""
    spectrum = np.fft.fft(finely)
    spectrum[np.abs(np.fft.fftfreq(len(finely))) > 0.5 / FINER] = 0.0
    return np.asarray(np.fft.ifft(spectrum)[::FINER])


def _extent(template: Signal, rate_hz: float, pulse: Pulse) -> tuple[int, int]:
    """Where it rises from silence, and where it has faded."""
    magnitude = np.abs(template) / np.abs(template).max()
    peak = int(np.argmax(magnitude))
    # A loud later point belongs to it as long as it has not been silent for a burst's length.
    quiet = max(1, round(pulse.length_s * rate_hz))
    loud = np.flatnonzero(magnitude[peak:] > _SILENT)
    gaps = np.flatnonzero(np.diff(loud) > quiet)
    last = peak + int(loud[gaps[0]] if len(gaps) else loud[-1])
    silent = np.flatnonzero(magnitude[:peak] < _SILENT)
    return int(silent[-1]) if len(silent) else 0, last + 1


def _from_onset(template: Signal, risen: int, faded: int, rate_hz: float, pulse: Pulse) -> Signal:
    """From the onset, which in a burst that rises slowly is before anything is seen of it."""
    begins_s = onset_s(template[:faded], rate_hz, pulse)
    first = risen if begins_s is None else max(0, round(begins_s * rate_hz))
    trimmed = template[first : faded + 1].copy()
    trimmed[: max(0, risen - first)] *= np.linspace(0.0, 1.0, max(0, risen - first))
    return Profile.of(trimmed, rate_hz).values


def _own_error(aligned: AlignedEchoes) -> float:
    """What a matched filter makes of leftovers of the loneliest echoes, freed of others."""
    loneliest = aligned.misfits <= np.quantile(aligned.misfits, _LONELY_SHARE)
    freed = _answers(aligned.echoes[loneliest], aligned.template).max(axis=1)
    return float(np.clip(np.quantile(freed, _COVERED), _LEAST_ERROR, 0.5))


def _model_error(aligned: AlignedEchoes, pulse_points: int, own_error: float) -> float:
    """What a matched filter makes of leftovers and neighbours, relative to the echo, in most pings.

    What stands within the length of the pulse beside the strongest echo of most pings is of the
    sensor or of the object itself, and no other object.
    """
    beside = _answers(aligned.crowded, aligned.template)
    near = np.r_[0 : pulse_points + 1, -pulse_points:0]
    usual = np.median(beside[:, near].max(axis=1))
    return float(np.clip(max(own_error, usual), _LEAST_ERROR, 0.5))


def _answers(echoes: Signal, template: Signal) -> FloatArray:
    """Of a matched filter to what a template leaves of echoes, relative to them, by lag."""
    energy = np.vdot(template, template).real
    count = 2 * len(template)
    reference = np.fft.fft(template, count).conj()
    leftover = np.fft.fft(echoes - template, count, axis=1)
    answers: FloatArray = np.abs(np.fft.ifft(leftover * reference, axis=1)) / energy
    return answers


def onset_s(template: Signal, rate_hz: float, pulse: Pulse) -> float | None:
    """When the burst began, after the template's first value; None if resonators do not explain it.

    Latency and a slow rise look alike.  What tells them apart is the shape: a burst of known length
    through resonators has begun a known time before its echo is as loud as it is.

    Parameters
    ----------
    template : (n,) array
        A pulse as received, with silence before it.
    rate_hz : float
        Of its values.
    pulse : Pulse
        The burst that traces state.
    """
    drive = pulse.driven
    time_s = np.linspace(0.0, (len(template) - 1) / rate_hz, _POINTS)
    grid_s = np.arange(len(template)) / rate_hz
    seen: Signal = np.interp(time_s, grid_s, template)
    peak_s = float(grid_s[np.argmax(np.abs(template))])

    def left(unknowns: FloatArray) -> FloatArray:
        begins_s, log_first, log_second, detuning = unknowns
        frequency_hz = drive.carrier_hz * (1.0 + detuning)
        resonances = [(frequency_hz, float(np.exp(one))) for one in (log_first, log_second)]
        profile = resonant_profile(drive.envelope, drive.duration_s, drive.carrier_hz, resonances)
        shape = profile(time_s - 1e-3 * begins_s)
        scale = np.vdot(shape, seen) / max(float(np.linalg.norm(shape)) ** 2, 1e-12)
        return np.asarray((seen - scale * shape).view(float))

    # Here, because it takes a third of a second, and to look at a recording it is not needed.
    from scipy.optimize import least_squares

    bounds = (
        [1e3 * (peak_s - 3.0 * drive.duration_s - 1e-3), *[np.log(_LEAST_QUALITY)] * 2, -_DETUNED],
        [1e3 * peak_s, *[np.log(_GREATEST_QUALITY)] * 2, _DETUNED],
    )
    lowest, highest = (np.array(side, dtype=float) for side in bounds)
    best, least = None, _EXPLAINED * float(np.linalg.norm(seen))
    for quality in _QUALITIES:
        guess = [1e3 * (peak_s - drive.duration_s), np.log(quality), np.log(0.5 * quality), 0.0]
        start = np.clip(np.array(guess), lowest, highest)
        found = least_squares(left, start, bounds=(lowest, highest), max_nfev=40)
        misfit = float(np.sqrt(2.0 * found.cost))
        if misfit < least:
            best, least = 1e-3 * float(found.x[0]), misfit
    return best
