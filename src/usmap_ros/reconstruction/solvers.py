"""The solvers that the paper names beside CoSaMP, by name.

They work on a stored real matrix.  What each one returns is cut to the `sparsity` columns that
contribute most, and fitted once more, because l1 shrinks its coefficients.  Whole numbers are kept
as they are, and so are images of total variation and walls unless the sparsity cuts them.

References
----------
.. [1] Sanchez & Andersson, "Using compressive sensing with in-air ultrasonic measurements for
   robotic mapping", DSCC 2018-9140.
.. [2] Pati, Rezaiifar & Krishnaprasad, "Orthogonal matching pursuit", Asilomar 1993, 40-44.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy import sparse
from scipy.optimize import nnls

from usmap_ros.numerics.arrays import FloatArray, IndexArray
from usmap_ros.parameters.pipeline import SolverName
from usmap_ros.reconstruction.analysis_form import (
    AnalysisOperator,
    diagonal_matrix,
    gradient_operator,
    least_analysis_cost,
    walls_operator,
)
from usmap_ros.reconstruction.cosamp import Halt, Solution, cosamp
from usmap_ros.reconstruction.matrix_operator import MatrixOperator, SparseMatrix
from usmap_ros.reconstruction.problem import Problem
from usmap_ros.reconstruction.whole_numbers import integer_programme

#: Real coefficients below this share of the largest contribution are not counted as found.
NEGLIGIBLE = 1e-3
#: Solvers whose coefficients are whole numbers, and those whose image as a whole is the solution.
WHOLE: tuple[SolverName, ...] = ("integer", "binary")
IMAGES: tuple[SolverName, ...] = ("tv", "walls")


def solve(problem: Problem, solver: SolverName) -> Solution:
    """Solve with the solver of that name.

    Raises
    ------
    ValueError
        If the signal is not finite.
    """
    if solver == "cosamp":
        return cosamp(
            problem.operator,
            problem.signal,
            problem.sparsity,
            threshold=problem.threshold,
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
    return _pruned(problem, coefficients, solver)


def orthogonal_matching_pursuit(problem: Problem) -> FloatArray:
    """OMP ([2]_): one column at a time, the one that explains most of what is left.

    It is what section 3 of [1]_ says of greedy algorithms: they "reconstruct one coefficient at
    a time, selecting the one that minimizes the residual".  CoSaMP takes up many at once.
    """
    operator = problem.operator
    support: IndexArray = np.empty(0, dtype=np.intp)
    solution = problem.fitted(support, 0, Halt.ITERATIONS)
    while len(support) < min(problem.sparsity, operator.block_count):
        if solution.residual_norm <= problem.tolerance:
            break
        proxy = operator.adjoint(solution.residual)
        scores = operator.scores(np.maximum(proxy, 0.0) if problem.non_negative else proxy)
        scores[support] = 0.0
        best = int(np.argmax(scores))
        if scores[best] <= problem.threshold:
            break
        support = np.sort(np.append(support, best))
        solution = problem.fitted(support, len(support), Halt.ITERATIONS)
    return _by_column(problem, solution.support, solution.coefficients[:, 0])


def basis_pursuit(problem: Problem) -> FloatArray:
    """Least l1 norm: equation (2) of [1]_, and equation (1) where ε is 0.

    The l1 norm is that of what the columns contribute, ‖a_i‖ |q_i|, so that a far cell costs no
    more than a near one that is as loud.
    """
    weights = AnalysisOperator(diagonal_matrix(problem.operator.norms))
    return _least(problem, problem.operator.matrix, weights)


def total_variation(problem: Problem) -> FloatArray:
    """Least total variation of the image of coefficients: equation (3) of [1]_.

    With ε above 0 its constraint is relaxed as in equation (2).
    """
    return _least(problem, problem.operator.matrix, gradient_operator(_places(problem)))


def few_walls(problem: Problem) -> FloatArray:
    """Least number of piecewise constant walls: the analysis operator of section 3 of [1]_.

    Of walls along the rows and walls along the columns; the sum of absolute differences along
    them takes the place of their number, as the l1 norm does that of the number of cells.
    """
    matrix = problem.operator.matrix
    both = sparse.hstack([sparse.csc_array(matrix)] * 2, format="csc")
    found = _least(problem, both, walls_operator(_places(problem)))
    return found[: matrix.shape[1]] + found[matrix.shape[1] :]


def non_negative_least_squares(problem: Problem) -> FloatArray:
    """Lawson & Hanson's NNLS of SciPy: no word of sparsity but the sign."""
    unit, norms = _unit_columns(problem.operator)
    return np.asarray(nnls(unit, problem.signal)[0]) / norms


_SOLVERS: dict[SolverName, Callable[[Problem], FloatArray]] = {
    "omp": orthogonal_matching_pursuit,
    "l1": basis_pursuit,
    "tv": total_variation,
    "walls": few_walls,
    "nnls": non_negative_least_squares,
    "integer": integer_programme,
    "binary": partial(integer_programme, most=1),
}


def _pruned(problem: Problem, coefficients: FloatArray, solver: SolverName) -> Solution:
    """Keep the columns that contribute most, and fit them once more where that helps."""
    operator = problem.operator
    strengths = np.abs(coefficients) * operator.norms
    if problem.non_negative:
        strengths = np.where(coefficients > 0.0, strengths, 0.0)
    negligible = 0.0 if solver in WHOLE else NEGLIGIBLE * float(strengths.max(initial=0.0))
    above = strengths > max(problem.threshold, negligible)
    order = np.argsort(-strengths, kind="stable")[: problem.sparsity]
    support = np.sort(order[above[order]])
    whole_image = solver in IMAGES and np.count_nonzero(above) == len(support)
    if solver in WHOLE or whole_image:
        return problem.solution(support, coefficients[support], Halt.MINIMUM)
    return problem.fitted(support, 1, Halt.MINIMUM)


def _least(problem: Problem, matrix: SparseMatrix, operator: AnalysisOperator) -> FloatArray:
    return least_analysis_cost(
        matrix, problem.signal, problem.tolerance, operator, non_negative=problem.non_negative
    )


def _places(problem: Problem) -> IndexArray:
    if problem.places is None:
        raise ValueError("an analysis operator needs the places of the columns")
    return problem.places


def _unit_columns(operator: MatrixOperator) -> tuple[FloatArray, FloatArray]:
    """All columns with unit norm, and their norms; columns of zeros stay as they are."""
    norms = np.where(operator.norms > 0.0, operator.norms, 1.0)
    return operator.columns(np.arange(operator.block_count)) / norms, norms


def _by_column(problem: Problem, support: IndexArray, values: FloatArray) -> FloatArray:
    """Coefficients of all columns, from those of a support."""
    coefficients = np.zeros(problem.operator.block_count)
    coefficients[support] = values
    return coefficients
