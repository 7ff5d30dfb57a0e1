"""CoSaMP on matrices."""

import numpy as np
import pytest

from usmap_ros.reconstruction.cosamp import Halt, cosamp
from usmap_ros.reconstruction.matrix_operator import MatrixOperator


@pytest.fixture
def operator():
    matrix = np.random.default_rng(1).normal(size=(80, 120))
    return MatrixOperator(matrix / np.linalg.norm(matrix, axis=0))


@pytest.fixture
def sparse_vector():
    x = np.zeros(120)
    x[[3, 40, 41, 99]] = 1.0, -2.0, 0.5, 3.0
    return x


def test_recovers_sparse_vector_exactly(operator, sparse_vector):
    solution = cosamp(operator, operator.matrix @ sparse_vector, 4, tolerance=1e-9)

    np.testing.assert_array_equal(solution.support, [3, 40, 41, 99])
    np.testing.assert_allclose(solution.coefficients[:, 0], [1.0, -2.0, 0.5, 3.0], rtol=1e-6)
    assert solution.residual_norm < 1e-6


def test_recovers_complex_coefficients(operator, sparse_vector):
    phases = np.exp(1j * np.arange(120))
    solution = cosamp(operator, operator.matrix @ (sparse_vector * phases), 4, tolerance=1e-9)

    expected = (sparse_vector * phases)[solution.support]
    np.testing.assert_allclose(solution.coefficients[:, 0], expected, rtol=1e-6)


def test_non_negative_fit_of_a_complex_signal_is_real_and_not_negative(operator):
    x = np.zeros(120)
    x[[7, 70]] = 1.0, 2.0
    solution = cosamp(operator, operator.matrix @ x + 0.0j, 6, non_negative=True)

    assert not np.iscomplexobj(solution.coefficients)
    assert np.all(solution.coefficients >= 0.0)
    np.testing.assert_allclose(solution.coefficients.sum(), 3.0, rtol=1e-6)


def test_column_that_would_need_a_negative_coefficient_is_not_taken_up():
    operator = MatrixOperator(np.array([[-2.0, 1.0, -1.0], [0.0, 0.5, 0.0]]))
    solution = cosamp(operator, np.array([1.0, 0.0]), 1, non_negative=True)

    np.testing.assert_array_equal(solution.support, [1])


def test_halts_at_the_noise_level(operator, sparse_vector):
    noise = 1e-3 * np.random.default_rng(2).normal(size=80)
    solution = cosamp(operator, operator.matrix @ sparse_vector + noise, 4, tolerance=0.02)

    assert solution.halt is Halt.NOISE_LEVEL
    assert solution.residual_norm <= 0.02


def test_halts_when_nothing_rises_above_the_threshold(operator):
    signal = 0.1 * operator.matrix[:, 0]
    solution = cosamp(operator, signal, 4, threshold=0.2)

    assert solution.halt is Halt.NOTHING_LEFT
    assert len(solution.support) == 0
    np.testing.assert_array_equal(solution.residual, signal)


def test_halts_when_the_support_is_stable(operator):
    signal = np.random.default_rng(3).normal(size=80)
    solution = cosamp(operator, signal, 2, max_iterations=100)

    assert solution.halt in (Halt.STABLE_SUPPORT, Halt.NO_PROGRESS)
    assert len(solution.support) == 2


def test_halts_at_the_iteration_limit(operator):
    signal = np.random.default_rng(4).normal(size=80)
    solution = cosamp(operator, signal, 20, max_iterations=1)

    assert solution.halt is Halt.ITERATIONS
    assert solution.iterations == 1


def test_signal_of_wrong_length_is_refused(operator):
    with pytest.raises(ValueError, match="shape"):
        cosamp(operator, np.zeros(79), 4)


@pytest.mark.parametrize("non_negative", [False, True])
def test_duplicate_columns_explain_the_signal_together(operator, non_negative):
    doubled = MatrixOperator(np.repeat(operator.matrix, 2, axis=1))
    signal = 2.0 * operator.matrix[:, 10]
    solution = cosamp(doubled, signal, 4, non_negative=non_negative)

    assert set(solution.support[np.abs(solution.coefficients[:, 0]) > 1e-6]) <= {20, 21}
    np.testing.assert_allclose(solution.coefficients.sum(), 2.0, rtol=1e-6)
    assert solution.residual_norm < 1e-6


def test_free_fit_of_duplicate_columns_shares_equally(operator):
    doubled = MatrixOperator(np.repeat(operator.matrix, 2, axis=1))
    solution = cosamp(doubled, 2.0 * operator.matrix[:, 10], 2)

    np.testing.assert_array_equal(solution.support, [20, 21])
    np.testing.assert_allclose(solution.coefficients[:, 0], [1.0, 1.0], rtol=1e-6)


@pytest.mark.parametrize("non_negative", [False, True])
def test_columns_of_zeros_are_never_chosen(operator, non_negative):
    matrix = operator.matrix.copy()
    matrix[:, ::2] = 0.0
    signal = np.random.default_rng(5).normal(size=80)
    solution = cosamp(MatrixOperator(matrix), signal, 30, non_negative=non_negative)

    assert np.all(np.isfinite(solution.coefficients))
    assert np.all(solution.support % 2 == 1)


def test_matrix_of_zeros_explains_nothing():
    solution = cosamp(MatrixOperator(np.zeros((10, 5))), np.ones(10), 3)

    assert solution.halt is Halt.NOTHING_LEFT
    assert len(solution.support) == 0
