"""The solvers beside CoSaMP."""

import numpy as np
import pytest

from usmap_ros.errors import UsmapError
from usmap_ros.reconstruction.cosamp import Halt
from usmap_ros.reconstruction.matrix_operator import MatrixOperator
from usmap_ros.reconstruction.solvers import Problem, basis_pursuit, solve

OTHERS = ["omp", "l1", "tv", "nnls", "integer", "binary"]
NEEDS = {"omp": "sklearn", "l1": "sklearn", "tv": "pylops"}


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
    if solver in NEEDS:
        pytest.importorskip(NEEDS[solver])
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


@pytest.mark.parametrize("solver", OTHERS)
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
    pytest.importorskip("sklearn")
    posed = problem(some(3, 8, 30), noise=0.01, tolerance=tolerance)
    x = basis_pursuit(posed)

    assert np.linalg.norm(posed.signal - posed.operator.matrix @ x) == pytest.approx(tolerance)


def test_basis_pursuit_of_less_than_the_noise_is_zero(problem):
    pytest.importorskip("sklearn")
    assert not np.any(basis_pursuit(problem(some(3), tolerance=100.0)))


def test_whole_numbers_count_objects_in_a_cell(problem):
    x = some(3, 8)
    x[8] = 4.0
    solution = solve(problem(x, noise=0.05), "integer")

    np.testing.assert_array_equal(solution.coefficients[:, 0], [1.0, 4.0])


def test_total_variation_needs_places(problem):
    pytest.importorskip("pylops")
    with pytest.raises(ValueError, match="places"):
        solve(problem(some(3), places=None), "tv")


@pytest.mark.parametrize(("solver", "package"), [("omp", "scikit-learn"), ("tv", "pylops")])
def test_missing_package_is_named(problem, solver, package, monkeypatch):
    def refuse(name, *args, **kwargs):
        raise ImportError(name)

    monkeypatch.setattr("importlib.import_module", refuse)
    with pytest.raises(UsmapError, match=f"needs {package}"):
        solve(problem(some(3)), solver)
