"""Least squares on a support, from the samples that its echoes touch."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from usmap_ros.arrays import FloatArray, IndexArray, Signal
from usmap_ros.compiled import compiled_within, inlined
from usmap_ros.reconstruction.sampled.band import (
    factorise,
    half_solve,
    solve,
    without_negatives,
)
from usmap_ros.reconstruction.sampled.matrix import (
    Columns,
    Places,
    SampledMatrix,
    columns_of,
    looked_up,
    margin,
    range_m,
)

#: Ridge of least squares, and of the information on delays.  Columns that are alike get equal
#: shares by the one, echoes too faint to move at all stay where they are by the other.
RIDGE, DELAY_RIDGE = 1e-10, 1e-6


class Fit(NamedTuple):
    """Echoes of a support that come closest to a signal.

    Attributes
    ----------
    support : (k,) integer array
        Their blocks, ascending.
    columns : Columns
        Of all their paths.
    begins : (columns,) integer array
        First column that each overlaps with.
    factor : (columns, columns) array
        Cholesky factor of the columns' Gram matrix.
    fitted : (columns,) array
        Coefficients in the order of the columns.
    coefficients : (k, paths) array
        The same in the order of the blocks.
    residual : (samples,) array
        What is left of the signal, between margins.
    power : float
        Squared norm of the residual.
    """

    support: IndexArray
    columns: Columns
    begins: IndexArray
    factor: Signal
    fitted: Signal
    coefficients: Signal
    residual: Signal
    power: float


@compiled_within
def least_squares(
    matrix: SampledMatrix, places: Places, support: IndexArray, signal: Signal, non_negative: bool
) -> Fit:
    """Estimate the signal by least squares: b|_T ← Φ_T† u.

    Parameters
    ----------
    matrix : SampledMatrix
        Φ.
    places : Places
        Where its blocks are.
    support : (k,) integer array
        T, ascending.
    signal : (samples,) array
        u, between margins.
    non_negative : bool
        Whether coefficients must be real and not negative.
    """
    columns = columns_of(matrix, places, support)
    begins = _first_neighbours(columns)
    gram = _gram(columns, begins)
    fitted = _correlations(columns, signal)
    factor = factorise(gram, begins, RIDGE)
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
def delay_step(matrix: SampledMatrix, places: Places, fit: Fit) -> tuple[FloatArray, FloatArray]:
    """One Gauss-Newton step on the delays of all echoes together; see `refinement.delay_step`.

    Returns
    -------
    step_s : (k,) array
        What to add to the delay of each block, no more than a step of the grid.
    unit_std_s : (k,) array
        Standard deviation of each delay for noise of 1 in phase with the echoes.
    """
    count = len(fit.support)
    slopes = _slopes(matrix, places, fit)
    explained = _by_block(fit, fit.columns.values, slopes)
    information = _information(fit, slopes, explained)
    gradient = np.zeros(count)
    unexplained = _correlations(fit.columns, fit.residual)
    half_solve(fit.factor, fit.begins, unexplained)
    for number in range(len(fit.fitted)):
        begin, block = fit.columns.first[number], fit.columns.blocks[number]
        for tap in range(slopes.shape[1]):
            product = np.conj(slopes[number, tap]) * fit.residual[begin + tap]
            gradient[block] += product.real
    for block in range(count):
        for row in range(len(unexplained)):
            gradient[block] -= (np.conj(explained[block, row]) * unexplained[row]).real
    return _solved_steps(information, gradient, matrix.delay_step_s)


@inlined
def _solved_steps(
    information: FloatArray, gradient: FloatArray, limit_s: float
) -> tuple[FloatArray, FloatArray]:
    """Steps, and the square roots of the diagonal of the inverse."""
    count = len(gradient)
    stds_s = np.zeros(count)
    if count == 0:
        return gradient, stds_s
    most = 0.0
    for one in range(count):
        most = max(most, information[one, one])
    begins = np.empty(count, np.int64)
    for row in range(count):
        information[row, row] += DELAY_RIDGE * most + 1e-300
        begins[row] = row
        for column in range(row):
            if information[row, column] != 0.0:
                begins[row] = column
                break
    factor = factorise(information, begins, 0.0)
    solve(factor, begins, gradient)
    for one in range(count):
        unit = np.zeros(count)
        unit[one] = 1.0
        half_solve(factor, begins, unit)
        for row in range(one, count):
            stds_s[one] += unit[row] ** 2
    for one in range(count):
        stds_s[one] = np.sqrt(stds_s[one])
        gradient[one] = min(max(gradient[one], -limit_s), limit_s)
    return gradient, stds_s


@inlined
def _information(fit: Fit, slopes: Signal, explained: Signal) -> FloatArray:
    """Re(Fᴴ F), F being what the coefficients cannot explain of the slopes D.

    With Φ_Tᴴ Φ_T = L Lᴴ it is Re(Dᴴ D − Eᴴ E), E = L⁻¹ Φ_Tᴴ D; only what is below the diagonal
    is set, and `explained` becomes E.
    """
    columns, count = fit.columns, len(fit.support)
    information = np.zeros((count, count))
    taps = slopes.shape[1]
    for one in range(len(fit.fitted)):
        for other in range(fit.begins[one], one + 1):
            shift = columns.first[one] - columns.first[other]
            total = 0.0
            for tap in range(taps - shift):
                total += (np.conj(slopes[other, tap + shift]) * slopes[one, tap]).real
            row, column = columns.blocks[one], columns.blocks[other]
            information[max(row, column), min(row, column)] += total
            if row == column and one != other:
                information[row, row] += total
    for block in range(count):
        half_solve(fit.factor, fit.begins, explained[block])
    for one in range(count):
        for other in range(one + 1):
            total = 0.0
            for row in range(explained.shape[1]):
                total += (np.conj(explained[one, row]) * explained[other, row]).real
            information[one, other] -= total
    return information


@inlined
def _slopes(matrix: SampledMatrix, places: Places, fit: Fit) -> Signal:
    """Derivatives of the echoes with respect to the delays of their blocks' direct paths."""
    columns, beside = fit.columns, margin(matrix)
    count, taps = columns.values.shape
    slopes = np.zeros((count, taps), np.complex128)
    for number in range(count):
        rate, legs = 1.0, columns.paths[number] * matrix.floor_legs
        if legs > 0:
            direct_m = range_m(matrix, places, fit.support[columns.blocks[number]])
            slope = direct_m / np.sqrt(direct_m**2 + matrix.floor_detour_m2)
            rate = 0.5 * ((2 - legs) + legs * slope)
        factor = -rate * fit.fitted[number]
        sample = columns.first[number] - beside
        for tap in range(max(0, -sample), min(taps, matrix.sample_count - sample)):
            age_s = columns.ages_s[number] + tap / matrix.sample_rate_hz
            slopes[number, tap] = factor * looked_up(matrix, 1, age_s)
    return slopes


@inlined
def _by_block(fit: Fit, values: Signal, slopes: Signal) -> Signal:
    """Φ_Tᴴ D, transposed: the slopes of a block's paths added up, shape (blocks, columns)."""
    columns, taps = fit.columns, slopes.shape[1]
    products = np.zeros((len(fit.support), len(fit.fitted)), np.complex128)
    for one in range(len(fit.fitted)):
        for other in range(fit.begins[one], one + 1):
            shift = columns.first[one] - columns.first[other]
            earlier = later = 0.0j
            for tap in range(taps - shift):
                earlier += np.conj(values[other, tap + shift]) * slopes[one, tap]
                later += np.conj(values[one, tap]) * slopes[other, tap + shift]
            products[columns.blocks[one], other] += earlier
            if one != other:
                products[columns.blocks[other], one] += later
    return products


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
def _correlations(columns: Columns, signal: Signal) -> Signal:
    """Φ_Tᴴ u."""
    products = np.zeros(len(columns.first), np.complex128)
    for number in range(len(products)):
        begin = columns.first[number]
        for tap in range(columns.values.shape[1]):
            products[number] += np.conj(columns.values[number, tap]) * signal[begin + tap]
    return products
