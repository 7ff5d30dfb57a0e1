"""What theory promises of CoSaMP, whatever the matrix."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from usmap_ros.reconstruction.cosamp import cosamp
from usmap_ros.reconstruction.matrix_operator import MatrixOperator, merged, same_direction

QUICK = settings(max_examples=60)
seeds = st.integers(0, 2**32 - 1)


def coherence(matrix):
    unit = matrix / np.linalg.norm(matrix, axis=0)
    gram = np.abs(unit.T @ unit)
    np.fill_diagonal(gram, 0.0)
    return gram.max()


@QUICK
@given(seeds, st.booleans(), st.booleans())
def test_exact_recovery_below_the_coherence_bound(seed, non_negative, is_complex):
    """Of an orthogonal basis and a few columns more, k < (1 + 1/μ) / 2 are found exactly.

    The bound of Tropp, "Greed is good", IEEE Trans. Inf. Theory 50 (2004) 2231-2242, theorem B.
    """
    generator = np.random.default_rng(seed)
    samples = 128
    basis, _ = np.linalg.qr(generator.normal(size=(samples, samples)))
    # Spread evenly over the basis, a further column has the least coherence with it: 1 / √n.
    extra = basis @ generator.choice([-1.0, 1.0], size=(samples, 1)) / np.sqrt(samples)
    matrix = np.hstack([basis, extra])
    bound = 0.5 * (1.0 + 1.0 / coherence(matrix))
    sparsity = int(generator.integers(1, int(np.ceil(bound))))
    assert sparsity < bound

    support = np.sort(generator.choice(samples + 1, sparsity, replace=False))
    values = generator.uniform(0.5, 2.0, sparsity)
    if not non_negative:
        values *= generator.choice([-1.0, 1.0], sparsity)
        if is_complex:
            values = values * np.exp(2j * np.pi * generator.uniform(size=sparsity))
    solution = cosamp(
        MatrixOperator(matrix),
        matrix[:, support] @ values,
        sparsity,
        non_negative=non_negative,
        tolerance=1e-9,
        max_iterations=100,
    )

    np.testing.assert_array_equal(solution.support, support)
    np.testing.assert_allclose(solution.coefficients[:, 0], values, rtol=1e-6)


@st.composite
def problems(draw):
    generator = np.random.default_rng(draw(seeds))
    rows, columns = draw(st.integers(1, 40)), draw(st.integers(1, 60))
    matrix = generator.normal(size=(rows, columns))
    # Duplicates, multiples and zeros among the columns.
    for _ in range(draw(st.integers(0, 5))):
        source, target = generator.integers(columns, size=2)
        matrix[:, target] = generator.choice([0.0, 1.0, 2.0]) * matrix[:, source]
    signal = generator.normal(size=rows)
    if draw(st.booleans()):
        signal = signal + 1j * generator.normal(size=rows)
    return MatrixOperator(matrix), signal, draw(st.integers(1, 20)), draw(st.booleans())


@QUICK
@given(problems())
def test_solution_is_sparse_finite_and_no_worse_than_nothing(problem):
    operator, signal, sparsity, non_negative = problem
    solution = cosamp(operator, signal, sparsity, non_negative=non_negative)

    assert len(solution.support) <= sparsity
    assert np.all(np.diff(solution.support) > 0)
    assert np.all(np.isfinite(solution.coefficients))
    assert solution.residual_norm <= np.linalg.norm(signal) * (1.0 + 1e-9)
    explained = operator.columns(solution.support) @ solution.coefficients[:, 0]
    np.testing.assert_allclose(solution.residual, signal - explained, atol=1e-9)


@QUICK
@given(problems())
def test_residual_never_grows_from_iteration_to_iteration(problem):
    operator, signal, sparsity, non_negative = problem
    norms = [
        cosamp(
            operator, signal, sparsity, non_negative=non_negative, max_iterations=count
        ).residual_norm
        for count in (1, 2, 3, 5, 10)
    ]

    assert np.all(np.diff(norms) <= 1e-9 * np.linalg.norm(signal))


@QUICK
@given(problems(), st.floats(1e-3, 1e3))
def test_solution_scales_with_the_signal(problem, factor):
    operator, signal, sparsity, non_negative = problem
    solution = cosamp(operator, signal, sparsity, non_negative=non_negative)
    scaled = cosamp(operator, factor * signal, sparsity, non_negative=non_negative)

    assert abs(scaled.residual_norm / factor - solution.residual_norm) <= 1e-6 * np.linalg.norm(
        signal
    )


@QUICK
@given(problems())
def test_merging_parallel_columns_loses_nothing(problem):
    operator, signal, _, _ = problem
    labels = same_direction(operator, np.random.default_rng(0))
    reduced, shares = merged(operator, labels)
    everything = operator.columns(np.arange(operator.block_count))
    distinct = reduced.columns(np.arange(reduced.block_count))

    x = np.linalg.lstsq(distinct, signal, rcond=1e-10)[0]
    best = everything @ np.linalg.lstsq(everything, signal, rcond=1e-10)[0]
    np.testing.assert_allclose(distinct @ x, best, atol=1e-6)
    np.testing.assert_allclose(everything @ (shares @ x), distinct @ x, atol=1e-9)
