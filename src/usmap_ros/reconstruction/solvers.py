"""The solvers that the paper names beside CoSaMP, taken from SciPy, scikit-learn and PyLops.

They work on a stored real matrix.  Whatever each one minimises, what it returns is treated
alike: the `sparsity` columns that contribute most are kept and fitted once more, because l1 and
total variation shrink their coefficients.

References
----------
.. [1] Sanchez & Andersson, "Using compressive sensing with in-air ultrasonic measurements for
   robotic mapping", DSCC 2018-9140: l1 with a noise bound (equation 2), total variation
   (equation 3).
.. [2] Efron, Hastie, Johnstone & Tibshirani, "Least angle regression", Ann. Statist. 32 (2004)
   407-499.
.. [3] Goldstein & Osher, "The split Bregman method for L1-regularized problems", SIAM J. Imaging
   Sci. 2 (2009) 323-343.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy import sparse
from scipy.optimize import Bounds, LinearConstraint, milp, nnls

from usmap_ros.arrays import FloatArray, IndexArray
from usmap_ros.errors import UsmapError
from usmap_ros.reconstruction.cosamp import Fit, Halt, Solution, cosamp
from usmap_ros.reconstruction.matrix_operator import MatrixOperator

SolverName = Literal["cosamp", "omp", "l1", "tv", "nnls", "integer", "binary"]
#: Coefficients below this share of the largest contribution are not counted as found.
NEGLIGIBLE = 1e-3
#: Weight of total variation relative to the largest correlation, and iterations of its solver.
TV_WEIGHT = 0.02
TV_ITERATIONS = 15
#: Objects of an integer solution in one cell, and seconds it may take.
MOST_OBJECTS = 8
MILP_SECONDS = 10.0


@dataclass(frozen=True)
class Problem:
    """What to solve: y ≈ Φ x with few entries in x.

    Parameters
    ----------
    operator : MatrixOperator
        Φ.
    signal : (samples,) array
        y, real.
    sparsity : int
        Most columns in the solution.
    tolerance : float
        ε, the norm of the noise.
    threshold : float
        Contribution that a column must exceed.
    non_negative : bool
        Whether coefficients must not be negative.
    places : (columns, 2) integer array, optional
        Row and column of the pixel of each column of Φ; total variation needs it.
    max_iterations : int
        Of CoSaMP.
    """

    operator: MatrixOperator
    signal: FloatArray
    sparsity: int
    tolerance: float = 0.0
    threshold: float = 0.0
    non_negative: bool = True
    places: IndexArray | None = None
    max_iterations: int = 20

    def fitted(self, support: IndexArray, iterations: int, halt: Halt) -> Solution:
        """Least-squares fit of the signal on the columns of a support."""
        return Fit(self.operator, self.signal, self.non_negative).on(support, iterations, halt)


def solve(problem: Problem, solver: SolverName) -> Solution:
    """Solve with the solver of that name.

    Raises
    ------
    UsmapError
        If the solver needs a package that is not installed.
    ValueError
        If the signal is not finite.
    """
    if solver == "cosamp":
        return cosamp(
            problem.operator,
            problem.signal,
            problem.sparsity,
            thresholds=problem.threshold,
            tolerance=problem.tolerance,
            non_negative=problem.non_negative,
            max_iterations=problem.max_iterations,
        )
    if not np.all(np.isfinite(problem.signal)):
        raise ValueError("signal is not finite")
    if not np.any(problem.signal):
        nothing: IndexArray = np.empty(0, dtype=np.intp)
        return Solution(nothing, np.zeros((0, 1)), problem.signal, 0, Halt.SILENCE)
    coefficients = _SOLVERS[solver](problem)
    return _pruned(problem, coefficients, refit=solver not in ("integer", "binary"))


def orthogonal_matching_pursuit(problem: Problem) -> FloatArray:
    """OMP of scikit-learn, until the residual is within the noise or k columns are taken."""
    linear_model = _optional("sklearn.linear_model", "scikit-learn")
    unit, norms = _unit_columns(problem.operator)
    with warnings.catch_warnings():
        # It warns when the rest of the signal is explained before k columns are used up.
        warnings.simplefilter("ignore", RuntimeWarning)
        found = linear_model.orthogonal_mp(
            unit, problem.signal, n_nonzero_coefs=min(problem.sparsity, unit.shape[1])
        )
    return np.asarray(found).reshape(-1) / norms


def basis_pursuit(problem: Problem) -> FloatArray:
    """Least l1 norm with a residual of at most ε; [1]_, equation 2, for columns of unit norm.

    Follows the path of all lasso solutions from zero on ([2]_, in scikit-learn); it is piecewise
    linear, and the point on it at which the residual has the norm ε is the solution.
    """
    linear_model = _optional("sklearn.linear_model", "scikit-learn")
    unit, norms = _unit_columns(problem.operator)
    with warnings.catch_warnings():
        # It warns where the path ends early because columns are nearly alike.
        warnings.simplefilter("ignore")
        *_, path = linear_model.lars_path(
            unit, problem.signal, method="lasso", positive=problem.non_negative, max_iter=500
        )
    misfits = np.linalg.norm(problem.signal[:, np.newaxis] - unit @ path, axis=0)
    within = np.flatnonzero(misfits <= problem.tolerance)
    if len(within) == 0 or within[0] == 0:
        return np.asarray(path[:, -1] if len(within) == 0 else path[:, 0]) / norms
    before, after = path[:, within[0] - 1], path[:, within[0]]
    share = _crossing(problem.signal - unit @ before, unit @ (after - before), problem.tolerance)
    return np.asarray(before + share * (after - before)) / norms


def total_variation(problem: Problem) -> FloatArray:
    """Least total variation of the image of coefficients; [1]_, equation 3, by [3]_ in PyLops.

    The bound on the residual enters as a weight: λ = `TV_WEIGHT` · max |Φᵀ y|.
    """
    pylops = _optional("pylops", "pylops")
    from pylops.optimization.sparsity import splitbregman

    if problem.places is None:
        raise ValueError("total variation needs the places of the columns")
    unit, norms = _unit_columns(problem.operator)
    corner = problem.places.min(axis=0)
    shape = tuple(int(side) for side in problem.places.max(axis=0) - corner + 1)
    pixels = np.ravel_multi_index(tuple((problem.places - corner).T), shape)
    # What lies outside the cone is empty, so its border counts too.
    image = pylops.Restriction(shape[0] * shape[1], pixels, dtype="float64").H
    gradient = [
        pylops.FirstDerivative(shape, axis=axis, edge=True, kind="backward") @ image
        for axis in (0, 1)
    ]
    weight = TV_WEIGHT * float(np.abs(unit.T @ problem.signal).max())
    found, *_ = splitbregman(
        pylops.MatrixMult(unit),
        problem.signal,
        gradient,
        niter_outer=TV_ITERATIONS,
        niter_inner=2,
        mu=1.0 / weight,
        epsRL1s=[1.0, 1.0],
        **{"iter_lim": 10, "damp": 1e-6},
    )
    found = np.asarray(found)
    return (np.maximum(found, 0.0) if problem.non_negative else found) / norms


def non_negative_least_squares(problem: Problem) -> FloatArray:
    """Lawson & Hanson's NNLS of SciPy: no word of sparsity but the sign."""
    unit, norms = _unit_columns(problem.operator)
    return np.asarray(nnls(unit, problem.signal)[0]) / norms


