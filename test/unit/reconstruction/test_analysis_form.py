"""Equations (1) to (3): least cost of an analysis operator within a bound."""

import numpy as np
import pytest
from scipy.optimize import linprog

from usmap_ros.reconstruction.analysis_form import (
    AnalysisOperator,
    diagonal_matrix,
    gradient_operator,
    least_analysis_cost,
    walls_operator,
)

SIDE = 10
PLACES = np.stack(np.divmod(np.arange(SIDE**2), SIDE), axis=-1)


def identity_operator(columns):
    """Ω = I: sparse coefficients, the synthesis model with Ψ = I; equations (1) and (2)."""
    return AnalysisOperator(diagonal_matrix(np.ones(columns)))


def random_matrix(rows, columns, seed=0):
    generator = np.random.default_rng(seed)
    return generator.normal(size=(rows, columns)) * generator.uniform(0.1, 1.0, columns)


def sparse_signal(columns, count, seed=0):
    generator = np.random.default_rng(seed)
    x = np.zeros(columns)
    x[generator.choice(columns, count, replace=False)] = generator.uniform(0.5, 1.5, count)
    return x


def programme(matrix, signal, analysis, *, non_negative):
    """Least ‖Ω q‖₁ with A q = y, as a linear programme."""
    rows, columns = analysis.shape
    above = np.hstack([analysis, -np.eye(rows)])
    below = np.hstack([-analysis, -np.eye(rows)])
    sign = (0.0 if non_negative else None, None)
    result = linprog(
        np.concatenate([np.zeros(columns), np.ones(rows)]),
        A_ub=np.vstack([above, below]),
        b_ub=np.zeros(2 * rows),
        A_eq=np.hstack([matrix, np.zeros((len(signal), rows))]),
        b_eq=signal,
        bounds=[sign] * columns + [(0.0, None)] * rows,
    )
    return result.fun


@pytest.mark.parametrize("non_negative", [True, False])
@pytest.mark.parametrize("operator", [identity_operator(100), walls_operator(PLACES)])
def test_without_a_bound_it_is_the_linear_programme(operator, non_negative):
    matrix = random_matrix(40, operator.matrix.shape[1])
    signal = matrix @ sparse_signal(matrix.shape[1], 12)
    found = least_analysis_cost(matrix, signal, 0.0, operator, non_negative=non_negative)

    expected = programme(matrix, signal, operator.matrix.toarray(), non_negative=non_negative)
    assert operator.cost(found) == pytest.approx(expected, rel=5e-3)
    np.testing.assert_allclose(matrix @ found, signal, atol=1e-3 * np.linalg.norm(signal))


@pytest.mark.parametrize("rows", [20, 100])
@pytest.mark.parametrize("non_negative", [True, False])
def test_with_a_bound_the_gap_to_the_dual_is_closed(rows, non_negative):
    matrix = random_matrix(rows, 40)
    noise = 0.1 * np.random.default_rng(2).normal(size=rows)
    signal = matrix @ sparse_signal(40, 5) + noise
    bound = 0.2 * np.linalg.norm(signal)
    operator = identity_operator(40)
    found = least_analysis_cost(matrix, signal, bound, operator, non_negative=non_negative)

    residual = signal - matrix @ found
    assert np.linalg.norm(residual) == pytest.approx(bound, rel=1e-4)
    correlation = matrix.T @ residual
    dual = residual / (correlation if non_negative else np.abs(correlation)).max()
    assert operator.cost(found) == pytest.approx(
        signal @ dual - bound * np.linalg.norm(dual), rel=1e-3
    )


def test_a_bound_that_cannot_be_reached_gives_least_squares():
    matrix = random_matrix(60, 20)
    signal = np.random.default_rng(3).normal(size=60)
    found = least_analysis_cost(matrix, signal, 0.1, identity_operator(20), non_negative=False)

    expected = np.linalg.lstsq(matrix, signal, rcond=None)[0]
    np.testing.assert_allclose(found, expected, atol=5e-3)


def test_a_signal_within_the_bound_needs_nothing():
    matrix = random_matrix(10, 20)

    assert not np.any(
        least_analysis_cost(matrix, np.ones(10), 4.0, identity_operator(20), non_negative=True)
    )


def test_columns_of_zeros_get_nothing():
    matrix = random_matrix(30, 20)
    matrix[:, 7] = 0.0
    x = sparse_signal(20, 3)
    x[7] = 0.0
    found = least_analysis_cost(matrix, matrix @ x, 0.0, identity_operator(20), non_negative=True)

    np.testing.assert_allclose(found, x, atol=1e-4)


def test_gradient_counts_the_lengths_of_the_four_steps_about_a_pixel():
    one = np.zeros(SIDE**2)
    one[37] = 2.0

    # The pixel's own gradient has both differences, those of the two before it one each.
    assert gradient_operator(PLACES).cost(one) == pytest.approx(2.0 * (np.sqrt(2.0) + 2.0))


def test_a_wall_costs_its_ends_whatever_its_length():
    operator = walls_operator(PLACES)
    nothing, image = np.zeros(SIDE**2), np.zeros((SIDE, SIDE))
    image[3, 2:7] = 1.0
    along, across = image.reshape(-1), image.T.reshape(-1)

    assert operator.cost(np.concatenate([along, nothing])) == 2.0
    assert operator.cost(np.concatenate([nothing, along])) == 10.0
    assert operator.cost(np.concatenate([nothing, across])) == 2.0


def test_total_variation_finds_a_block_from_few_samples():
    truth = np.zeros((SIDE, SIDE))
    truth[2:6, 3:6] = 1.0
    truth = truth.reshape(-1)
    matrix = np.random.default_rng(5).normal(size=(30, SIDE**2))
    operator = gradient_operator(PLACES)
    found = least_analysis_cost(matrix, matrix @ truth, 0.0, operator, non_negative=True)

    assert operator.cost(found) <= operator.cost(truth) * (1.0 + 1e-3)
    np.testing.assert_allclose(found, truth, atol=0.1)
