"""The search for echoes: on a grid of delays, and off it.

CoSaMP picks delays on a grid, Gauss-Newton steps move them off it, and CoSaMP goes on from there,
all in one call of compiled code (`usmap_ros.reconstruction.sampled.search`); edges of pulses, which
look the same anywhere between two samples, are placed afterwards.
"""

from dataclasses import dataclass

import numpy as np

from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.numerics.arrays import FloatArray, IndexArray, Signal
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.reconstruction.baseband import Baseband
from usmap_ros.reconstruction.cosamp import check_signal
from usmap_ros.reconstruction.delay_domain import RIDGE, DelayDictionary
from usmap_ros.reconstruction.detection import noise_thresholds
from usmap_ros.reconstruction.sampled import search as sampled

#: A round of refinement whose largest step is below this share of a grid step is the last.
SETTLED_STEP = 0.05
#: A step below this share needs no other after it, unless it let new echoes be found: Gauss-Newton
#: steps converge quadratically, and next to nothing of a grid step is left.
SMALL_STEP = 0.6
#: What such a step leaves, as a share of a grid step.
LEFT_OVER = 0.001
#: Samples by which noise may seem to move an edge.
MOST_SAMPLES_OFF = 4
#: Variance of where the mean of a series changes, over (noise / change)⁴; two edges halve the
#: noise's power (Yao, Annals of Statistics 15, 1987, 1321-1328).
CHANGE_POINT_VARIANCE = 26.0
#: Largest ridge of least squares where objects have several paths, each with a coefficient of its
#: own: one over the floor may come with another object's straight one, and nearly alike, they had
#: hundreds of times what is heard, one against the other.
MOST_RIDGE = 1e-3
#: Part of a sample that rounding may amount to, and what keeps a quotient finite.
_ROUNDING = 1e-6
_TINY = 1e-30


@dataclass(frozen=True)
class FoundEchoes:
    """Echoes that were found in a signal."""

    #: (k,) array: ascending indices of their blocks.
    support: IndexArray
    #: (samples,) array: what they leave of the signal.
    residual: Signal
    #: (k,) arrays: ranges of its blocks off the grid, and standard deviations of their delays.
    ranges_m: FloatArray
    delay_stds_s: FloatArray
    #: (k,) array: scores that its echoes have by themselves.
    strengths: FloatArray
    #: (k, k) array: correlation of each two of its direct echoes, 0 of one with itself.
    overlaps: FloatArray
    #: (blocks,) arrays: what a score had to exceed, and the scores of the residual.
    thresholds: FloatArray
    residual_scores: FloatArray


def search(
    dictionary: DelayDictionary, baseband: Baseband, parameters: ReconstructionParameters
) -> FoundEchoes:
    """Search on the grid and move delays off it in turn, until they have settled.

    What a misplaced strong echo leaves behind would otherwise be taken for weak ones.

    Parameters
    ----------
    dictionary : DelayDictionary
        The sensing matrix, with all blocks on the grid.
    baseband : Baseband
        Signal, templates and noise of a trace.
    parameters : ReconstructionParameters
        Sparsity, thresholds, rounds.
    """
    signal = baseband.signal
    check_signal(dictionary.sampling.sample_count, signal)
    is_complex = np.iscomplexobj(signal)
    # How much of an echo may be due to its pulse being known imperfectly.
    model_error = max(parameters.model_error, *(one.misfit for one in baseband.templates))
    found = sampled.search(
        dictionary.sampled._replace(ridge=_ridge(dictionary, baseband)),
        signal.astype(np.complex128, copy=False),
        noise_thresholds(dictionary, baseband, parameters.false_alarms_per_ping),
        sampled.SearchSettings(
            sparsity=parameters.sparsity,
            max_iterations=parameters.max_iterations,
            non_negative=parameters.non_negative and not is_complex,
            model_error=model_error,
            refinements=parameters.refinements if dictionary.is_smooth else -1,
            settled=SETTLED_STEP,
            small=SMALL_STEP,
        ),
    )
    speed_m_s, ranges_m = dictionary.channel.sound_speed_m_s, found.ranges_m
    if dictionary.is_smooth:
        jitter_s = [template.delay_jitter_s for template in baseband.templates]
        left_s = np.hypot(
            dictionary.of_pulses(found.support, jitter_s), LEFT_OVER * dictionary.delay_step_s
        )
        stds_s = np.hypot(found.unit_stds_s * baseband.echo_noise_std, left_s)
    else:
        steps_s, stds_s = _between_samples(dictionary, baseband, found)
        ranges_m = ranges_m + 0.5 * speed_m_s * steps_s
    overlaps = _overlaps(dictionary, found.support, 2.0 * ranges_m / speed_m_s)
    return FoundEchoes(
        found.support,
        found.residual if is_complex else found.residual.real,
        ranges_m,
        stds_s,
        found.strengths,
        overlaps,
        found.thresholds,
        found.scores,
    )


