"""What noise does to the amplitudes and delays of echoes in an envelope.

The magnitude of an echo in complex noise has a Rice distribution: where there is no echo, its mean
is that of the noise alone, which is taken off a trace; within a loud echo noise adds next to
nothing, so that as much is missing there.  For the same reason a faint echo has steeper flanks
than an echo of the amplitude that is fitted, and less noise on them.
"""

from functools import lru_cache

import numpy as np

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.reconstruction.template import Template

#: Amplitudes over the standard deviation of the noise at which the mean is tabulated; far beyond
#: the last one the difference stays the same.
_RATIOS = np.concatenate([[0.0], np.geomspace(0.05, 1e3, 200)])
_TEMPLATE_POINTS = 200


def unbiased(fitted: FloatArray, template: Template, echo_noise_std: float) -> FloatArray:
    """Amplitudes of which least squares on the envelope, less its noise's mean, gives `fitted`.

    Parameters
    ----------
    fitted : array
        Amplitudes in the fit.
    template : Template
        What an echo looks like.
    echo_noise_std : float
        Standard deviation of the real part of the complex noise.
    """
    noise_std = float(np.sqrt(2.0)) * echo_noise_std
    if noise_std <= 0.0:
        return fitted
    seen = _fitted_ratios(template)
    ratio = fitted / noise_std
    inside = np.interp(ratio, seen, _RATIOS)
    amplitudes: FloatArray = noise_std * np.where(
        ratio > seen[-1], ratio + _RATIOS[-1] - seen[-1], inside
    )
    return amplitudes


def std_factors(
    fitted: FloatArray, template: Template, echo_noise_std: float
) -> tuple[FloatArray, FloatArray]:
    """By how much delays and amplitudes vary more than those of echoes as fitted, in real noise.

    With w the template, μ the mean of the envelope, v its variance and sums over the echo, a delay,
    which is where the correlation with w is greatest, has the variance Σ w'² v / (Σ w' μ')².  The
    fitted amplitude has Σ w² v / (Σ w²)², and what `unbiased` makes of it varies accordingly.

    Parameters
    ----------
    fitted, template, echo_noise_std
        As those of `unbiased`.

    Returns
    -------
    delay, amplitude : arrays
        Factors of standard deviations.
    """
    noise_std = float(np.sqrt(2.0)) * echo_noise_std
    if noise_std <= 0.0:
        return np.ones_like(fitted), np.ones_like(fitted)
    seen, delay, amplitude = _factors(template)
    ratio = fitted / noise_std
    return np.interp(ratio, seen, delay), np.interp(ratio, seen, amplitude)


@lru_cache(maxsize=16)
def _factors(template: Template) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What is fitted to echoes of the amplitudes `_RATIOS` above 0, and their `std_factors`."""
    time_s = _times_s(template)
    shape, slope = template(time_s).real, template.slope(time_s).real
    seen = _fitted_ratios(template)
    amplitude = _RATIOS[1:, np.newaxis] * shape
    variance = 1.0 + amplitude**2 - _rice_mean(amplitude) ** 2
    # Of an echo as fitted, and half of the noise's power.
    stated = np.sqrt(0.5) / (seen[1:] * np.linalg.norm(slope))
    steepness = (_rice_slope(amplitude) * _RATIOS[1:, np.newaxis] * slope) @ slope
    delay = np.sqrt(variance @ slope**2) / steepness / stated
    undone = np.gradient(_RATIOS, seen)[1:]
    of_amplitude = np.sqrt(variance @ shape**2) / np.linalg.norm(shape) * undone / np.sqrt(0.5)
    return seen[1:], delay, of_amplitude


def _times_s(template: Template) -> FloatArray:
    """Times over a template, none of them at its ends."""
    margin_s = 0.5 * template.duration_s / _TEMPLATE_POINTS
    end_s = template.start_s + template.duration_s
    return np.linspace(template.start_s + margin_s, end_s - margin_s, _TEMPLATE_POINTS)


@lru_cache(maxsize=16)
def _fitted_ratios(template: Template) -> FloatArray:
    """What is fitted, on average, to echoes of the amplitudes `_RATIOS` in noise of 1."""
    shape = template(_times_s(template)).real
    mean = _rice_mean(_RATIOS[:, np.newaxis] * shape) - _rice_mean(np.zeros(1))
    fitted: FloatArray = mean @ shape / np.sum(shape**2)
    return fitted


def _rice_mean(amplitude: FloatArray) -> FloatArray:
    """Mean of the magnitude of an amplitude plus complex noise of RMS 1."""
    # Here, because it takes long to load, and only envelopes need it.
    from scipy.special import ive

    half = 0.5 * amplitude**2
    mean: FloatArray = (
        0.5 * np.sqrt(np.pi) * ((1.0 + 2.0 * half) * ive(0, half) + 2.0 * half * ive(1, half))
    )
    return mean


def _rice_slope(amplitude: FloatArray) -> FloatArray:
    """Derivative of `_rice_mean`."""
    from scipy.special import ive

    half = 0.5 * amplitude**2
    slope: FloatArray = 0.5 * np.sqrt(np.pi) * amplitude * (ive(0, half) + ive(1, half))
    return slope
