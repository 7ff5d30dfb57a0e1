"""Compressive sampling matching pursuit on a stored matrix, such as the paper's of cells.

By default echoes are looked for by their delays, on a matrix that is never formed:
`usmap_ros.reconstruction.sampled.cosamp` does that, by steps of the same names.

Needell & Tropp, "CoSaMP: Iterative signal recovery from incomplete and inaccurate samples",
Appl. Comput. Harmon. Anal. 26 (2009) 301-321.

The private functions are the steps that Needell & Tropp list in section 2, by their names: signal
proxy, identification, support merger, estimation by least squares (`LeastSquares`), pruning, sample
update.  It is the greedy algorithm that Sanchez & Andersson (DSCC 2018-9140) use in section 3 to
approximate their equation (2).
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, IndexArray, Signal

if TYPE_CHECKING:
    # Its nearest neighbours take long to import, and searches on delays need none.
    from usmap_ros.reconstruction.matrix_operator import MatrixOperator

#: Weight of the ridge that keeps least squares on coherent columns solvable, relative to
#: the mean squared norm of the columns.  Small enough not to be seen in the coefficients;
#: of identical columns it gives each an equal share.
RIDGE = 1e-10


class Halt(enum.Enum):
    """Why a solver stopped."""

    SILENCE = "the signal is zero"
    NOISE_LEVEL = "the residual is within the noise"
    NOTHING_LEFT = "no further block rises above the threshold"
    STABLE_SUPPORT = "the support no longer changes"
    NO_PROGRESS = "the residual no longer falls"
    ITERATIONS = "the iteration limit was reached"
    MINIMUM = "the minimum of a convex problem was found"


@dataclass(frozen=True)
class Solution:
    """A sparse approximation y ≈ Φ x."""

    #: (k,) array: ascending indices of the non-zero blocks.
    support: IndexArray
    #: (k, block_size) array: coefficient of each column of these blocks.
    coefficients: Signal
    #: (samples,) array: y − Φ x.
    residual: Signal
    #: Iterations until it stopped.
    iterations: int
    #: Why no more were.
    halt: Halt

    @property
    def residual_norm(self) -> float:
        """Euclidean norm of the residual."""
        return float(np.sqrt(np.vdot(self.residual, self.residual).real))

    def halted(self, reason: Halt) -> Solution:
        """Return the same solution with the reason why the solver stopped at it."""
        return replace(self, halt=reason)


def cosamp(
    operator: MatrixOperator,
    signal: Signal,
    sparsity: int,
    *,
    threshold: float = 0.0,
    tolerance: float = 0.0,
    non_negative: bool = False,
    max_iterations: int = 20,
) -> Solution:
    """Approximate `signal` by at most `sparsity` columns of `operator`.

    Parameters
    ----------
    operator : MatrixOperator
        The sensing matrix Φ.
    signal : (samples,) array
        y, real or complex.
    sparsity : int
        k, the largest number of columns in the solution.
    threshold : float
        Score that a column must exceed to be taken up, and to be kept.
    tolerance : float
        Norm of the residual at which it counts as noise.
    non_negative : bool
        Fit with coefficients that are real and not negative.
    max_iterations : int
        Iterations at most.

    Returns
    -------
    Solution
        Never more than `sparsity` columns, whose residual is never larger than the signal.

    Raises
    ------
    ValueError
        If the signal is not finite, or has not as many samples as the operator.
    """
    check_signal(operator.sample_count, signal)
    fit = LeastSquares(operator, signal, non_negative)
    best = fit.on(np.empty(0, dtype=np.intp), 0, Halt.ITERATIONS)
    if not np.any(signal):
        return best.halted(Halt.SILENCE)
    for iteration in range(1, max_iterations + 1):
        if best.residual_norm <= tolerance:
            return best.halted(Halt.NOISE_LEVEL)
        proxy = _signal_proxy(fit, best.residual)
        scores = operator.scores(proxy)
        identified = _identification(scores, best.support, threshold, 2 * sparsity)
        if len(identified) == 0:
            return best.halted(Halt.NOTHING_LEFT)
        merged = _support_merger(best.support, identified)
        estimate = fit.on(merged, iteration, Halt.ITERATIONS)
        pruned = _pruning(operator, estimate, threshold, sparsity)
        if np.array_equal(pruned, best.support):
            return best.halted(Halt.STABLE_SUPPORT)
        latest = _sample_update(fit, estimate, pruned)
        if latest.residual_norm >= best.residual_norm * (1.0 - 1e-9):
            return best.halted(Halt.NO_PROGRESS)
        best = latest
    return best


def _signal_proxy(fit: LeastSquares, residual: Signal) -> Signal:
    """Form signal proxy: y ← Φ* v, of the samples v that are not explained yet."""
    proxy = fit.operator.adjoint(residual)
    # What would need a negative coefficient cannot explain anything.
    return np.maximum(proxy.real, 0.0) if fit.non_negative else proxy


def _identification(
    scores: FloatArray, support: IndexArray, threshold: float, count: int
) -> IndexArray:
    """Identify large components: Ω ← supp(y_2s), as if of norm 1, none of the support."""
    free = scores > threshold
    free[support] = False
    candidates = np.flatnonzero(free)
    strongest: IndexArray = candidates[np.argsort(-scores[candidates], kind="stable")[:count]]
    return strongest


def _support_merger(support: IndexArray, identified: IndexArray) -> IndexArray:
    """Merge supports: T is Ω and supp(a^(k−1)), which share nothing."""
    return np.sort(np.concatenate([support, identified]))


def _pruning(
    operator: MatrixOperator, estimate: Solution, threshold: float, sparsity: int
) -> IndexArray:
    """Prune to obtain next approximation: the support of b_s, less what is below the threshold."""
    strengths = operator.echo_scores(estimate.support, estimate.coefficients)
    order = np.argsort(-strengths, kind="stable")[:sparsity]
    kept = order[strengths[order] > threshold]
    return np.sort(estimate.support[kept])


def _sample_update(fit: LeastSquares, estimate: Solution, pruned: IndexArray) -> Solution:
    """Update current samples: v ← u − Φ a^k, the residual r_err = y − A q of the paper.

    The coefficients of the pruned support are fitted again, a variation that Needell & Tropp
    discuss; so the residual is the least that this support can leave.
    """
    if np.array_equal(pruned, estimate.support):
        return estimate
    return fit.on(pruned, estimate.iterations, estimate.halt)


@dataclass(frozen=True)
class LeastSquares:
    """Signal estimation by least squares: b|_T ← Φ_T† u, of one signal u on any support T."""

    #: Has the columns.
    operator: MatrixOperator
    #: (samples,) array: what they are fitted to.
    signal: Signal
    #: Whether coefficients must be real and not negative.
    non_negative: bool

    def on(self, support: IndexArray, iterations: int, halt: Halt) -> Solution:
        """Fit the columns of `support`; `iterations` and `halt` are put into the solution."""
        columns = self.operator.columns(support)
        coefficients = (
            _solve_non_negative(columns, self.signal)
            if self.non_negative
            else least_squares(columns, self.signal)
        )
        residual = self.signal - columns @ coefficients
        return Solution(support, coefficients[:, np.newaxis], residual, iterations, halt)


def least_squares(columns: Signal, signals: Signal) -> Signal:
    """Coefficients of the columns that come closest to one or several signals.

    Solves the normal equations with a ridge too small to be seen, which gives identical
    columns equal shares.
    """
    if columns.shape[1] == 0:
        return np.zeros((0, *signals.shape[1:]), dtype=signals.dtype)
    # A real array's conjugate is the array itself: nothing is copied where nothing is complex.
    adjoint = columns.conj().T
    gram = adjoint @ columns
    diagonal = np.einsum("ii->i", gram)
    diagonal += RIDGE * (gram.trace() / len(gram))
    solution: Signal = np.linalg.solve(gram, adjoint @ signals)
    return solution


def _solve_non_negative(columns: Signal, signal: Signal) -> FloatArray:
    if columns.shape[1] == 0:
        return np.zeros(0)
    if np.iscomplexobj(signal) or np.iscomplexobj(columns):
        columns = np.concatenate([columns.real, columns.imag])
        signal = np.concatenate([signal.real, signal.imag])
    # Long to import, and not needed for what has a phase.
    from scipy.optimize import nnls

    return nnls(columns, signal)[0]


def check_signal(sample_count: int, signal: Signal) -> None:
    """Raise ValueError unless the signal is finite and has so many samples."""
    if signal.shape != (sample_count,):
        raise ValueError(f"signal has shape {signal.shape}, not ({sample_count},)")
    if not np.isfinite(signal).all():
        raise ValueError("signal is not finite")
