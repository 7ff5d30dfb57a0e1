"""What every solver is given: y ≈ A q with few entries in q."""

from dataclasses import dataclass

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, IndexArray
from usmap_ros.reconstruction.cosamp import Halt, LeastSquares, Solution
from usmap_ros.reconstruction.matrix_operator import MatrixOperator


@dataclass(frozen=True)
class Problem:
    """What to solve: y ≈ A q with few entries in q."""

    #: A, which is Φ because Ψ is the identity.
    operator: MatrixOperator
    #: (samples,) array: the samples y, real.
    signal: FloatArray
    #: Most columns in the solution; of whole numbers, most cells.
    sparsity: int
    #: ε, the norm of the noise.
    tolerance: float = 0.0
    #: Contribution that a column must exceed.
    threshold: float = 0.0
    #: Whether coefficients must not be negative.
    non_negative: bool = True
    #: (columns, 2) integer array: row and column of the pixel of each column; analysis operators
    #: need it.
    places: IndexArray | None = None
    #: (columns,) integer array: cells that a column stands for, which bounds whole numbers; one
    #: each by default.
    cells: IndexArray | None = None
    #: Most iterations of CoSaMP; other solvers do not count theirs.
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
