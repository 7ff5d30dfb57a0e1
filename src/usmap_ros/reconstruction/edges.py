"""Where the edges of echoes are between two samples, and how well that is known."""

from __future__ import annotations

import numpy as np

from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.numerics.arrays import FloatArray

#: Samples by which noise may seem to move an edge.
MOST_SAMPLES_OFF = 4
#: Variance of where the mean of a series changes, over (noise / change)⁴; two edges halve the
#: noise's power (Yao, Annals of Statistics 15, 1987, 1321-1328).
CHANGE_POINT_VARIANCE = 26.0
#: Part of a sample that rounding may amount to, and what keeps a quotient finite.
_ROUNDING = 1e-6
_TINY = 1e-30


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
