"""Steps of delays off the grid: Gauss-Newton on all echoes together, compiled."""

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, IndexArray, Signal
from usmap_ros.numerics.compiled import compiled_within, inlined
from usmap_ros.reconstruction.sampled.band import factorise, half_solve, solve
from usmap_ros.reconstruction.sampled.fit import Fit, correlations
from usmap_ros.reconstruction.sampled.matrix import (
    Places,
    SampledMatrix,
    looked_up,
    margin,
    range_m,
)

#: Ridge of the information on delays: echoes too faint to move at all stay where they are.
DELAY_RIDGE = 1e-6


@compiled_within
def delay_step(matrix: SampledMatrix, places: Places, fit: Fit) -> tuple[FloatArray, FloatArray]:
    """One Gauss-Newton step on the delays of all echoes together.

    The residual is linearised in the delays, D = ∂(Φ x)/∂τ, and the part of D that the
    coefficients can explain is projected out, so that step and variance (the Cramér-Rao bound)
    account for amplitudes and phases being unknown too.

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
    starts, ends = _stretches(fit)
    for block in range(count):
        half_solve(fit.factor, fit.begins, explained[block], ends[block])
    information = _information(fit, slopes, explained, starts, ends)
    gradient = np.zeros(count)
    unexplained = correlations(fit.columns, fit.residual)
    half_solve(fit.factor, fit.begins, unexplained, len(unexplained))
    for number in range(len(fit.fitted)):
        begin, block = fit.columns.first[number], fit.columns.blocks[number]
        for tap in range(slopes.shape[1]):
            product = np.conj(slopes[number, tap]) * fit.residual[begin + tap]
            gradient[block] += product.real
    for block in range(count):
        for row in range(starts[block], ends[block]):
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
        half_solve(factor, begins, unit, count)
        for row in range(one, count):
            stds_s[one] += unit[row] ** 2
    for one in range(count):
        stds_s[one] = np.sqrt(stds_s[one])
        gradient[one] = min(max(gradient[one], -limit_s), limit_s)
    return gradient, stds_s


@inlined
def _information(
    fit: Fit, slopes: Signal, explained: Signal, starts: IndexArray, ends: IndexArray
) -> FloatArray:
    """Re(Fᴴ F), F being what the coefficients cannot explain of the slopes D.

    With Φ_Tᴴ Φ_T = L Lᴴ it is Re(Dᴴ D − Eᴴ E), E = L⁻¹ Φ_Tᴴ D; only what is below the diagonal
    is set.
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
    for one in range(count):
        for other in range(one + 1):
            total = 0.0
            for row in range(max(starts[one], starts[other]), min(ends[one], ends[other])):
                total += (np.conj(explained[one, row]) * explained[other, row]).real
            information[one, other] -= total
    return information


@inlined
def _stretches(fit: Fit) -> tuple[IndexArray, IndexArray]:
    """Columns that the echoes of each block overlap with, directly or by others in between."""
    count, blocks = len(fit.begins), len(fit.support)
    starts, ends = np.empty(blocks, np.int64), np.zeros(blocks, np.int64)
    for block in range(blocks):
        starts[block] = count
    end = count
    for number in range(count - 1, -1, -1):
        block = fit.columns.blocks[number]
        starts[block] = min(starts[block], fit.begins[number])
        ends[block] = max(ends[block], end)
        # Begins ascend: where one overlaps with none before it, none after it does.
        if fit.begins[number] == number:
            end = number
    return starts, ends


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
        pulse = fit.support[columns.blocks[number]] // len(matrix.delays_s)
        table, duration_s = matrix.pulses[pulse, 1], matrix.durations_s[pulse]
        for tap in range(max(0, -sample), min(taps, matrix.sample_count - sample)):
            age_s = columns.ages_s[number] + tap / matrix.sample_rate_hz
            slopes[number, tap] = factor * looked_up(table, duration_s, age_s)
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
