"""Delays off the grid, and how well they are known."""

from __future__ import annotations

import numpy as np

from usmap_ros.arrays import FloatArray
from usmap_ros.reconstruction.cosamp import Solution, least_squares
from usmap_ros.reconstruction.joint import DelayOperator

#: Farthest that one step moves a delay, in grid steps: a linearisation holds no farther.
MAX_STEP = 1.0


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
        Standard deviation of each delay for noise of standard deviation 1 (the Cramér-Rao
        bound).
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
    variance = np.diagonal(covariance)
    if np.iscomplexobj(solution.residual):
        variance = variance / 2.0
    limit_s = MAX_STEP * operator.delay_step_s
    return np.clip(step_s, -limit_s, limit_s), np.sqrt(variance)
