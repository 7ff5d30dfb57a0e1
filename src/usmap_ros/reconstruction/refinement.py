"""Delays off the grid, and how well they are known."""

from __future__ import annotations

import numpy as np

from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.reconstruction.cosamp import Solution, least_squares
from usmap_ros.reconstruction.joint import DelayOperator

#: Farthest that one step moves a delay, in grid steps: a linearisation holds no farther.
MAX_STEP = 1.0
#: Samples by which noise may seem to move an edge.
MOST_SAMPLES_OFF = 4
#: Variance of where the mean of a series changes, over (noise / change)⁴; two edges halve the
#: noise's power (Yao, Annals of Statistics 15, 1987, 1321-1328).
CHANGE_POINT_VARIANCE = 26.0
#: Part of a sample that rounding may amount to, and what keeps a quotient finite.
_ROUNDING = 1e-6
_TINY = 1e-30


def delay_step(operator: DelayOperator, solution: Solution) -> tuple[FloatArray, FloatArray]:
    """One Gauss-Newton step on the delays of all echoes together.

    The residual is linearised in the delays, D = ∂(Φ x)/∂τ, and the part of D that the
    coefficients can explain is projected out, so that step and variance account for
    amplitudes and phases being unknown too.

    Parameters
    ----------
    operator : DelayOperator
        At whose delays `solution` was fitted.
    solution : Solution
        A least-squares fit: its residual is orthogonal to its columns.

    Returns
    -------
    step_s : (k,) array
        What to add to the delay of each block.
    unit_std_s : (k,) array
        Standard deviation of each delay for noise of standard deviation 1 in phase with the
        echoes (the Cramér-Rao bound).
    """
    count, paths = solution.coefficients.shape
    if count == 0:
        return np.zeros(0), np.zeros(0)
    columns = operator.columns(solution.support)
    slopes = operator.slopes(solution.support) * solution.coefficients.reshape(-1)
    slopes = slopes.reshape(-1, count, paths).sum(axis=2)
    free = slopes - columns @ least_squares(columns, slopes)
    information = np.real(free.conj().T @ free)
    diagonal = np.einsum("ii->i", information)
    # Echoes too faint to move at all must not make the system singular.
    diagonal += 1e-6 * diagonal.max() + np.finfo(float).tiny
    covariance = np.linalg.inv(information)
    step_s = covariance @ np.real(free.conj().T @ solution.residual)
    limit_s = MAX_STEP * operator.delay_step_s
    return np.clip(step_s, -limit_s, limit_s), np.sqrt(np.diagonal(covariance))


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
