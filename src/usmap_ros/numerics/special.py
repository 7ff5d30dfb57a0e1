"""Functions of one formula that SciPy has, too, and that mapping a recording needs.

To load `scipy.special` and `scipy.ndimage` takes longer than to map a short recording.  What else
there is in SciPy is imported by the functions that few programs call.
"""

from statistics import NormalDist
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import RealArray


@overload
def logit(probability: float) -> float: ...


@overload
def logit(probability: RealArray) -> RealArray: ...


def logit(probability: float | RealArray) -> float | RealArray:
    """Log-odds of a probability: ln(p / (1 - p)), infinite at 0 and 1."""
    with np.errstate(divide="ignore"):
        log_odds: float | RealArray = np.log(probability) - np.log1p(-probability)
    return log_odds


def logistic(log_odds: RealArray) -> RealArray:
    """Probability of log-odds, 1 / (1 + exp(-x)), of the same precision."""
    probability: RealArray = np.exp(-np.logaddexp(0.0, -log_odds, dtype=log_odds.dtype))
    return probability


def normal_quantile(probability: float) -> float:
    """Where a standard normal variable stays below with a probability."""
    return NormalDist().inv_cdf(probability)


def entropy(probability: RealArray) -> RealArray:
    """-p ln p, and 0 at 0."""
    least = np.finfo(probability.dtype).tiny
    return -probability * np.log(np.maximum(probability, least))


def running_maximum(values: NDArray[Any], width: int) -> NDArray[Any]:
    """Greatest of each value and its neighbours.

    Parameters
    ----------
    values : (n, ...) array
        Of any type that has an order; of several dimensions, along the first.
    width : int
        How many values count, an odd number: as many behind each as before it, as far as there are.
    """
    reach = width // 2
    padded = np.pad(values, [(reach, reach), *[(0, 0)] * (values.ndim - 1)], mode="edge")
    # Every step doubles the stretch that each entry is the maximum of.
    stretch = 1
    while 2 * stretch <= width:
        padded = np.maximum(padded[:-stretch], padded[stretch:])
        stretch *= 2
    rest = width - stretch
    greatest: NDArray[Any] = np.maximum(padded[: len(values)], padded[rest : rest + len(values)])
    return greatest
