"""Cells whose columns are alike, which no trace tells apart, and how they share an echo.

Sanchez & Andersson, DSCC 2018-9140, section 3: of two equal columns "it may select either cell
or both", and "there is, in fact, an entire family of equivalent solutions".  A solver is given
one column for each set of cells, and what it finds goes back to the cells by a stated rule:
real coefficients are shared, because "it is advantageous to have a reconstruction that indicates
all possible object locations"; whole numbers choose, so that "a single cell will show up".
"""

from abc import ABC, abstractmethod

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, IndexArray
from usmap_ros.parameters.pipeline import SolverName
from usmap_ros.reconstruction.cosamp import Solution
from usmap_ros.reconstruction.matrix_operator import (
    MatrixOperator,
    identical,
    merged,
    same_direction,
)
from usmap_ros.reconstruction.whole_numbers import MOST_OBJECTS, chosen_cells

#: Of the random projections that find columns alike: fixed, so that results repeat.
_SEED = 20180930


class ColumnSets(ABC):
    """Sets of cells with one column each, for a solver.

    Parameters
    ----------
    dictionary : MatrixOperator
        A column for each cell.
    labels : (cells,) integer array
        The set of each cell.
    operator : MatrixOperator
        A column for each set.
    """

    def __init__(
        self, dictionary: MatrixOperator, labels: IndexArray, operator: MatrixOperator
    ) -> None:
        self.labels, self.operator = labels, operator
        #: First cell of each set, and how many there are.
        _, self.first, self.sizes = np.unique(labels, return_index=True, return_counts=True)
        self.cell_count = dictionary.block_count

    @abstractmethod
    def by_cell(self, solution: Solution) -> FloatArray:
        """Coefficient of every cell, shape (cells,)."""

    @abstractmethod
    def cells_of(self, solution: Solution) -> IndexArray:
        """How many cells each set of a solution's support takes."""


class SharingSets(ColumnSets):
    """Columns that are multiples of each other share a coefficient: see `merged`."""

    def __init__(self, dictionary: MatrixOperator, labels: IndexArray) -> None:
        operator, self.shares = merged(dictionary, labels)
        super().__init__(dictionary, labels, operator)

    def by_cell(self, solution: Solution) -> FloatArray:
        """Shares in proportion to the norms of the columns: of least norm, and equal if they are.

        Of all coefficients with the same signal these are the ones of least norm.
        """
        coefficients: FloatArray = self.shares[:, solution.support] @ solution.coefficients[:, 0]
        return coefficients

    def cells_of(self, solution: Solution) -> IndexArray:
        """All cells of each set."""
        return np.asarray(self.sizes[solution.support])


class ChoosingSets(ColumnSets):
    """Whole numbers of objects go to single cells of a set: see `chosen_cells`.

    Where the reflectivity is known, gain tells columns apart that are multiples of each other;
    only equal ones make a set.
    """

    def __init__(self, dictionary: MatrixOperator, labels: IndexArray, most: int) -> None:
        _, first = np.unique(labels, return_index=True)
        super().__init__(dictionary, labels, MatrixOperator(dictionary.matrix[:, first]))
        self.most = most

    def by_cell(self, solution: Solution) -> FloatArray:
        """Objects in each cell; cells of a set stand by ascending bearing, the rightmost first."""
        counts = np.zeros(len(self.sizes))
        counts[solution.support] = solution.coefficients[:, 0]
        return chosen_cells(self.labels, counts, self.most)

    def cells_of(self, solution: Solution) -> IndexArray:
        """As few as hold the objects."""
        return np.ceil(solution.coefficients[:, 0] / self.most).astype(np.intp)


def alike(dictionary: MatrixOperator) -> IndexArray:
    """Label the cells so that those that no trace tells apart share a label."""
    return same_direction(dictionary, np.random.default_rng(_SEED))


def distinguishable(
    dictionary: MatrixOperator, labels: IndexArray, solver: SolverName
) -> ColumnSets:
    """Sets of the cells of a dictionary as a solver needs them; `labels` are those of `alike`."""
    if solver in ("tv", "walls"):
        # Which of two equal columns is taken depends on what is beside it in the image.
        return SharingSets(dictionary, np.arange(dictionary.block_count))
    if solver in ("integer", "binary"):
        equal = identical(dictionary, np.random.default_rng(_SEED))
        return ChoosingSets(dictionary, equal, 1 if solver == "binary" else MOST_OBJECTS)
    return SharingSets(dictionary, labels)
