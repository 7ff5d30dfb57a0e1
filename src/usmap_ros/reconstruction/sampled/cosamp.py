"""CoSaMP in the delay domain, compiled: the one that runs by default.

Needell & Tropp, "CoSaMP: Iterative signal recovery from incomplete and inaccurate samples",
Appl. Comput. Harmon. Anal. 26 (2009) 301-321; in blocks after Baraniuk, Cevher, Duarte &
Hegde, "Model-based compressive sensing", IEEE Trans. Inf. Theory 56 (2010) 1982-2001; with a
band about each chosen atom excluded after Fannjiang & Liao, "Coherence pattern-guided
compressive sensing with unresolved grids", SIAM J. Imaging Sci. 5 (2012) 179-202.

The steps have the names of `usmap_ros.reconstruction.cosamp`, the paper's on a stored matrix of
cells: proxy, identification, support merger, least squares (`fit.least_squares`), pruning, sample
update.  What differs is how: the matched filter is kept and brought up to date where the residual
has changed, and least squares goes by runs of echoes that overlap.
"""

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, IndexArray, Signal
from usmap_ros.numerics.compiled import compiled_within, inlined
from usmap_ros.reconstruction.sampled.fit import Fit, heard_shares, least_squares, strengths
from usmap_ros.reconstruction.sampled.matched_filter import MatchedFilter, first_at, refilter
from usmap_ros.reconstruction.sampled.matrix import Places, SampledMatrix, columns_of

#: Share of an echo's power that must be heard where it is, if it is not a mere help to others.
HEARD = 0.02
#: Blocks of which the loudest is kept in mind, so that to choose one not all are looked at.
STRETCH = 64


@compiled_within
def cosamp(
    matrix: SampledMatrix,
    places: Places,
    matched: MatchedFilter,
    thresholds: FloatArray,
    warm_start: IndexArray,
    limits: tuple[int, int, bool],
) -> Fit:
    """Approximate a signal by few blocks, from a support on.

    Parameters
    ----------
    matrix : SampledMatrix
        Φ: template at sub-sample shifts, delays and weights of blocks.
    places : Places
        Where its blocks are.
    matched : MatchedFilter
        The signal, and the matched filter's output for what is left of it, which is brought up
        to date.
    thresholds : (blocks,) array
        Score that a block must exceed to be taken up, and to be kept.
    warm_start : (n,) integer array
        Support to start from, ascending.
    limits : (int, int, bool)
        Most blocks, most iterations, and whether coefficients must be real and not negative.

    Returns
    -------
    Fit
        Blocks of the support with coefficients, and the residual.
    """
    signal = matched.signal
    sparsity, max_iterations, non_negative = limits
    best = least_squares(matrix, places, warm_start, signal, non_negative)
    kept = _pruning(matrix, best, signal, thresholds, sparsity)
    if len(kept) < len(warm_start):
        best = least_squares(matrix, places, kept, signal, non_negative)
    for _ in range(max_iterations):
        if best.power <= 0.0:
            break
        refilter(matrix, matched, best.residual, non_negative)
        scores = signal_proxy(matrix, places, matched, best, non_negative)
        identified = _identification(matrix, scores, thresholds, best.support, 2 * sparsity)
        if len(identified) == 0:
            break
        merged = _support_merger(best.support, identified)
        estimate = least_squares(matrix, places, merged, signal, non_negative)
        pruned = _pruning(matrix, estimate, signal, thresholds, sparsity)
        if same(pruned, best.support):
            break
        latest = estimate
        if len(pruned) < len(merged):
            latest = least_squares(matrix, places, pruned, signal, non_negative)
        if latest.power >= best.power * (1.0 - 1e-9) ** 2:
            break
        best = latest
    return best


@compiled_within
def signal_proxy(
    matrix: SampledMatrix, places: Places, matched: MatchedFilter, fit: Fit, non_negative: bool
) -> FloatArray:
    """Form signal proxy y ← Φ* v, and how well each block by itself explains v.

    Blocks that were moved off the grid and left the support are looked at where they are now;
    those of the support explain nothing that is left.
    """
    scores = matched.scores.copy()
    for block in fit.support:
        scores[block] = 0.0
    one = np.empty(1, np.int64)
    for block in places.blocks:
        if scores[block] == 0.0:
            continue
        one[0], scores[block] = block, 0.0
        columns = columns_of(matrix, places, one)
        for number in range(len(columns.first)):
            begin, value = columns.first[number], 0.0j
            for tap in range(columns.values.shape[1]):
                value += np.conj(columns.values[number, tap]) * fit.residual[begin + tap]
            size = max(value.real, 0.0) if non_negative else abs(value)
            scores[block] += matrix.weights[0, block, columns.paths[number]] * size
    return scores


