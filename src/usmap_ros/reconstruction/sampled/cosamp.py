"""CoSaMP in the delay domain, compiled: the steps of `usmap_ros.reconstruction.cosamp`.

They have the same names, and find the same: proxy, identification, support merger, least squares
(`fit.least_squares`), pruning, sample update.  What differs is how: the matched filter is kept and
brought up to date where the residual has changed, and least squares goes by runs of echoes that
overlap.
"""

from __future__ import annotations

import numpy as np

from usmap_ros.arrays import BoolArray, FloatArray, IndexArray, Signal
from usmap_ros.compiled import compiled_within, inlined
from usmap_ros.reconstruction.sampled.fit import Fit, least_squares, replace, strengths
from usmap_ros.reconstruction.sampled.matrix import (
    Places,
    SampledMatrix,
    columns_of,
    refilter,
)

#: Why the solver stopped; places in `HALTS` of `usmap_ros.reconstruction.sampled.search`.
NOISE_LEVEL, NOTHING_LEFT, STABLE_SUPPORT, NO_PROGRESS, ITERATIONS = 0, 1, 2, 3, 4


@compiled_within
def cosamp(
    matrix: SampledMatrix,
    places: Places,
    heard: tuple[Signal, Signal, Signal],
    thresholds: FloatArray,
    warm_start: IndexArray,
    limits: tuple[int, int, bool],
) -> tuple[Fit, int, int]:
    """Approximate a signal by few blocks; see `usmap_ros.reconstruction.cosamp.cosamp`.

    Parameters
    ----------
    matrix : SampledMatrix
        Φ.
    places : Places
        Where its blocks are.
    heard : (samples,), (samples,) and (oversampling, windows) arrays
        The signal; what is left of it, and the matched filter's output of that.  These two are
        brought up to date.
    thresholds : (blocks,) array
        Score that a block must exceed to be taken up, and to be kept.
    warm_start : (n,) integer array
        Support to start from, ascending.
    limits : (int, int, bool)
        Most blocks, most iterations, and whether coefficients must be real and not negative.

    Returns
    -------
    fit : Fit
        The echoes.
    iterations, halt : int
        Iterations done, and why no more were.
    """
    signal, unexplained, filtered = heard
    sparsity, max_iterations, non_negative = limits
    best = least_squares(matrix, places, warm_start, signal, non_negative)
    kept = _pruning(matrix, best, thresholds, sparsity)
    if len(kept) < len(warm_start):
        best = least_squares(matrix, places, kept, signal, non_negative)
    done = 0
    for iteration in range(1, max_iterations + 1):
        if best.power <= 0.0:
            return best, done, NOISE_LEVEL
        refilter(matrix, unexplained, best.residual, filtered)
        replace(unexplained, best.residual)
        scores = signal_proxy(matrix, places, filtered, best, non_negative)
        identified = _identification(matrix, scores, thresholds, best.support, 2 * sparsity)
        if len(identified) == 0:
            return best, done, NOTHING_LEFT
        merged = _support_merger(best.support, identified)
        estimate = least_squares(matrix, places, merged, signal, non_negative)
        pruned = _pruning(matrix, estimate, thresholds, sparsity)
        if same(pruned, best.support):
            return best, done, STABLE_SUPPORT
        latest = estimate
        if len(pruned) < len(merged):
            latest = least_squares(matrix, places, pruned, signal, non_negative)
        if latest.power >= best.power * (1.0 - 1e-9) ** 2:
            return best, done, NO_PROGRESS
        best, done = latest, iteration
    return best, done, ITERATIONS


