"""Stored sensing matrices, and columns that are alike."""

import numpy as np
import pytest
from scipy import sparse

from usmap_ros.reconstruction.matrix_operator import (
    MatrixOperator,
    identical,
    merged,
    same_direction,
)


@pytest.fixture
def matrix():
    columns = np.random.default_rng(0).normal(size=(20, 3))
    a, b, c = columns.T
    return np.stack([a, b, 2.0 * a, c, b, -a, np.zeros(20)], axis=1)


@pytest.mark.parametrize("make", [np.asarray, sparse.csr_array])
def test_adjoint_columns_and_norms(matrix, make):
    operator = MatrixOperator(make(matrix))

    signal = np.arange(20.0)
    np.testing.assert_allclose(operator.adjoint(signal)[:, 0], matrix.T @ signal)
    np.testing.assert_allclose(operator.columns(np.array([3, 0])), matrix[:, [3, 0]])
    np.testing.assert_allclose(operator.norms, np.linalg.norm(matrix, axis=0))
    assert (operator.sample_count, operator.block_count) == (20, 7)


def test_scores_of_a_column_are_its_norm_times_its_coefficient(matrix):
    operator = MatrixOperator(matrix)
    scores = operator.scores(operator.adjoint(3.0 * matrix[:, 3]))

    assert np.argmax(scores) == 3
    np.testing.assert_allclose(scores[3], 3.0 * operator.norms[3])
    assert scores[6] == 0.0
    strength = operator.echo_scores(np.array([3]), np.array([[3.0]]))
    np.testing.assert_allclose(strength, scores[3])


def test_multiples_are_the_same_direction_but_not_identical(matrix):
    operator, generator = MatrixOperator(matrix), np.random.default_rng(2)

    np.testing.assert_array_equal(same_direction(operator, generator), [0, 1, 0, 2, 1, 3, 4])
    np.testing.assert_array_equal(identical(operator, generator), [0, 1, 2, 3, 1, 4, 5])


@pytest.mark.parametrize("make", [np.asarray, sparse.csc_array])
def test_merged_coefficients_are_those_of_least_norm(matrix, make):
    operator = MatrixOperator(make(matrix))
    reduced, shares = merged(operator, same_direction(operator, np.random.default_rng(3)))
    signal = 5.0 * matrix[:, 0] + 3.0 * matrix[:, 1]
    columns = reduced.columns(np.array([0, 1]))
    found = np.linalg.lstsq(columns, signal, rcond=None)[0]

    least_norm = np.linalg.lstsq(matrix[:, :5], signal, rcond=None)[0]
    np.testing.assert_allclose((shares[:, :2] @ found)[:5], least_norm, atol=1e-12)
    np.testing.assert_allclose(
        np.delete((shares.T @ shares).toarray(), 4, axis=0)[:, :4], np.eye(4), atol=1e-12
    )
