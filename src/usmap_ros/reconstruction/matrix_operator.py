"""A sensing matrix that is stored, and what to do about columns that are alike in it."""

from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from usmap_ros.numerics.arrays import FloatArray, IndexArray, Signal

#: scipy's types say of a sparse array neither its format nor its numbers.
SparseMatrix = Any
#: Columns of unit norm that are nearer to each other than this count as the same.
SAME_DIRECTION = 1e-7


class MatrixOperator:
    """A real matrix, dense or sparse, as a linear operator on coefficients (columns, 1).

    Parameters
    ----------
    matrix : (samples, columns) array or scipy sparse array
        Φ.  Sparse ones are kept by columns.
    """

    def __init__(self, matrix: FloatArray | SparseMatrix) -> None:
        self.is_sparse = bool(sparse.issparse(matrix))
        kept: Any = sparse.csc_array(matrix) if self.is_sparse else np.asarray(matrix)
        self.matrix = kept
        squares: Any = self.matrix.power(2) if self.is_sparse else self.matrix**2
        #: Norm of every column.
        self.norms: FloatArray = np.sqrt(np.asarray(squares.sum(axis=0)).reshape(-1))

    @property
    def sample_count(self) -> int:
        """Rows of Φ."""
        return int(self.matrix.shape[0])

    @property
    def block_count(self) -> int:
        """Columns of Φ."""
        return int(self.matrix.shape[1])

    def adjoint(self, signal: Signal) -> Signal:
        """Φᵀ r, which is Φᴴ r because Φ is real."""
        proxy: Signal = (self.matrix.T @ signal)[:, np.newaxis]
        return proxy

    def columns(self, support: IndexArray) -> FloatArray:
        """Columns of the support, always dense: they are few."""
        chosen = self.matrix[:, support]
        columns: FloatArray = chosen.toarray() if self.is_sparse else chosen
        return columns

    def scores(self, proxy: Signal) -> FloatArray:
        """Correlation with each column of unit norm; a column of zeros scores nothing."""
        scores: FloatArray = np.divide(
            np.abs(proxy[:, 0]), self.norms, out=np.zeros(self.block_count), where=self.norms > 0.0
        )
        return scores

    def echo_scores(self, support: IndexArray, coefficients: Signal) -> FloatArray:
        """Norm of what each column contributes."""
        scores: FloatArray = np.abs(coefficients[:, 0]) * self.norms[support]
        return scores


def same_direction(operator: MatrixOperator, generator: np.random.Generator) -> IndexArray:
    """Label columns so that those that are positive multiples of each other share a label.

    Columns of unit norm are compared by three random projections, which tell different ones
    apart with near certainty and cost no more than three adjoints.  Columns of zeros share a
    label of their own.

    Parameters
    ----------
    operator : MatrixOperator
        A stored matrix, with the norms of its columns.
    generator : numpy.random.Generator
        Draws the projections.

    Returns
    -------
    labels : (columns,) integer array
        Numbered by the first column of each set.
    """
    return _close(_projections(operator, generator, np.maximum(operator.norms, 1e-300)))


def identical(operator: MatrixOperator, generator: np.random.Generator) -> IndexArray:
    """Label columns so that those that are equal share a label; see `same_direction`."""
    scale = float(operator.norms.max(initial=0.0)) or 1.0
    return _close(_projections(operator, generator, np.full(operator.block_count, scale)))


def merged(operator: MatrixOperator, labels: IndexArray) -> tuple[MatrixOperator, SparseMatrix]:
    """One column for each set of parallel columns, and how its coefficient is shared out.

    Of all the coefficients of a set that give the same signal, the shares are those of least
    norm: in proportion to the norms of the columns, so that equal columns share equally.

    Parameters
    ----------
    operator : MatrixOperator
        A stored matrix, with the norms of its columns.
    labels : (columns,) integer array
        From `same_direction` or `identical`.

    Returns
    -------
    operator : MatrixOperator
        A column for each label.
    shares : (columns, labels) sparse array
        x = shares @ c; its columns are orthonormal.
    """
    count = int(labels.max(initial=-1)) + 1
    totals = np.sqrt(np.bincount(labels, operator.norms**2, count))
    weights = np.divide(
        operator.norms, totals[labels], out=np.zeros(len(labels)), where=totals[labels] > 0.0
    )
    shape = (operator.block_count, count)
    shares = sparse.csc_array((weights, (np.arange(len(labels)), labels)), shape=shape)
    product = operator.matrix @ shares
    return MatrixOperator(product), shares


def _projections(
    operator: MatrixOperator, generator: np.random.Generator, scales: FloatArray
) -> FloatArray:
    """Random projections of the columns, each divided by its scale, shape (columns, 3)."""
    directions = generator.normal(size=(operator.sample_count, 3))
    projections: FloatArray = operator.matrix.T @ directions
    return projections / scales[:, np.newaxis]


def _close(points: FloatArray) -> IndexArray:
    """Label points that chains of short steps connect, in the order of their first members."""
    pairs = cKDTree(points).query_pairs(SAME_DIRECTION, output_type="ndarray")
    # SciPy 1.11 labels nothing, and says so only on standard error, where indices are longer.
    pairs = pairs.astype(np.int32)
    links = sparse.coo_array(
        (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2
    )
    _, labels = connected_components(links, directed=False)
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    numbered: IndexArray = rank[inverse.reshape(-1)].astype(np.intp)
    return numbered
