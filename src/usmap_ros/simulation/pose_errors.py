"""How a robot's reported poses are off: anew with every ping, or by a bias that wanders."""

from __future__ import annotations

import math

import numpy as np

from usmap_ros.numerics.arrays import FloatArray


class PoseErrors:
    """Errors of x, y and yaw in standard deviations, from ping to ping.

    A first-order Gauss-Markov process: what odometry or a filter makes of a pose is not off anew
    a tenth of a second later.

    Parameters
    ----------
    seed : numpy.random.SeedSequence
        What they are drawn from.
    wander_s : float
        Time in which the memory of an error falls to 1/e; 0 draws each anew.
    """

    def __init__(self, seed: np.random.SeedSequence, wander_s: float) -> None:
        self._rng = np.random.default_rng(seed)
        self._wander_s = wander_s
        self._time_s = -math.inf
        self._error = np.zeros(3)

    def at(self, time_s: float) -> FloatArray:
        """Errors at a time, which lies after the last one that was asked for.

        Parameters
        ----------
        time_s : float
            On any clock; where it was set back, the error stays as it is.
        """
        passed_s = max(time_s - self._time_s, 0.0)
        memory = math.exp(-passed_s / self._wander_s) if self._wander_s else 0.0
        news = self._rng.standard_normal(3)
        self._error = memory * self._error + math.sqrt(1.0 - memory * memory) * news
        self._time_s = time_s
        return self._error
