"""What every solver is given: y ≈ A q with few entries in q."""

from dataclasses import dataclass

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, IndexArray
from usmap_ros.reconstruction.cosamp import Halt, LeastSquares, Solution
from usmap_ros.reconstruction.matrix_operator import MatrixOperator


@dataclass(frozen=True)
class Problem:
    """What to solve: y ≈ A q with few entries in q.

    Parameters
    ----------
    operator : MatrixOperator
        A, which is Φ because Ψ is the identity.
    signal : (samples,) array
        The samples y, real.
    sparsity : int
        Most columns in the solution; of whole numbers, most cells.
    tolerance : float
        ε, the norm of the noise.
    threshold : float
        Contribution that a column must exceed.
    non_negative : bool
        Whether coefficients must not be negative.
    places : (columns, 2) integer array, optional
        Row and column of the pixel of each column; analysis operators need it.
    cells : (columns,) integer array, optional
        Cells that a column stands for, which bounds whole numbers; one each by default.
    max_iterations : int
        Most iterations of CoSaMP; other solvers do not count theirs.
    """

    operator: MatrixOperator
    signal: FloatArray
    sparsity: int
    tolerance: float = 0.0
    threshold: float = 0.0
    non_negative: bool = True
    places: IndexArray | None = None
    cells: IndexArray | None = None
    max_iterations: int = 20

    def fitted(self, support: IndexArray, iterations: int, halt: Halt) -> Solution:
        """Least-squares fit of the signal on the columns of a support."""
        return LeastSquares(self.operator, self.signal, self.non_negative).on(
            support, iterations, halt
        )

    def solution(self, support: IndexArray, coefficients: FloatArray, halt: Halt) -> Solution:
        """Solution with coefficients as they are."""
        residual = self.signal - self.operator.columns(support) @ coefficients
        return Solution(support, coefficients[:, np.newaxis], residual, 1, halt)
