"""How loud an echo must be to be told from noise, and what therefore may have gone unheard."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from usmap_ros.arrays import FloatArray, IndexArray
from usmap_ros.reconstruction.baseband import RAYLEIGH_MEAN, Baseband
from usmap_ros.reconstruction.joint import DelayOperator


def noise_thresholds(
    operator: DelayOperator, baseband: Baseband, false_alarms: float
) -> FloatArray:
    """Scores that noise alone exceeds `false_alarms` times a ping, shape (blocks,).

    The modulus of a matched filter's complex output is Rayleigh distributed, that of a real
    one is normal; an envelope's noise is skewed, which the first Cornish-Fisher term corrects.
    """
    independent = max(1.0, operator.block_count / operator.oversampling)
    tail = false_alarms / independent
    if np.iscomplexobj(baseband.signal):
        deviations = np.sqrt(-np.log(tail))
    else:
        quantile = -float(ndtri(tail))
        skewness = baseband.noise_skewness * operator.template_skewness
        deviations = quantile + (quantile**2 - 1.0) * skewness / 6.0
    # Every further path adds the mean modulus of its noise to the weighted sum of `scores`.
    extra_paths = operator.path_weights.sum(axis=1) - 1.0
    thresholds: FloatArray = baseband.noise_std * (deviations + RAYLEIGH_MEAN * extra_paths)
    return thresholds


def unreported(
    operator: DelayOperator,
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
    scores = np.maximum(thresholds, residual_scores)
    for block, echo_score in zip(support, echo_scores, strict=True):
        band = operator.excluded(block)
        scores[band] = np.maximum(scores[band], masking * echo_score + thresholds[band])
    amplitudes: FloatArray = scores / operator.unit_norms
    return amplitudes


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
    index = ((ranges_m - start_m) / step_m).astype(np.intp)
    inside = (index >= 0) & (index < bins)
    largest = np.full(bins, -np.inf)
    np.maximum.at(largest, index[inside], values[inside])
    return np.where(np.isfinite(largest), largest, np.inf)
