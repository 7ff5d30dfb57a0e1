"""Equations (1) to (3) of the paper, and its analysis form, as one convex problem.

    minimise    Σ_g ‖(Ω q)_g‖₂    subject to    ‖y − A q‖₂ ≤ ε,  and q ≥ 0 where asked for

Sanchez & Andersson, DSCC 2018-9140, write three of its cases down.  With Ω the identity it is
equation (1) for ε = 0, and equation (2).  With Ω the gradient of the image of coefficients it is
equation (3), total variation, for ε = 0, and its "relaxed" form for noise.  Other operators make
the analysis model of their section 2.2; `walls_operator` is the one for "a sparse number of
walls using a difference operator" of section 3.

References
----------
.. [1] Boyd, Parikh, Chu, Peleato & Eckstein, "Distributed optimization and statistical learning
   via the alternating direction method of multipliers", Found. Trends Mach. Learn. 3 (2011)
   1-122.
.. [2] Rudin, Osher & Fatemi, "Nonlinear total variation based noise removal algorithms",
   Physica D 60 (1992) 259-268.
.. [3] Nam, Davies, Elad & Gribonval, "The cosparse analysis model and algorithms", Appl.
   Comput. Harmon. Anal. 34 (2013) 30-56.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from usmap_ros.numerics.arrays import FloatArray, IndexArray
from usmap_ros.reconstruction.matrix_operator import SparseMatrix

#: Iterations at most, and the change and disagreement relative to the signal at which to stop.
MAX_ITERATIONS = 3000
ACCURACY = 1e-6
#: Price of a residual beyond ε, relative to the dearest row of Ω.  Finite, so that there is a
#: solution too where no q comes within ε: then what counts is how near it comes.
BEYOND_BOUND = 1e4
#: Over-relaxation ([1]_, section 3.4.3); when the penalty is adapted, and by how much (3.4.1).
RELAXATION = 1.6
ADAPT_EVERY, ADAPT_RATIO, ADAPT_FACTOR = 20, 5.0, 2.0
#: Up to so many columns matrices are kept dense.
DENSE_COLUMNS = 800


@dataclass(frozen=True)
class AnalysisOperator:
    """Ω, and which of its rows belong together."""

    #: (group_size * groups, columns) sparse array: Ω.  Row g, row g + groups, … make up group g.
    matrix: SparseMatrix
    #: Rows in a group: 1 for a sum of absolute values, 2 for a sum of lengths of gradients.
    group_size: int = 1

    def cost(self, coefficients: FloatArray) -> float:
        """Σ_g ‖(Ω q)_g‖₂."""
        groups = (self.matrix @ coefficients).reshape(self.group_size, -1)
        return float(np.linalg.norm(groups, axis=0).sum())


def diagonal_matrix(values: FloatArray) -> SparseMatrix:
    """Sparse matrix with `values` on its diagonal; SciPy 1.11 has no ``diags_array``."""
    return sparse.csc_array(sparse.diags(values))


def gradient_operator(places: IndexArray) -> AnalysisOperator:
    """D of equation (3): differences to the next pixel above and to the right ([2]_).

    Parameters
    ----------
    places : (columns, 2) integer array
        Row and column of each coefficient's pixel.  Pixels that have none are empty.
    """
    upward, rightward = _differences(places, axis=0), _differences(places, axis=1)
    used = np.flatnonzero(abs(upward).sum(axis=1) + abs(rightward).sum(axis=1))
    return AnalysisOperator(sparse.csc_array(sparse.vstack([upward[used], rightward[used]])), 2)


def walls_operator(places: IndexArray) -> AnalysisOperator:
    """Differences along walls, which are zero but where a wall begins or ends ([3]_).

    It acts on two images, one after the other: of walls along the rows and of walls along the
    columns; the map is their sum.  A wall costs its two ends, however long it is, and so does
    an object by itself.

    Parameters
    ----------
    places : (columns, 2) integer array
        Row and column of each coefficient's pixel.  Pixels that have none are empty.
    """
    along = [_differences(places, axis) for axis in (1, 0)]
    used = [one[np.flatnonzero(abs(one).sum(axis=1))] for one in along]
    return AnalysisOperator(sparse.csc_array(sparse.block_diag(used)))


def _differences(places: IndexArray, axis: int) -> SparseMatrix:
    """Next pixel along an axis less this one, for all pixels of a frame about the image."""
    corner = places.min(axis=0) - 1
    shape = tuple(int(side) for side in places.max(axis=0) - corner + 2)
    pixels = np.ravel_multi_index(tuple((places - corner).T), shape)
    entries = (np.ones(len(pixels)), (pixels, np.arange(len(pixels))))
    image = sparse.csr_array(entries, shape=(shape[0] * shape[1], len(pixels)))
    step = shape[1] if axis == 0 else 1
    count = shape[0] * shape[1]
    difference = sparse.diags([-1.0, 1.0], [0, step], shape=(count, count))
    return sparse.csr_array(difference @ image)


def least_analysis_cost(
    matrix: FloatArray | SparseMatrix,
    signal: FloatArray,
    bound: float,
    operator: AnalysisOperator,
    *,
    non_negative: bool,
) -> FloatArray:
    """Coefficients of least cost whose residual is within a bound.

    Parameters
    ----------
    matrix : (samples, columns) array or sparse array
        A.  Columns of zeros get coefficients of zero.
    signal : (samples,) array
        The samples y that A q approximates.
    bound : float
        ε, largest norm of the residual.  Where it cannot be reached, the residual is made as
        small as it can be.
    operator : AnalysisOperator
        Ω, whose groups of Ω q are to be few.
    non_negative : bool
        Whether coefficients must not be negative.

    Returns
    -------
    (columns,) array
        q.

    Notes
    -----
    Solved by the alternating direction method of multipliers ([1]_, sections 3 and 5.1) with
    the splitting A q = u, q = p, Ω p = v, p = w: u lies in the ball about y, v is shrunk, w is
    not negative.  Columns are scaled to norm 1 and so are rows of Ω, which changes the steps
    but not the problem.
    """
    columns, norms = _unit_columns(matrix)
    total = float(np.linalg.norm(signal))
    if total <= bound or not np.any(norms):
        return np.zeros(len(norms))
    heard = np.where(norms > 0.0, norms, 1.0)
    analysis, prices = _unit_groups(operator, heard)
    columns, signal, bound = _compressed(columns, signal / total, bound / total)
    steps = _Iteration(columns, signal, bound, analysis, prices / prices.max(), non_negative)
    return np.where(norms > 0.0, steps.run() * total / heard, 0.0)


class _Iteration:
    """The alternating directions, for a signal of norm 1 and columns of norm 1.

    The four constraints are kept in one vector each for what their left sides, right sides and
    multipliers are.
    """

    def __init__(
        self,
        matrix: SparseMatrix,
        signal: FloatArray,
        bound: float,
        analysis: SparseMatrix,
        prices: FloatArray,
        non_negative: bool,
    ) -> None:
        rows, columns = matrix.shape
        self.signal, self.bound, self.prices = signal, bound, prices
        self.non_negative = non_negative
        ends = [0, *np.cumsum([rows, columns, analysis.shape[0], columns])]
        self.parts = [slice(*pair) for pair in pairwise(ends)]
        self.fit = _Regularised(matrix)
        identity = diagonal_matrix(np.ones(columns))
        self.smooth = _inverse(2.0 * identity + analysis.T @ analysis)
        self.matrix, self.analysis = _quick(matrix), _quick(analysis)

    def run(self) -> FloatArray:
        """Iterate until nothing moves and all constraints hold; returns q, or w."""
        right = np.zeros(self.parts[-1].stop)
        multipliers = np.zeros_like(right)
        left, penalty = right, 1.0
        for iteration in range(1, MAX_ITERATIONS + 1):
            left = self._left(right - multipliers, penalty)
            moved = RELAXATION * left + (1.0 - RELAXATION) * right + multipliers
            latest = self._right(moved, penalty)
            multipliers = moved - latest
            disagreement, change = _norm(left - latest), _norm(latest - right)
            right = latest
            if max(disagreement, change) <= ACCURACY * _norm(right):
                break
            if iteration % ADAPT_EVERY == 0:
                # Keep both of one order: [1]_, section 3.4.1.
                factor = _imbalance(disagreement, change)
                penalty, multipliers = penalty * factor, multipliers / factor
        found: FloatArray = left[self.parts[3 if self.non_negative else 1]]
        return found

    def _left(self, target: FloatArray, penalty: float) -> FloatArray:
        """A q, q, v and w nearest to a target, v at its price."""
        u, p, gradient, w = (target[part] for part in self.parts)
        q = self.fit.solve(self.matrix.T @ u + p)
        groups = gradient.reshape(-1, len(self.prices))
        lengths = np.sqrt(np.einsum("ij,ij->j", groups, groups))
        kept = np.maximum(1.0 - self.prices / (penalty * np.maximum(lengths, 1e-300)), 0.0)
        v = (groups * kept).reshape(-1)
        signed = np.maximum(w, 0.0) if self.non_negative else w
        return np.concatenate([self.matrix @ q, q, v, signed])

    def _right(self, target: FloatArray, penalty: float) -> FloatArray:
        """u, p, Ω p and p nearest to a target, u at the price of a residual beyond ε."""
        fitted, q, v, w = (target[part] for part in self.parts)
        p = self.smooth(q + w + self.analysis.T @ v)
        offset = fitted - self.signal
        distance = _norm(offset)
        inward = min(max(distance - self.bound, 0.0), BEYOND_BOUND / penalty)
        u = fitted - offset * (inward / max(distance, 1e-300))
        return np.concatenate([u, p, self.analysis @ p, p])


class _Regularised:
    """Solves (AᵀA + I) x = b, by the smaller of its two sides."""

    def __init__(self, matrix: SparseMatrix) -> None:
        self.matrix = _quick(matrix)
        rows, columns = matrix.shape
        # A small inverse is multiplied by in one step rather than three.
        self.by_rows = rows < columns and columns > DENSE_COLUMNS
        gram: Any = matrix @ matrix.T if self.by_rows else matrix.T @ matrix
        self.inverse = _inverse(gram + diagonal_matrix(np.ones(gram.shape[0])))

    def solve(self, right: FloatArray) -> FloatArray:
        """x, by Woodbury's identity where there are fewer rows than columns."""
        if not self.by_rows:
            return self.inverse(right)
        inner: FloatArray = self.matrix.T @ self.inverse(self.matrix @ right)
        return right - inner


