"""Equations in positive definite matrices that are zero away from the diagonal.

Echoes in the order of their delays overlap with their neighbours only.  Row i of their Gram matrix
begins with the first column that i overlaps with, and so does row i of its Cholesky factor: runs of
overlapping echoes are solved by themselves, at a cost that grows with their number and not with its
cube.
"""

import numpy as np

from usmap_ros.numerics.arrays import BoolArray, FloatArray, IndexArray, Signal
from usmap_ros.numerics.compiled import compiled_within, inlined


@compiled_within
def factorise(gram: Signal, begins: IndexArray, ridge: float) -> Signal:
    """Cholesky factor L of a matrix plus a ridge, L Lᴴ = M + ridge · diag(M).

    Parameters
    ----------
    gram : (n, n) array
        M; only what lies below the diagonal is read.
    begins : (n,) integer array
        First column of each row that is not zero.
    ridge : float
        Relative to the diagonal.

    Returns
    -------
    (n, n) array
        L, of which only what lies within the rows' columns is set.  Rows that are zero in M get a
        pivot of 0, and `solve` an unknown of 0 for them.
    """
    factor = np.empty_like(gram)
    for row in range(len(gram)):
        begin = begins[row]
        pivot = gram[row, row].real * (1.0 + ridge)
        for column in range(begin, row):
            total = gram[row, column]
            for inner in range(max(begin, begins[column]), column):
                total -= factor[row, inner] * np.conj(factor[column, inner])
            diagonal = factor[column, column].real
            total = total / diagonal if diagonal > 0.0 else 0.0 * total
            factor[row, column] = total
            pivot -= (total * np.conj(total)).real
        # Of columns that are alike nothing but the ridge is left, and rounding.
        least = ridge * gram[row, row].real
        factor[row, row] = np.sqrt(max(pivot, 0.5 * least))
    return factor


@compiled_within
def solve(factor: Signal, begins: IndexArray, right: Signal) -> None:
    """Put the solution of L Lᴴ x = b into the place of b."""
    half_solve(factor, begins, right, len(right))
    for row in range(len(right) - 1, -1, -1):
        diagonal = factor[row, row].real
        value = right[row] / diagonal if diagonal > 0.0 else 0.0 * right[row]
        right[row] = value
        for column in range(begins[row], row):
            right[column] -= np.conj(factor[row, column]) * value


@compiled_within
def half_solve(factor: Signal, begins: IndexArray, right: Signal, end: int) -> None:
    """Put the solution of L x = b, both of which are 0 from `end` on, into the place of b."""
    start = 0
    while start < end and right[start] == 0.0:
        start += 1
    for row in range(start, end):
        total = right[row]
        for column in range(max(begins[row], start), row):
            total -= factor[row, column] * right[column]
        diagonal = factor[row, row].real
        right[row] = total / diagonal if diagonal > 0.0 else 0.0 * total


@compiled_within
def without_negatives(gram: FloatArray, begins: IndexArray, right: FloatArray) -> FloatArray:
    """Least squares with coefficients that are not negative: Lawson & Hanson's active sets.

    Parameters
    ----------
    gram : (n, n) array
        Aᵀ A of the columns A, symmetric.
    begins : (n,) integer array
        First column of each row that is not zero.
    right : (n,) array
        Aᵀ y of the columns A and the signal y.
    """
    count = len(right)
    found, free = np.zeros(count), np.zeros(count, np.bool_)
    gradient = right.copy()
    negligible = 0.0
    for one in range(count):
        negligible = max(negligible, 1e-13 * abs(right[one]))
    for _ in range(3 * count):
        best, steepest = count, negligible
        for one in range(count):
            if not free[one] and gradient[one] > steepest:
                best, steepest = one, gradient[one]
        if best == count:
            break
        free[best] = True
        _step_inside(gram, begins, right, free, found)
        for one in range(count):
            gradient[one] = right[one]
            for other in range(count):
                gradient[one] -= gram[one, other] * found[other]
    return found


@inlined
def _step_inside(
    gram: FloatArray, begins: IndexArray, right: FloatArray, free: BoolArray, found: FloatArray
) -> None:
    """Solve for the free coefficients, and hold those that would become negative at 0."""
    for _ in range(len(right)):
        target = _solved_for(gram, begins, right, free)
        # How far it is to the target before the first coefficient would become negative.
        share, first = 1.0, -1
        for one in range(len(right)):
            if free[one] and target[one] <= 0.0:
                way = found[one] / max(found[one] - target[one], 1e-300)
                if first < 0 or way < share:
                    share, first = way, one
        for one in range(len(right)):
            found[one] += share * (target[one] - found[one])
        if first < 0:
            return
        free[first], found[first] = False, 0.0


@inlined
def _solved_for(
    gram: FloatArray, begins: IndexArray, right: FloatArray, free: BoolArray
) -> FloatArray:
    """Coefficients of those that are free, the others held at 0."""
    count = len(right)
    places, firsts = np.empty(count, np.int64), np.empty(count, np.int64)
    part, target = np.zeros((count, count)), np.zeros(count)
    number = 0
    for place in range(count):
        if free[place]:
            places[number], target[number], firsts[number] = place, right[place], number
            for column in range(number, -1, -1):
                if places[column] >= begins[place]:
                    firsts[number] = column
                    part[number, column] = gram[place, places[column]]
            number += 1
    part, firsts, target = part[:number, :number].copy(), firsts[:number], target[:number]
    solve(factorise(part, firsts, 1e-14), firsts, target)
    found = np.zeros(count)
    for one in range(number):
        found[places[one]] = target[one]
    return found