@compiled_within
def signal_proxy(
    matrix: SampledMatrix, places: Places, filtered: Signal, fit: Fit, non_negative: bool
) -> FloatArray:
    """Form signal proxy y ← Φ* v, and how well each block by itself explains v.

    Blocks that were moved off the grid and left the support are looked at where they are now;
    those of the support explain nothing that is left.
    """
    scores = np.zeros(len(places.moved))
    for block in range(len(scores)):
        for path in range(matrix.windows.shape[1]):
            value = filtered[matrix.phases[block, path], matrix.windows[block, path]]
            # What would need a negative coefficient cannot explain anything.
            size = max(value.real, 0.0) if non_negative else np.sqrt(value.real**2 + value.imag**2)
            scores[block] += matrix.proxy_weights[block, path] * size
    for block in fit.support:
        scores[block] = 0.0
    one = np.empty(1, np.int64)
    for block in range(len(scores)):
        if not places.moved[block] or scores[block] == 0.0:
            continue
        one[0], scores[block] = block, 0.0
        columns = columns_of(matrix, places, one)
        for number in range(len(columns.first)):
            begin, value = columns.first[number], 0.0j
            for tap in range(columns.values.shape[1]):
                value += np.conj(columns.values[number, tap]) * fit.residual[begin + tap]
            size = max(value.real, 0.0) if non_negative else abs(value)
            scores[block] += matrix.proxy_weights[block, columns.paths[number]] * size
    return scores


@inlined
def _identification(
    matrix: SampledMatrix,
    scores: FloatArray,
    limits: FloatArray,
    support: IndexArray,
    count: int,
) -> IndexArray:
    """Identify large components: Ω ← supp(y_2s), none within the bands of the support."""
    free = scores > limits
    for block in support:
        free[max(0, block - matrix.band) : block + matrix.band + 1] = False
    candidates, last = np.empty(len(scores), np.int64), 0
    for block in range(len(scores)):
        if free[block]:
            candidates[last] = block
            last += 1
    candidates, chosen = candidates[:last], np.empty(count, np.int64)
    for number in range(count):
        best = len(scores)
        for block in candidates:
            if free[block] and (best == len(scores) or scores[block] > scores[best]):
                best = int(block)
        if best == len(scores):
            return chosen[:number]
        chosen[number] = best
        _drop_rivals(matrix, candidates, free, best)
    return chosen


@inlined
def _support_merger(support: IndexArray, identified: IndexArray) -> IndexArray:
    """Merge supports: T is Ω and supp(a^(k−1)), which share nothing."""
    merged = np.empty(len(support) + len(identified), np.int64)
    for number in range(len(merged)):
        from_support = number < len(support)
        block = support[number] if from_support else identified[number - len(support)]
        at = number
        while at > 0 and merged[at - 1] > block:
            merged[at] = merged[at - 1]
            at -= 1
        merged[at] = block
    return merged


@inlined
def _drop_rivals(
    matrix: SampledMatrix, candidates: IndexArray, free: BoolArray, chosen: int
) -> None:
    """Leave out candidates of which any path falls into the band of any path of the chosen one."""
    band_s = (matrix.band + 0.5) * matrix.delay_step_s
    own_s = matrix.path_delays_s[chosen]
    for block in candidates:
        for delay_s in matrix.path_delays_s[block]:
            for near_s in own_s:
                if abs(delay_s - near_s) < band_s:
                    free[block] = False


@compiled_within
def _pruning(matrix: SampledMatrix, estimate: Fit, limits: FloatArray, sparsity: int) -> IndexArray:
    """Prune to obtain next approximation: the support of b_s, less what is below its limit."""
    found = strengths(matrix, estimate)
    loud = np.zeros(len(found), np.bool_)
    for _ in range(min(sparsity, len(found))):
        best = len(found)
        for number in range(len(found)):
            if not loud[number] and (best == len(found) or found[number] > found[best]):
                best = number
        loud[best] = True
    kept, last = np.empty(len(found), np.int64), 0
    for number in range(len(found)):
        block = estimate.support[number]
        if loud[number] and found[number] > limits[block]:
            kept[last] = block
            last += 1
    return kept[:last]


@compiled_within
def same(one: IndexArray, other: IndexArray) -> bool:
    """Whether two supports are the same."""
    differ = len(one) != len(other)
    for place in range(min(len(one), len(other))):
        differ = differ or one[place] != other[place]
    return not differ
