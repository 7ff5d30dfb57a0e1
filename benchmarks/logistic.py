"""Logistic regression, by Newton's method."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit

#: More than any fit needs.
STEPS = 50


def logistic_weights(
    told: NDArray[np.float64], is_so: NDArray[np.bool_], ridge: float, counts: ArrayLike = 1.0
) -> NDArray[np.float64]:
    """Likeliest weights of what is told, with a ridge that keeps them finite.

    Parameters
    ----------
    told : (cases, features) array
        What is told of each case.
    is_so : (cases,) bool array
        What is to be told by it.
    ridge : float
        Half of it times their square is added to the loss.
    counts : (cases,) array, optional
        How much each case counts; all the same by default.
    """
    counts = np.broadcast_to(np.asarray(counts, float), is_so.shape)
    weights = np.zeros(told.shape[1])
    for _ in range(STEPS):
        likely = expit(told @ weights)
        curvature = counts * likely * (1.0 - likely)
        hessian = told.T @ (told * curvature[:, np.newaxis]) + ridge * np.eye(len(weights))
        slope = told.T @ (counts * (is_so - likely)) - ridge * weights
        weights += np.linalg.solve(hessian, slope)
    return weights