def _ridge(dictionary: DelayDictionary, baseband: Baseband) -> float:
    """Ridge of least squares: noise's share of the power, where paths may be nearly alike.

    Without noise, columns that differ at all are told apart exactly.
    """
    if dictionary.path_weights.shape[1] == 1:
        return RIDGE
    power = float(np.mean(np.abs(baseband.signal) ** 2))
    return min(max(baseband.noise_std**2 / max(power, _TINY), RIDGE), MOST_RIDGE)


def _between_samples(
    dictionary: DelayDictionary, baseband: Baseband, found: sampled.SearchResult
) -> tuple[FloatArray, FloatArray]:
    """Steps and standard deviations of the delays where echoes have edges."""
    support = found.support
    delays_s = 2.0 * found.ranges_m / dictionary.channel.sound_speed_m_s
    steps_s = np.zeros(len(support))
    stds_s = np.full(len(support), dictionary.delay_step_s / np.sqrt(12.0))
    silent_std = baseband.noise_std
    if np.iscomplexobj(baseband.signal):
        silent_std /= np.sqrt(2.0)
    # On one side of an edge there is an echo, on the other there is none.
    noise_std = float(np.hypot(silent_std, baseband.echo_noise_std) / np.sqrt(2.0))
    for number, template in enumerate(baseband.templates):
        mine = dictionary.pulse_numbers(support) == number
        if not template.is_smooth:
            steps_s[mine], stds_s[mine] = between_samples(
                delays_s[mine],
                np.abs(found.coefficients[mine, 0]),
                noise_std,
                template.duration_s,
                baseband.sampling,
            )
    return steps_s, stds_s


def _overlaps(dictionary: DelayDictionary, support: IndexArray, delays_s: FloatArray) -> FloatArray:
    """Correlation of each two of several direct echoes, 0 of one with itself, (k, k)."""
    templates, later_s = dictionary.templates, delays_s[:, np.newaxis] - delays_s
    overlaps = templates[0].overlap(templates[0], later_s)
    # To pick pairs out takes as long as all else here, and most sensors have one pulse.
    if len(templates) > 1:
        of_pulse = [dictionary.pulse_numbers(support) == n for n in range(len(templates))]
        for rows, one in zip(of_pulse, templates, strict=True):
            for columns, other in zip(of_pulse, templates, strict=True):
                pairs = np.ix_(rows, columns)
                overlaps[pairs] = one.overlap(other, later_s[pairs])
    np.fill_diagonal(overlaps, 0.0)
    return overlaps


def between_samples(
    delay_s: FloatArray,
    amplitude: FloatArray,
    noise_std: float,
    duration_s: float,
    sampling: Sampling,
) -> tuple[FloatArray, FloatArray]:
    """Where between two samples the edges of rectangular echoes may be.

    Anywhere from one sample to the next the echo would look the same.  Noise of half the echo's
    amplitude makes it look as if it were one sample off, more noise several.

    Parameters
    ----------
    delay_s : (k,) array
        Delays at which the echoes fit.
    amplitude : (k,) array
        Amplitude of each echo.
    noise_std : float
        Standard deviation of the noise of samples about an edge, in phase with the echo.
    duration_s : float
        Length of an echo.
    sampling : Sampling
        When samples were taken.

    Returns
    -------
    step_s : (k,) array
        From each delay to the middle of those that look the same.
    std_s : (k,) array
        Standard deviations of the delays.
    """
    # Here, because it takes long to load, and only square pulses need it.
    from scipy.special import ndtr

    rate_hz = sampling.sample_rate_hz
    # In samples: the first that an echo touches, and the last.
    start = (delay_s - sampling.start_delay_s) * rate_hz
    length = duration_s * rate_hz
    first, last = np.ceil(start - _ROUNDING), np.floor(start + length + _ROUNDING)
    least = np.maximum(first - 1.0, last - length)
    most = np.minimum(first, last + 1.0 - length)
    # What looks different next is a sample away, and differs in one sample at either end; or half
    # a sample away and in one end only, where echoes last no whole number of samples.
    is_whole = abs(length - np.rint(length)) < _ROUNDING
    steps = np.arange(1.0, (1.0 if is_whole else 2.0) * MOST_SAMPLES_OFF + 1.0)[:, np.newaxis]
    offset, differing = (steps, 2.0 * steps) if is_whole else (0.5 * steps, steps)
    likeness = ndtr(-0.5 * np.sqrt(differing) * amplitude / max(noise_std, _TINY))
    rarely_off = 2.0 * np.sum(offset**2 * likeness, axis=0)
    # Much noise moves an edge as it moves a change of mean in a long series.
    often_off = CHANGE_POINT_VARIANCE * (noise_std / np.maximum(amplitude, _TINY)) ** 4 / 4.0
    variance = (most - least) ** 2 / 12.0 + np.minimum(rarely_off, often_off)
    return (0.5 * (least + most) - start) / rate_hz, np.sqrt(variance) / rate_hz
