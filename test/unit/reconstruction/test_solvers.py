"""The solvers beside CoSaMP."""

import numpy as np
import pytest

from usmap_ros.reconstruction.cosamp import Halt
from usmap_ros.reconstruction.matrix_operator import MatrixOperator
from usmap_ros.reconstruction.problem import Problem
from usmap_ros.reconstruction.solvers import basis_pursuit, orthogonal_matching_pursuit, solve
from usmap_ros.reconstruction.whole_numbers import chosen_cells

OTHERS = ["omp", "l1", "tv", "walls", "nnls", "integer", "binary"]


@pytest.fixture
def operator():
    matrix = np.random.default_rng(1).normal(size=(60, 36))
    return MatrixOperator(matrix * np.linspace(0.5, 2.0, 36))


@pytest.fixture
def problem(operator):
    def problem(x, noise=0.0, **changes):
        signal = operator.matrix @ x + noise * np.random.default_rng(2).normal(size=60)
        places = np.stack(np.divmod(np.arange(36), 6), axis=-1)
        settings = {"sparsity": 5, "tolerance": noise * np.sqrt(60), "places": places, **changes}
        return Problem(operator, signal, **settings)

    return problem


def some(*places):
    x = np.zeros(36)
    x[list(places)] = 1.0
    return x


@pytest.mark.parametrize("solver", OTHERS)
def test_finds_what_is_there(problem, solver):
    solution = solve(problem(some(3, 8, 30), noise=0.01), solver)
    found = solution.support[solution.coefficients[:, 0] > 0.1]

    np.testing.assert_array_equal(found, [3, 8, 30])
    assert len(solution.support) <= 5
    assert solution.halt is Halt.MINIMUM
    expected = problem(some(3, 8, 30), noise=0.01)
    columns = expected.operator.columns(solution.support)
    np.testing.assert_allclose(
        solution.residual, expected.signal - columns @ solution.coefficients[:, 0], atol=1e-12
    )


@pytest.mark.parametrize("solver", ["cosamp", *OTHERS])
def test_silence(problem, solver):
    solution = solve(problem(np.zeros(36)), solver)

    assert solution.halt is Halt.SILENCE
    assert len(solution.support) == 0


@pytest.mark.parametrize("solver", ["cosamp", *OTHERS])
def test_signal_that_is_not_finite_is_refused(problem, solver):
    bad = problem(some(1))
    bad.signal[0] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        solve(bad, solver)


@pytest.mark.parametrize("tolerance", [0.1, 1.0, 3.0])
def test_basis_pursuit_leaves_just_the_noise(problem, tolerance):
    posed = problem(some(3, 8, 30), noise=0.01, tolerance=tolerance)
    x = basis_pursuit(posed)

    assert np.linalg.norm(posed.signal - posed.operator.matrix @ x) == pytest.approx(
        tolerance, rel=1e-3
    )


def test_basis_pursuit_of_less_than_the_noise_is_zero(problem):
    assert not np.any(basis_pursuit(problem(some(3), tolerance=100.0)))


def test_whole_numbers_count_objects_in_a_cell(problem):
    x = some(3, 8)
    x[8] = 4.0
    solution = solve(problem(x, noise=0.05), "integer")

    np.testing.assert_array_equal(solution.coefficients[:, 0], [1.0, 4.0])


def test_whole_numbers_take_no_more_cells_than_the_sparsity(problem):
    solution = solve(problem(some(3, 8, 20, 21, 30), noise=0.05, sparsity=3), "binary")

    assert len(solution.support) == 3
    assert set(solution.support) <= {3, 8, 20, 21, 30}


def test_columns_that_stand_for_several_cells_hold_as_many_objects(problem):
    x = some(3, 8)
    x[8] = 2.0
    posed = problem(x, cells=np.where(np.arange(36) == 8, 2, 1))
    solution = solve(posed, "binary")

    np.testing.assert_array_equal(solution.coefficients[:, 0], [1.0, 2.0])
    assert solution.residual_norm < 1e-9


@pytest.mark.parametrize("solver", ["tv", "walls"])
def test_an_image_that_the_sparsity_cuts_is_fitted_again(problem, solver):
    x = np.linspace(0.5, 1.5, 36)
    solution = solve(problem(x, sparsity=4), solver)

    assert len(solution.support) == 4
    assert solution.residual_norm < np.linalg.norm(problem(x).signal)


def test_whole_numbers_are_looked_for_among_the_columns_that_correlate_most():
    matrix = np.random.default_rng(3).normal(size=(80, 400))
    posed = Problem(MatrixOperator(matrix), matrix[:, 7] + matrix[:, 300], sparsity=5)

    np.testing.assert_array_equal(solve(posed, "integer").support, [7, 300])


def test_chosen_cells_are_filled_one_after_the_other():
    labels = np.array([0, 1, 0, 2, 1, 1])
    counts = np.array([1.0, 2.0, 0.0])

    np.testing.assert_array_equal(chosen_cells(labels, counts, 8), [1, 2, 0, 0, 0, 0])
    np.testing.assert_array_equal(chosen_cells(labels, counts, 1), [1, 1, 0, 0, 1, 0])


def test_orthogonal_matching_pursuit_stops_within_the_noise(problem):
    posed = problem(some(3, 8, 30), noise=0.01, sparsity=20)

    assert np.count_nonzero(orthogonal_matching_pursuit(posed)) == 3


@pytest.mark.parametrize("solver", ["tv", "walls"])
def test_analysis_operators_need_places(problem, solver):
    with pytest.raises(ValueError, match="places"):
        solve(problem(some(3), places=None), solver)
