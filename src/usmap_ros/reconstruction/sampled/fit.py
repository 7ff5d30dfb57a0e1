"""Least squares on a support, from the samples that its echoes touch."""

from typing import NamedTuple

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, IndexArray, Signal
from usmap_ros.numerics.compiled import compiled_within, inlined
from usmap_ros.reconstruction.sampled.band import factorise, solve, without_negatives
from usmap_ros.reconstruction.sampled.matrix import Columns, Places, SampledMatrix, columns_of


class Fit(NamedTuple):
    """Echoes of a support that come closest to a signal."""

    #: (k,) integer array: their blocks, ascending.
    support: IndexArray
    #: Of all their paths.
    columns: Columns
    #: (columns,) integer array: first column that each overlaps with.
    begins: IndexArray
    #: (columns, columns) array: Cholesky factor of the columns' Gram matrix.
    factor: Signal
    #: (columns,) array: coefficients in the order of the columns.
    fitted: Signal
    #: (k, paths) array: the same in the order of the blocks.
    coefficients: Signal
    #: (samples,) array: what is left of the signal, between margins.
    residual: Signal
    #: Squared norm of the residual.
    power: float


@compiled_within
def least_squares(
    matrix: SampledMatrix, places: Places, support: IndexArray, signal: Signal, non_negative: bool
) -> Fit:
    """Estimate the signal by least squares: b|_T ← Φ_T† u.

    Parameters
    ----------
    matrix : SampledMatrix
        Φ: template at sub-sample shifts, delays and weights of blocks.
    places : Places
        Where its blocks are.
    support : (k,) integer array
        T: indices of the blocks that take part, ascending.
    signal : (samples,) array
        u, between margins.
    non_negative : bool
        Whether coefficients must be real and not negative.
    """
    columns = columns_of(matrix, places, support)
    begins = _first_neighbours(columns)
    gram = _gram(columns, begins)
    fitted = correlations(columns, signal)
    factor = factorise(gram, begins, matrix.ridge)
    if non_negative:
        _make_non_negative(gram, begins, factor, fitted)
    else:
        solve(factor, begins, fitted)
    coefficients = np.zeros((len(support), matrix.delays_s.shape[1]), np.complex128)
    residual = signal.copy()
    for number in range(len(fitted)):
        coefficients[columns.blocks[number], columns.paths[number]] = fitted[number]
        begin = columns.first[number]
        for tap in range(columns.values.shape[1]):
            residual[begin + tap] -= fitted[number] * columns.values[number, tap]
    power = 0.0
    for sample in range(len(residual)):
        power += residual[sample].real ** 2 + residual[sample].imag ** 2
    return Fit(support, columns, begins, factor, fitted, coefficients, residual, power)


@inlined
def _make_non_negative(gram: Signal, begins: IndexArray, factor: Signal, right: Signal) -> None:
    """Put real coefficients that are not negative into the place of the right side."""
    real_gram, real_right = np.empty(gram.shape), np.empty(len(right))
    for row in range(len(right)):
        real_right[row] = right[row].real
        right[row] = real_right[row]
        for column in range(len(right)):
            real_gram[row, column] = gram[row, column].real
    solve(factor, begins, right)
    for row in range(len(right)):
        if right[row].real < 0.0:
            found = without_negatives(real_gram, begins, real_right)
            for place in range(len(right)):
                right[place] = found[place]
            return


@compiled_within
def strengths(matrix: SampledMatrix, fit: Fit) -> FloatArray:
    """Scores that the echoes of a fit have by themselves."""
    found = np.zeros(len(fit.support))
    for number, block in enumerate(fit.support):
        for path in range(fit.coefficients.shape[1]):
            found[number] += matrix.weights[1, block, path] * abs(fit.coefficients[number, path])
    return found


@compiled_within
def heard_shares(fit: Fit, signal: Signal) -> FloatArray:
    """Power that was heard where the pulse of each echo is, relative to that of the echo.

    Both are averaged over the pulse by its own power.  Echoes that overlap may weaken one another,
    but not to nothing: what is heard of one that is there is about 1, and next to nothing where a
    row of echoes that cancel each other makes up for an imperfect pulse.
    """
    columns = fit.columns
    heard, told = np.zeros(len(fit.support)), np.zeros(len(fit.support))
    for number in range(len(columns.first)):
        begin, power = columns.first[number], abs(fit.fitted[number]) ** 2
        for tap in range(columns.values.shape[1]):
            weight = abs(columns.values[number, tap]) ** 2
            heard[columns.blocks[number]] += weight * abs(signal[begin + tap]) ** 2
            told[columns.blocks[number]] += weight * weight * power
    return heard / np.maximum(told, 1e-300)


@inlined
def _first_neighbours(columns: Columns) -> IndexArray:
    """First of the columns before each that it overlaps with, or itself."""
    begins = np.empty(len(columns.first), np.int64)
    for number in range(len(columns.first)):
        earliest = begins[number - 1] if number else 0
        while columns.first[number] - columns.first[earliest] >= columns.values.shape[1]:
            earliest += 1
        begins[number] = earliest
    return begins


@inlined
def _gram(columns: Columns, begins: IndexArray) -> Signal:
    """Products of all columns with one another."""
    count, taps = columns.values.shape
    gram = np.zeros((count, count), columns.values.dtype)
    for one in range(count):
        for other in range(begins[one], one + 1):
            shift = columns.first[one] - columns.first[other]
            total = 0.0 * columns.values[0, 0]
            for tap in range(taps - shift):
                total += columns.values[one, tap] * np.conj(columns.values[other, tap + shift])
            # Row, column: what the one has in the other's direction, and the reverse.
            gram[one, other] = np.conj(total)
            gram[other, one] = total
    return gram


@compiled_within
def correlations(columns: Columns, signal: Signal) -> Signal:
    """Φ_Tᴴ u."""
    products = np.zeros(len(columns.first), np.complex128)
    for number in range(len(products)):
        begin = columns.first[number]
        for tap in range(columns.values.shape[1]):
            products[number] += np.conj(columns.values[number, tap]) * signal[begin + tap]
    return products