@compiled_within
def _identification(
    matrix: SampledMatrix,
    scores: FloatArray,
    limits: FloatArray,
    support: IndexArray,
    count: int,
) -> IndexArray:
    """Identify large components: Ω ← supp(y_2s), none within the bands of the support."""
    stretches = (len(scores) + STRETCH - 1) // STRETCH
    loudest, free = np.empty(stretches), np.zeros(stretches * STRETCH)
    for block in range(len(scores)):
        free[block] = scores[block] if scores[block] > limits[block] else 0.0
    ranges = len(matrix.delays_s)
    for block in support:
        pulse = block // ranges
        band, first = matrix.bands[pulse], pulse * ranges
        free[max(first, block - band) : min(first + ranges, block + band + 1)] = 0.0
    for stretch in range(stretches):
        loudest[stretch] = _loudest(free, stretch)
    chosen = np.empty(count, np.int64)
    for number in range(count):
        best = 0
        for stretch in range(1, stretches):
            if loudest[stretch] > loudest[best]:
                best = stretch
        if stretches == 0 or loudest[best] == 0.0:
            return chosen[:number]
        block = best * STRETCH
        while free[block] < loudest[best]:
            block += 1
        chosen[number] = block
        _drop_rivals(matrix, free, loudest, block)
    return chosen


@inlined
def _loudest(scores: FloatArray, stretch: int) -> float:
    """Loudest score of a stretch of blocks."""
    loudest = 0.0
    for block in range(stretch * STRETCH, (stretch + 1) * STRETCH):
        loudest = max(loudest, scores[block])
    return loudest


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
def _drop_rivals(matrix: SampledMatrix, free: FloatArray, loudest: FloatArray, chosen: int) -> None:
    """Leave out blocks of which any path falls into the band of any path of the chosen one.

    Where several pulses are in the air, so are those that overlap with it: different pulses
    correlate a little wherever they overlap, and what is left of a score is known only when louder
    echoes about it are accounted for.
    """
    (ranges, paths), pulses = matrix.delays_s.shape, len(matrix.pulses)
    own, number = chosen // ranges, chosen % ranges
    for pulse in range(pulses):
        before_s = after_s = (matrix.bands[own] + 0.5) * matrix.delay_step_s
        if pulses > 1:
            before_s, after_s = matrix.durations_s[pulse], matrix.durations_s[own]
        for near_s in matrix.delays_s[number]:
            for path in range(paths):
                at = first_at(matrix.delays_s[:, path], near_s - before_s)
                first = pulse * ranges + at
                while at < ranges and matrix.delays_s[at, path] < near_s + after_s:
                    free[pulse * ranges + at] = 0.0
                    at += 1
                last = pulse * ranges + at
                for stretch in range(first // STRETCH, (last + STRETCH - 1) // STRETCH):
                    loudest[stretch] = _loudest(free, stretch)


@compiled_within
def _pruning(
    matrix: SampledMatrix, estimate: Fit, signal: Signal, limits: FloatArray, sparsity: int
) -> IndexArray:
    """Prune to obtain next approximation: the support of b_s, less what is below its limit.

    Less, too, what nothing is heard of.
    """
    found, heard = strengths(matrix, estimate), heard_shares(estimate, signal)
    loud = np.zeros(len(found), np.bool_)
    if len(found) <= sparsity:
        loud[:] = True
    for _ in range(sparsity if len(found) > sparsity else 0):
        best = len(found)
        for number in range(len(found)):
            if not loud[number] and (best == len(found) or found[number] > found[best]):
                best = number
        loud[best] = True
    kept, last = np.empty(len(found), np.int64), 0
    for number in range(len(found)):
        block = estimate.support[number]
        if loud[number] and found[number] > limits[block] and heard[number] > HEARD:
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
