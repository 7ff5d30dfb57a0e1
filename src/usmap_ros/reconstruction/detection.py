"""How loud an echo must be to be told from noise, and what therefore may have gone unheard."""

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, IndexArray
from usmap_ros.numerics.compiled import compiled
from usmap_ros.numerics.special import normal_quantile
from usmap_ros.reconstruction.baseband import RAYLEIGH_MEAN, Baseband
from usmap_ros.reconstruction.delay_domain import DelayDictionary


def noise_thresholds(
    dictionary: DelayDictionary, baseband: Baseband, false_alarms: float
) -> FloatArray:
    """Scores that noise alone exceeds `false_alarms` times a ping, shape (blocks,).

    The modulus of a matched filter's complex output is Rayleigh distributed, that of a real
    one is normal; an envelope's noise is skewed, which the first Cornish-Fisher term corrects.
    """
    independent = max(1.0, dictionary.block_count / dictionary.oversampling)
    tail = false_alarms / independent
    if np.iscomplexobj(baseband.signal):
        deviations = np.sqrt(-np.log(tail))
    else:
        quantile = -normal_quantile(tail)
        skewness = baseband.noise_skewness * dictionary.template_skewness
        deviations = quantile + (quantile**2 - 1.0) * skewness / 6.0
    # Every further path adds the mean modulus of its noise to the weighted sum of `scores`.
    extra = RAYLEIGH_MEAN * dictionary.extra_paths
    thresholds: FloatArray = baseband.noise_std * (deviations + extra)
    return thresholds


def unreported(
    dictionary: DelayDictionary,
    thresholds: FloatArray,
    residual_scores: FloatArray,
    support: IndexArray,
    echo_scores: FloatArray,
    masking: float,
) -> FloatArray:
    """Amplitude below which an object at each block could have gone unreported.

    It is the threshold, or the score that was left unexplained there.  In the band about an
    echo, where no second one is reported, it is `masking` times that echo: a louder object
    would have made the echo itself louder.
    """
    begins, ends = dictionary.bands(support)
    scores = np.maximum(thresholds, residual_scores)
    _mask(scores, thresholds, begins, ends, masking * echo_scores)
    amplitudes: FloatArray = np.divide(scores, dictionary.unit_norms, out=scores)
    return amplitudes


@compiled
def _mask(
    scores: FloatArray,
    thresholds: FloatArray,
    begins: IndexArray,
    ends: IndexArray,
    masked: FloatArray,
) -> None:
    """Raise scores within bands to what an echo masks there, above the threshold."""
    for number in range(len(masked)):
        for block in range(begins[number], min(ends[number], len(scores))):
            scores[block] = max(scores[block], masked[number] + thresholds[block])


def crowding(overlaps: FloatArray, amplitudes: FloatArray) -> FloatArray:
    """Loudness of the other echoes as far as they overlap with each, shape (echoes,).

    Overlapping echoes interfere, and what is taken for one echo may be several that could not
    be told apart: an amplitude is uncertain by a share of theirs.
    """
    return np.sqrt((overlaps**2) @ (amplitudes**2))


def binned_maximum(
    values: FloatArray, ranges_m: FloatArray, start_m: float, step_m: float, stop_m: float
) -> FloatArray:
    """Largest value in each range bin; bins that hold no range are without limit."""
    bins = max(1, int(np.ceil((stop_m - start_m) / step_m - 1e-9)))
    return _largest(values, ranges_m, start_m, step_m, bins)


@compiled
def _largest(
    values: FloatArray, ranges_m: FloatArray, start_m: float, step_m: float, bins: int
) -> FloatArray:
    """Largest of the values in each of so many range bins; infinite where there is none."""
    largest, is_empty = np.zeros(bins), np.ones(bins, np.bool_)
    for number in range(len(values)):
        one = int((ranges_m[number] - start_m) / step_m)
        if 0 <= one < bins:
            largest[one] = values[number] if is_empty[one] else max(largest[one], values[number])
            is_empty[one] = False
    for one in range(bins):
        if is_empty[one]:
            largest[one] = np.inf
    return largest
