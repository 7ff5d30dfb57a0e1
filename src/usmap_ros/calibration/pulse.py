"""The pulse as it is received, measured on the strongest echo of many pings.

All of them are the same pulse, later and weaker or stronger: shifted and scaled onto one another,
their mean is the pulse, and what is left of each tells how far it can be relied on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usmap_ros.acoustics.profile import Profile
from usmap_ros.acoustics.pulse import Pulse
from usmap_ros.calibration.onset import onset_s
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.arrays import FloatArray, Signal
from usmap_ros.parameters import PulseParameters, ReconstructionParameters
from usmap_ros.pings.preparation.prepare import prepared
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.reconstruction.baseband import Baseband, to_baseband
from usmap_ros.reconstruction.shared_noise import SharedNoise

#: Time before and behind the loudest sample that is looked at, in addition to the burst's length,
#: and points of the template to each baseband sample.
_BEFORE_S, _BEHIND_S = 0.4e-3, 1.6e-3
_FINER = 8
#: Loudness over noise of an echo that tells the pulse, and echoes that are needed.
_LOUD = 20.0
_LEAST_ECHOES = 12
#: Rounds of shifting and averaging, and share of the echoes that are kept: those least like the
#: mean have others beside them.
_ROUNDS, _KEPT = 5, 0.6
#: Echoes that are told apart in the neighbourhood of the strongest, itself among them, and rounds
#: in which each is fitted beside the others.
_ECHOES, _SWEEPS = 4, 2
#: The template begins and ends where so little of its peak is left.
_SILENT = 0.02
#: Misfit of the stated pulse from which on a measured one is worth having, of a measured one that
#: can be relied on, and by how much the latter must be smaller.
_STATED_MISFIT, _MEASURED_MISFIT, _IMPROVEMENT = 0.12, 0.35, 0.6
#: Quantile of the pings whose leftovers the model error covers, and its least value.
_COVERED, _LEAST_ERROR = 0.75, 0.02


@dataclass(frozen=True)
class MeasuredPulse:
    """A pulse as it is received.

    Parameters
    ----------
    parameters : PulseParameters
        What reconstruction is to be told of it; the stated pulse where that fits as well.
    residual : float
        Median over echoes: norm of what the pulse leaves of one, relative to its own.
    stated_residual : float
        The same of the pulse that traces state.
    model_error : float
        Amplitude of what is left beside an echo, relative to the echo, or stands beside most.
    echoes : int
        From how many it was measured.
    own_error : float
        Amplitude of what the pulse leaves of an echo that is freed of others, relative to it.
    """

    parameters: PulseParameters
    residual: float
    stated_residual: float
    model_error: float
    echoes: int
    own_error: float = _LEAST_ERROR

    @property
    def is_known(self) -> bool:
        """Whether it is not what traces state."""
        return self.parameters.kind == "measured"


@dataclass(frozen=True)
class _Aligned:
    """Echoes on the template's grid, shifted and scaled to it: (echoes, points) and (points,).

    `echoes` and `misfits` are of those that the template is the mean of, freed of others beside
    them; `crowded` are all, with what is beside them.
    """

    echoes: Signal
    template: Signal
    misfits: FloatArray
    crowded: Signal


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
    snippets, rate_hz, pulse = _snippets(traces, parameters)
    if len(snippets) < _LEAST_ECHOES or pulse is None or not pulse.has_carrier:
        return None
    aligned = _aligned(snippets, max(2, round(pulse.length_s * rate_hz)))
    fine_hz = _FINER * rate_hz
    # What is farther beside it in every ping, as it is while a robot stands, is not the pulse.
    risen, faded = _extent(aligned.template, fine_hz, pulse)
    stated = _misfit_of(pulse, aligned.template[risen : faded + 1], fine_hz)
    residual = float(np.median(aligned.misfits))
    is_better = (
        stated > _STATED_MISFIT and residual < _MEASURED_MISFIT and residual < _IMPROVEMENT * stated
    )
    if not is_better:
        return MeasuredPulse(PulseParameters(), residual, stated, _LEAST_ERROR, len(snippets))
    template = _from_onset(aligned.template, risen, faded, fine_hz, pulse)
    told_pulse = PulseParameters(
        kind="measured",
        template_rate_hz=float(fine_hz),
        template_i=[float(f"{one:.4g}") for one in template.real],
        template_q=[float(f"{one:.4g}") for one in template.imag],
    )
    own_error = _own_error(aligned)
    model_error = _model_error(aligned, len(template), own_error)
    return MeasuredPulse(told_pulse, residual, stated, model_error, len(snippets), own_error)


def _snippets(
    traces: Sequence[EchoTrace], parameters: ReconstructionParameters
) -> tuple[Signal, float, Pulse | None]:
    """Baseband around the loudest sample of each loud trace, (echoes, samples), and its rate."""
    found: list[Signal] = []
    rate_hz, pulse = 0.0, None
    noise = SharedNoise(parameters)
    for trace in traces:
        try:
            known = prepared(noise.with_noise(trace), parameters)
            baseband = to_baseband(known)
        except MalformedMessageError:
            continue
        pulse = pulse or known.transducer.pulse
        rate_hz = rate_hz or baseband.sampling.sample_rate_hz
        if pulse != known.transducer.pulse or baseband.sampling.sample_rate_hz != rate_hz:
            continue
        snippet = _around_loudest(baseband, pulse)
        if snippet is not None:
            found.append(snippet)
    return np.array(found), rate_hz, pulse


def _around_loudest(baseband: Baseband, pulse: Pulse) -> Signal | None:
    magnitude = np.abs(baseband.signal)
    loudest = int(np.argmax(magnitude))
    rate_hz = baseband.sampling.sample_rate_hz
    before = int(np.ceil((_BEFORE_S + pulse.length_s) * rate_hz))
    behind = int(np.ceil((_BEHIND_S + pulse.length_s) * rate_hz))
    first, stop = loudest - before, loudest + behind
    if first < 0 or stop > len(magnitude) or magnitude[loudest] < _LOUD * baseband.noise_std:
        return None
    return np.asarray(baseband.signal[first:stop], dtype=np.complex128)


def _aligned(snippets: Signal, apart: int) -> _Aligned:
    """Shift and scale echoes onto their mean, without others beside them, and average anew.

    Parameters
    ----------
    snippets : (echoes, samples) array
        Around the loudest sample of each.
    apart : int
        Samples from an echo from which on another one is told from an error of the mean.
    """
    count, samples = snippets.shape
    spectra = np.fft.fft(snippets, 2 * samples, axis=1)
    peak = np.abs(snippets).argmax(axis=1)
    scaled = snippets / snippets[np.arange(count), peak][:, np.newaxis]
    template = np.median(scaled.real, axis=0) + 1j * np.median(scaled.imag, axis=0)
    kept = np.ones(count, dtype=bool)
    shifted, crowded, misfits = scaled, scaled, np.zeros(count)
    for _ in range(_ROUNDS):
        shifted, crowded, misfits = _onto(spectra, template, apart)
        kept = misfits <= np.quantile(misfits, _KEPT)
        template = shifted[kept].mean(axis=0)
    fine = _finer(template[np.newaxis])[0]
    return _Aligned(_finer(shifted[kept]), fine, misfits[kept], _finer(crowded))


def _onto(spectra: Signal, template: Signal, apart: int) -> tuple[Signal, Signal, FloatArray]:
    """Echoes freed of others, shifted by parts of a sample and scaled to fit a template.

    Returns them, (echoes, samples), the same with the others, and the norm of what the template
    leaves of each that is freed.
    """
    samples, width = len(template), spectra.shape[1]
    frequency = np.fft.fftfreq(width)
    reference = np.fft.fft(template, width)
    energy = np.vdot(template, template).real
    lags = np.zeros((_ECHOES, len(spectra)))
    parts = np.zeros((_ECHOES, *spectra.shape), dtype=np.complex128)
    for _ in range(_SWEEPS):
        for number in range(_ECHOES):
            rest = spectra - parts.sum(axis=0) + parts[number]
            # The first one is where it fits best, and the others not so near that they would take
            # an error of the template for an echo.
            near = (lags[0], apart) if number else None
            lags[number], scale = _best_place(rest, reference, near)
            turned = np.exp(-2j * np.pi * frequency * lags[number][:, np.newaxis])
            parts[number] = (scale / energy)[:, np.newaxis] * reference * turned
    alone = spectra - parts[1:].sum(axis=0)
    turned = np.exp(2j * np.pi * frequency * lags[0][:, np.newaxis])
    shifted: Signal = np.fft.ifft(alone * turned, axis=1)[:, :samples]
    scales = ((shifted @ template.conj()) / energy)[:, np.newaxis]
    crowded: Signal = np.fft.ifft(spectra * turned, axis=1)[:, :samples] / scales
    shifted = shifted / scales
    left_over = np.linalg.norm(shifted - template, axis=1) / np.sqrt(energy)
    return shifted, crowded, left_over


def _best_place(
    spectra: Signal, reference: Signal, away_from: tuple[FloatArray, int] | None
) -> tuple[FloatArray, Signal]:
    """Lag (samples, with parts) at which a template fits each signal best, and its product there.

    Not within so many samples of given lags, if any are.
    """
    width = spectra.shape[1]
    crossed = spectra * reference.conj()
    finer = np.zeros((len(spectra), _FINER * width), dtype=np.complex128)
    half = width // 2
    finer[:, :half], finer[:, -half:] = crossed[:, :half], crossed[:, -half:]
    product = _FINER * np.fft.ifft(finer, axis=1)
    correlation = np.abs(product)
    if away_from is not None:
        lags, apart = away_from
        places = np.arange(correlation.shape[1]) / _FINER
        distance = np.abs((places - lags[:, np.newaxis] + 0.5 * width) % width - 0.5 * width)
        correlation[distance < apart] = 0.0
    best = correlation.argmax(axis=1)
    rows, count = np.arange(len(best)), correlation.shape[1]
    left, middle, right = (correlation[rows, (best + step) % count] for step in (-1, 0, 1))
    bend = np.minimum(left - 2.0 * middle + right, -np.finfo(float).tiny)
    part = np.clip(0.5 * (left - right) / bend, -0.5, 0.5)
    return (best + part) / _FINER, product[rows, best]


def _finer(signals: Signal) -> Signal:
    """The same with `_FINER` points a sample, band-limited."""
    count, samples = signals.shape
    spectra = np.fft.fft(signals, axis=1)
    wide = np.zeros((count, _FINER * samples), dtype=np.complex128)
    half = (samples + 1) // 2
    wide[:, :half], wide[:, half - samples :] = spectra[:, :half], spectra[:, half:]
    finer: Signal = _FINER * np.fft.ifft(wide, axis=1)
    return finer


def _misfit_of(pulse: Pulse, template: Signal, rate_hz: float) -> float:
    """Norm of what a pulse, placed and scaled best, leaves of the template, relative to it."""
    time_s = np.arange(int(np.ceil(pulse.length_s * rate_hz)) + 1) / rate_hz
    shape = np.asarray(pulse.envelope(time_s), dtype=np.complex128)
    overlap = np.abs(np.correlate(template, shape, mode="full")).max()
    alike = overlap / (np.linalg.norm(shape) * np.linalg.norm(template))
    return float(np.sqrt(max(0.0, 1.0 - alike**2)))


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


def _own_error(aligned: _Aligned) -> float:
    """What a matched filter makes of leftovers of echoes that are freed of others."""
    freed = _answers(aligned.echoes, aligned.template).max(axis=1)
    return float(np.clip(np.quantile(freed, _COVERED), _LEAST_ERROR, 0.5))


def _model_error(aligned: _Aligned, pulse_points: int, own_error: float) -> float:
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