def _inverse(matrix: SparseMatrix) -> Callable[[FloatArray], FloatArray]:
    """Multiply by the inverse of a positive definite matrix."""
    if matrix.shape[0] <= DENSE_COLUMNS:
        inverse = np.linalg.inv(matrix.toarray())
        return lambda right: np.asarray(inverse @ right)
    factors = splu(sparse.csc_array(matrix))
    return lambda right: np.asarray(factors.solve(right))


def _quick(matrix: SparseMatrix) -> Any:
    """Keep small matrices dense: their products take less time."""
    return matrix.toarray() if max(matrix.shape) <= 2 * DENSE_COLUMNS else matrix


def _compressed(
    matrix: SparseMatrix, signal: FloatArray, bound: float
) -> tuple[SparseMatrix, FloatArray, float]:
    """Turn samples onto the span of the columns, and take the rest from the bound."""
    rows, columns = matrix.shape
    if rows <= columns or columns > DENSE_COLUMNS:
        return matrix, signal, bound
    turned, triangle = np.linalg.qr(matrix.toarray())
    inside = turned.T @ signal
    outside = float(np.linalg.norm(signal - turned @ inside))
    return sparse.csc_array(triangle), inside, float(np.sqrt(max(bound**2 - outside**2, 0.0)))


def _unit_columns(matrix: FloatArray | SparseMatrix) -> tuple[SparseMatrix, FloatArray]:
    columns: Any = sparse.csc_array(matrix)
    norms: FloatArray = np.sqrt(np.asarray(columns.power(2).sum(axis=0)).reshape(-1))
    scales = np.divide(1.0, norms, out=np.zeros_like(norms), where=norms > 0.0)
    return sparse.csc_array(columns @ diagonal_matrix(scales)), norms


def _unit_groups(operator: AnalysisOperator, norms: FloatArray) -> tuple[SparseMatrix, FloatArray]:
    """Ω for coefficients of columns of unit norm, and the price of each group of norm 1."""
    rescaled: Any = sparse.csr_array(operator.matrix @ diagonal_matrix(1.0 / norms))
    squares = np.asarray(rescaled.power(2).sum(axis=1)).reshape(operator.group_size, -1)
    prices: FloatArray = np.sqrt(squares.max(axis=0))
    rows = diagonal_matrix(np.tile(1.0 / prices, operator.group_size))
    return sparse.csc_array(rows @ rescaled), prices


def _norm(values: FloatArray) -> float:
    """Euclidean norm, of arrays so short that what NumPy's own looks at first takes longer."""
    return math.sqrt(values.dot(values))


def _imbalance(disagreement: float, change: float) -> float:
    """Factor by which to change the penalty."""
    if disagreement > ADAPT_RATIO * change:
        return ADAPT_FACTOR
    return 1.0 / ADAPT_FACTOR if change > ADAPT_RATIO * disagreement else 1.0
