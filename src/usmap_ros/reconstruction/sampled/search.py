"""From a signal to its echoes off the grid in one call of compiled code."""

from typing import NamedTuple

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, IndexArray, Signal
from usmap_ros.numerics.compiled import compiled, compiled_within, inlined
from usmap_ros.reconstruction.sampled.cosamp import cosamp, same, signal_proxy
from usmap_ros.reconstruction.sampled.fit import Fit, strengths
from usmap_ros.reconstruction.sampled.matched_filter import (
    MatchedFilter,
    loudness,
    matched_filter,
    refilter,
    score,
)
from usmap_ros.reconstruction.sampled.matrix import (
    Places,
    SampledMatrix,
    margin,
    moved,
    on_grid,
    range_m,
)
from usmap_ros.reconstruction.sampled.steps import delay_step


class SearchSettings(NamedTuple):
    """How to search."""

    #: Most blocks in the support, k of CoSaMP.
    sparsity: int
    #: Of CoSaMP in one round.
    max_iterations: int
    #: Whether coefficients must be real and not negative.
    non_negative: bool
    #: Amplitude near an echo, relative to it, that may be due to an imperfect pulse.
    model_error: float
    #: Rounds of moving delays off the grid; below 0 where pulses have edges.
    refinements: int
    #: Shares of a grid step: below the one no step is taken any more, below the other none needs
    #: another after it.
    settled: float
    small: float


class SearchResult(NamedTuple):
    """What a search found."""

    #: (k,) integer array: indices of the blocks that were found, ascending.
    support: IndexArray
    #: (k, paths) array: of their paths.
    coefficients: Signal
    #: (samples,) array: what they leave of the signal.
    residual: Signal
    #: (k,) arrays: ranges off the grid, and standard deviations of the delays for noise of 1.
    ranges_m: FloatArray
    unit_stds_s: FloatArray
    #: (k,) array: scores that the echoes have by themselves.
    strengths: FloatArray
    #: (blocks,) arrays: what a score had to exceed, and the scores of the residual.
    thresholds: FloatArray
    scores: FloatArray


@compiled
def search(
    matrix: SampledMatrix, signal: Signal, noise: FloatArray, how: SearchSettings
) -> SearchResult:
    """Search on the grid and move delays off it in turn, until they have settled.

    Parameters
    ----------
    matrix : SampledMatrix
        Φ: template at sub-sample shifts, delays and weights of blocks.
    signal : (samples,) complex array
        The baseband signal y.
    noise : (blocks,) array
        Scores that noise alone may have.
    how : SearchSettings
        How to search.
    """
    # Not written as literals, for which all would be compiled once more; of either sign.
    nothing, rectified = np.empty(0, np.int64), how.non_negative & False
    places = on_grid(matrix)
    matched, thresholds = _begun(matrix, signal, noise, how, rectified)
    limits = (how.sparsity, how.max_iterations, how.non_negative)
    fit = cosamp(matrix, places, matched, thresholds, nothing, limits)
    step_s, stds_s = np.zeros(len(fit.support)), np.zeros(len(fit.support))
    if how.refinements >= 0:
        step_s, stds_s = delay_step(matrix, places, fit)
    for _ in range(how.refinements):
        largest = 0.0
        for step in step_s:
            largest = max(largest, abs(step) / matrix.delay_step_s)
        if largest < how.settled:
            break
        before = fit.support
        places = moved(matrix, places, before, step_s)
        fit = cosamp(matrix, places, matched, thresholds, before, limits)
        if largest < how.small and same(fit.support, before):
            step_s = np.zeros(len(before))
            break
        step_s, stds_s = delay_step(matrix, places, fit)
    # The last step is worth taking, but not worth another fit.
    places = moved(matrix, places, fit.support, step_s)
    scores = _what_is_left(matrix, places, matched, fit, how, rectified)
    beside, ranges_m = margin(matrix), np.empty(len(fit.support))
    for number, block in enumerate(fit.support):
        ranges_m[number] = range_m(matrix, places, block)
    return SearchResult(
        fit.support,
        fit.coefficients,
        fit.residual[beside : beside + matrix.sample_count].copy(),
        ranges_m,
        stds_s,
        strengths(matrix, fit),
        thresholds,
        scores,
    )


@compiled_within
def _begun(
    matrix: SampledMatrix, signal: Signal, noise: FloatArray, how: SearchSettings, rectified: bool
) -> tuple[MatchedFilter, FloatArray]:
    """The matched filter's output for a signal, and what a score has to exceed."""
    matched = matched_filter(matrix, signal, rectified)
    thresholds = noise + how.model_error * _loud(matrix, matched.scores)
    if how.non_negative:
        score(matrix, matched, 0, matched.output.shape[1], how.non_negative)
    return matched, thresholds


@compiled_within
def _what_is_left(
    matrix: SampledMatrix,
    places: Places,
    matched: MatchedFilter,
    fit: Fit,
    how: SearchSettings,
    rectified: bool,
) -> FloatArray:
    """Scores of the residual of a fit."""
    refilter(matrix, matched, fit.residual, rectified)
    if how.non_negative:
        score(matrix, matched, 0, matched.output.shape[1], rectified)
    return signal_proxy(matrix, places, matched, fit, rectified)


@inlined
def _loud(matrix: SampledMatrix, scores: FloatArray) -> FloatArray:
    """Loudest score of any pulse within a pulse of each block."""
    ranges, pulses = len(matrix.delays_s), len(matrix.pulses)
    loudest = np.zeros(len(scores))
    for pulse in range(pulses):
        reach = int(np.ceil(matrix.durations_s[pulse] / matrix.delay_step_s))
        loud = loudness(scores[pulse * ranges : (pulse + 1) * ranges], reach)
        for block in range(len(scores)):
            loudest[block] = max(loudest[block], loud[block % ranges])
    return loudest
