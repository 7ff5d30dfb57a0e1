"""The matched filter, and what its output says of every block, kept up to date.

What an echo explains changes the residual within a pulse's length of it only: beyond that, neither
filter nor scores are looked at again.
"""

from typing import NamedTuple

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, Signal
from usmap_ros.numerics.compiled import compiled_within, inlined
from usmap_ros.reconstruction.sampled.matrix import SampledMatrix, margin, with_margin


class MatchedFilter(NamedTuple):
    """A signal, its residual, and the matched filter's output for the residual."""

    #: (samples,) arrays: the signal between its margins, and what is left of it.
    signal: Signal
    residual: Signal
    #: (pulses * oversampling, windows) array: the matched filter's output for what is left.
    output: Signal
    #: (pulses * oversampling * windows,) array: its magnitudes, or its positive parts where
    #: coefficients must not be negative.
    magnitudes: FloatArray
    #: (blocks,) array: how well each block, on the grid and by itself, explains what is left.
    scores: FloatArray


@inlined
def matched_filter(matrix: SampledMatrix, signal: Signal, non_negative: bool) -> MatchedFilter:
    """A signal of which nothing is explained yet."""
    padded = with_margin(matrix, signal)
    residual = np.zeros(len(padded), np.complex128)
    rows, windows = matrix.polyphase.shape[0], matrix.sample_count + margin(matrix) - 1
    output = np.zeros((rows, windows), np.complex128)
    magnitudes, scores = np.zeros(rows * windows), np.zeros(len(matrix.places))
    matched = MatchedFilter(padded, residual, output, magnitudes, scores)
    refilter(matrix, matched, padded, non_negative)
    return matched


@compiled_within
def refilter(
    matrix: SampledMatrix, matched: MatchedFilter, residual: Signal, non_negative: bool
) -> None:
    """Bring filter and scores up to date where the residual has changed."""
    end, place, taps = len(residual), 0, margin(matrix)
    while place < end:
        if matched.residual[place] == residual[place]:
            place += 1
            continue
        begin = last = place
        # Changes within a pulse of each other are worth one pass.
        while place < end and place - last <= taps:
            if matched.residual[place] != residual[place]:
                matched.residual[place] = residual[place]
                last = place
            place += 1
        first, stop = max(0, begin - taps), min(matched.output.shape[1], last + 1)
        _filter(matrix, matched, first, stop)
        score(matrix, matched, first, stop, non_negative)


@compiled_within
def _filter(matrix: SampledMatrix, matched: MatchedFilter, begin: int, end: int) -> None:
    """Φᴴ r on the grid, in windows from `begin` to before `end`."""
    taps = margin(matrix)
    for phase in range(matched.output.shape[0]):
        row = matched.output[phase, begin:end]
        row[:] = 0.0
        # Two at a time, for half as many ways to memory and back.
        for tap in range(0, taps - 1, 2):
            factor = np.conj(matrix.polyphase[phase, tap])
            next_factor = np.conj(matrix.polyphase[phase, tap + 1])
            samples = matched.residual[begin + 1 + tap : end + 1 + tap]
            next_samples = matched.residual[begin + 2 + tap : end + 2 + tap]
            for window in range(len(row)):
                row[window] += factor * samples[window] + next_factor * next_samples[window]
        if taps % 2:
            factor = np.conj(matrix.polyphase[phase, taps - 1])
            samples = matched.residual[begin + taps : end + taps]
            for window in range(len(row)):
                row[window] += factor * samples[window]


@compiled_within
def score(
    matrix: SampledMatrix, matched: MatchedFilter, begin: int, end: int, non_negative: bool
) -> None:
    """Bring scores up to date with the filter's output in windows from `begin` to before `end`."""
    rows, windows = matched.output.shape
    for phase in range(rows):
        row, magnitudes = (
            matched.output[phase],
            matched.magnitudes[phase * windows : (phase + 1) * windows],
        )
        if non_negative:
            # What would need a negative coefficient cannot explain anything.
            for window in range(begin, end):
                magnitudes[window] = max(row[window].real, 0.0)
        else:
            for window in range(begin, end):
                magnitudes[window] = np.sqrt(row[window].real ** 2 + row[window].imag ** 2)
    # Half a step before the first delay of a window.
    oversampling, ranges = rows // len(matrix.pulses), len(matrix.delays_s)
    start_s = matrix.grid_start_s + (begin * oversampling - 0.5) * matrix.delay_step_s
    stop_s = matrix.grid_start_s + (end * oversampling - 0.5) * matrix.delay_step_s
    done = ranges
    for path in range(matrix.delays_s.shape[1]):
        delays_s = matrix.delays_s[:, path]
        # Longer paths that take as long are of nearer blocks.
        first, stop = first_at(delays_s, start_s), min(done, first_at(delays_s, stop_s))
        for pulse in range(len(matrix.pulses)):
            for block in range(pulse * ranges + first, pulse * ranges + stop):
                total = 0.0
                for one in range(matrix.delays_s.shape[1]):
                    place = matrix.places[block, one]
                    total += matrix.weights[0, block, one] * matched.magnitudes[place]
                matched.scores[block] = total
        done = first


@compiled_within
def first_at(ascending: FloatArray, number: float) -> int:
    """Place of the first of ascending numbers that is not below another."""
    begin, end = 0, len(ascending)
    while begin < end:
        middle = (begin + end) // 2
        if ascending[middle] < number:
            begin = middle + 1
        else:
            end = middle
    return begin


@compiled_within
def loudness(scores: FloatArray, reach: int) -> FloatArray:
    """Loudest score within `reach` blocks of each."""
    count, width = len(scores), 2 * reach + 1
    if count == 0:
        return scores
    loudest, longer = np.empty(count + 2 * reach), np.empty(count + 2 * reach)
    for place in range(reach):
        loudest[place], loudest[reach + count + place] = scores[0], scores[count - 1]
    for place in range(count):
        loudest[reach + place] = scores[place]
    # Every step doubles the stretch that each entry is the maximum of.
    stretch = 1
    while stretch < width:
        step = min(stretch, width - stretch)
        for place in range(len(loudest) - step):
            longer[place] = max(loudest[place], loudest[place + step])
        loudest, longer = longer, loudest
        stretch += step
    return loudest[:count]