def integer_programme(problem: Problem, most: int = MOST_OBJECTS) -> FloatArray:
    """Least sum of absolute residuals with whole numbers of equal objects (HiGHS, in SciPy).

    The paper suggests whole or binary coefficients where all objects are alike.  A linear
    programme takes the l1 norm of the residual in place of the l2 norm.  The samples are turned
    onto the span of the columns first, which leaves no more rows than columns.
    """
    columns = problem.operator.block_count
    turned, matrix = np.linalg.qr(problem.operator.columns(np.arange(columns)))
    signal = turned.T @ problem.signal
    rows = len(signal)
    # Variables: x, then bounds u on the residuals: −u ≤ y − Φ x ≤ u.
    residuals = np.eye(rows)
    above = LinearConstraint(sparse.csc_array(np.hstack([matrix, residuals])), lb=signal)
    below = LinearConstraint(sparse.csc_array(np.hstack([matrix, -residuals])), ub=signal)
    result = milp(
        c=np.concatenate([np.zeros(columns), np.ones(rows)]),
        integrality=np.concatenate([np.ones(columns), np.zeros(rows)]),
        bounds=Bounds(0.0, np.concatenate([np.full(columns, most), np.full(rows, np.inf)])),
        constraints=[above, below],
        options={"time_limit": MILP_SECONDS},
    )
    return np.zeros(columns) if result.x is None else np.rint(result.x[:columns])


def binary_programme(problem: Problem) -> FloatArray:
    """`integer_programme` with at most one object in a cell."""
    return integer_programme(problem, most=1)


_SOLVERS: dict[str, Callable[[Problem], FloatArray]] = {
    "omp": orthogonal_matching_pursuit,
    "l1": basis_pursuit,
    "tv": total_variation,
    "nnls": non_negative_least_squares,
    "integer": integer_programme,
    "binary": binary_programme,
}


def _pruned(problem: Problem, coefficients: FloatArray, *, refit: bool) -> Solution:
    """Keep the columns that contribute most, and fit them once more."""
    operator = problem.operator
    strengths = np.abs(coefficients) * operator.norms
    if problem.non_negative:
        strengths = np.where(coefficients > 0.0, strengths, 0.0)
    limit = max(problem.threshold, NEGLIGIBLE * float(strengths.max(initial=0.0)))
    order = np.argsort(-strengths, kind="stable")[: problem.sparsity]
    support = np.sort(order[strengths[order] > limit])
    if refit:
        return problem.fitted(support, 1, Halt.MINIMUM)
    chosen = coefficients[support]
    residual = problem.signal - operator.columns(support) @ chosen
    return Solution(support, chosen[:, np.newaxis], residual, 1, Halt.MINIMUM)


def _unit_columns(operator: MatrixOperator) -> tuple[FloatArray, FloatArray]:
    """All columns with unit norm, and their norms; columns of zeros stay as they are."""
    norms = np.where(operator.norms > 0.0, operator.norms, 1.0)
    return operator.columns(np.arange(operator.block_count)) / norms, norms


def _crossing(start: FloatArray, way: FloatArray, norm: float) -> float:
    """Share of `way` after which ‖start − share · way‖ has fallen to `norm`."""
    square, mixed = float(way @ way), float(start @ way)
    root = np.sqrt(max(mixed**2 - square * (float(start @ start) - norm**2), 0.0))
    return float(np.clip((mixed - root) / square, 0.0, 1.0))


def _optional(module: str, package: str) -> Any:
    """Import what only some solvers need."""
    from importlib import import_module

    try:
        return import_module(module)
    except ImportError as error:
        raise UsmapError(
            f"this solver needs {package}: pip install 'usmap_ros[solvers]'"
        ) from error
