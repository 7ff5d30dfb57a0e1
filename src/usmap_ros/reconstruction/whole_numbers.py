"""Integer and binary coefficients: "encourage the algorithm to only choose one of the cells".

Sanchez & Andersson, DSCC 2018-9140, section 3: coefficients that are whole numbers of equal
objects, or yes and no, cannot be shared among cells whose columns are equal.
"""

import numpy as np
from scipy import sparse
from scipy.optimize import Bounds, LinearConstraint, milp

from usmap_ros.numerics.arrays import FloatArray, IndexArray
from usmap_ros.reconstruction.matrix_operator import SparseMatrix
from usmap_ros.reconstruction.problem import Problem

#: Objects of an integer solution in one cell.
MOST_OBJECTS = 8
#: Columns that are looked at: beyond those of a coarse grid, the ones that correlate most with the
#: signal.  Branches that may be explored.  Numbers, not a time, so that results repeat.
MOST_COLUMNS, MOST_NODES = 120, 200


def integer_programme(problem: Problem, most: int = MOST_OBJECTS) -> FloatArray:
    """Least sum of absolute residuals with whole numbers of equal objects (HiGHS, in SciPy).

    A linear programme takes the l1 norm of the residual in place of the l2 norm.  The samples
    are turned onto the span of the columns first, which leaves no more rows than columns.

    Parameters
    ----------
    problem : Problem
        A, y, the sparsity, and how many cells each column stands for.
    most : int
        Objects in a cell at most: 1 for binary coefficients.

    Returns
    -------
    (columns,) array
        Objects in all the cells of each column together.
    """
    operator = problem.operator
    scores = operator.scores(np.maximum(operator.adjoint(problem.signal), 0.0))
    chosen = np.sort(np.argsort(-scores, kind="stable")[:MOST_COLUMNS])
    columns = len(chosen)
    cells = np.ones(columns) if problem.cells is None else problem.cells[chosen].astype(float)
    turned, matrix = np.linalg.qr(operator.columns(chosen))
    signal = turned.T @ problem.signal
    # HiGHS has absolute tolerances: echoes are scaled to the order of 1.
    scale = 1.0 / max(float(np.median(operator.norms[chosen])), 1e-300)
    unused, slack = np.zeros_like(matrix), np.eye(len(signal))
    # Variables: q, the cells z that it takes, and bounds u on the residuals: −u ≤ y − A q ≤ u.
    result = milp(
        c=np.concatenate([np.zeros(2 * columns), np.ones(len(signal))]),
        integrality=np.concatenate([np.ones(2 * columns), np.zeros(len(signal))]),
        bounds=Bounds(0.0, np.concatenate([most * cells, cells, np.full(len(signal), np.inf)])),
        constraints=[
            LinearConstraint(_rows(scale * matrix, unused, slack), lb=scale * signal),
            LinearConstraint(_rows(scale * matrix, unused, -slack), ub=scale * signal),
            *_few_cells(columns, len(signal), most, problem.sparsity),
        ],
        options={"node_limit": MOST_NODES},
    )
    objects = np.zeros(operator.block_count)
    if result.x is not None:
        objects[chosen] = np.rint(result.x[:columns])
    return objects


def _few_cells(columns: int, rows: int, most: int, sparsity: int) -> list[LinearConstraint]:
    """Q ≤ most · z, and no more than `sparsity` cells z."""
    identity, rest = np.eye(columns), np.zeros((columns, rows))
    counted = np.concatenate([np.zeros(columns), np.ones(columns), np.zeros(rows)])
    return [
        LinearConstraint(_rows(identity, -most * identity, rest), ub=0.0),
        LinearConstraint(counted[np.newaxis], ub=sparsity),
    ]


def _rows(*parts: FloatArray) -> SparseMatrix:
    return sparse.csc_array(np.hstack(parts))


def chosen_cells(labels: IndexArray, counts: FloatArray, most: int) -> FloatArray:
    """Hand the objects of sets of equal columns out to single cells.

    The rule: a set's cells are filled in their order, each with as many objects as it may hold
    before the next gets any.  So one object is in one cell; two objects are both in the first
    cell where it may hold two, and in two cells where coefficients are binary.  No trace of
    this pose tells whether these are the right cells.

    Parameters
    ----------
    labels : (cells,) integer array
        The set of each cell.
    counts : (sets,) array
        Objects in each set, no more than `most` times its cells.
    most : int
        Objects that one cell may hold.

    Returns
    -------
    (cells,) array
        Objects in each cell.
    """
    order = np.argsort(labels, kind="stable")
    starts = np.searchsorted(labels[order], np.arange(len(counts)))
    before = np.empty(len(labels))
    before[order] = np.arange(len(labels)) - starts[labels[order]]
    objects: FloatArray = np.clip(counts[labels] - most * before, 0.0, most)
    return objects
