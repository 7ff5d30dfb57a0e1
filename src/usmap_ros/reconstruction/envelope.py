"""What noise does to the amplitudes of echoes in an envelope.

The magnitude of an echo in complex noise has a Rice distribution: where there is no echo, its mean
is that of the noise alone, which is taken off a trace; within a loud echo noise adds next to
nothing, so that as much is missing there.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.special import ive

from usmap_ros.arrays import FloatArray
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


@lru_cache(maxsize=16)
def _fitted_ratios(template: Template) -> FloatArray:
    """What is fitted, on average, to echoes of the amplitudes `_RATIOS` in noise of 1."""
    margin_s = 0.5 * template.duration_s / _TEMPLATE_POINTS
    end_s = template.start_s + template.duration_s
    shape = template(
        np.linspace(template.start_s + margin_s, end_s - margin_s, _TEMPLATE_POINTS)
    ).real
    mean = _rice_mean(_RATIOS[:, np.newaxis] * shape) - _rice_mean(np.zeros(1))
    fitted: FloatArray = mean @ shape / np.sum(shape**2)
    return fitted


def _rice_mean(amplitude: FloatArray) -> FloatArray:
    """Mean of the magnitude of an amplitude plus complex noise of RMS 1."""
    half = 0.5 * amplitude**2
    mean: FloatArray = (
        0.5 * np.sqrt(np.pi) * ((1.0 + 2.0 * half) * ive(0, half) + 2.0 * half * ive(1, half))
    )
    return mean
