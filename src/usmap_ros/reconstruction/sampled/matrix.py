"""The sensing matrix of one pulse: what its columns are, and how the matched filter meets them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from usmap_ros.arrays import BoolArray, FloatArray, IndexArray, Signal
from usmap_ros.compiled import compiled_within, inlined

#: Points at which a pulse is tabulated, and further ones a cycle of its phase.  Linear between
#: them, a Hann window is known to 1.5e-7 of its peak.
POINTS, POINTS_PER_CYCLE = 4097, 512
#: Of a pulse that is a table itself, points for each of its own.
POINTS_PER_POINT = 16


class SampledMatrix(NamedTuple):
    """The sensing matrix Φ as numbers and arrays, for compiled code.

    Attributes
    ----------
    polyphase : (oversampling, taps) array
        The pulse at every delay between two samples.
    windows, phases : (blocks, paths) integer arrays
        Where each path of a block is on the grid of delays: the sample with which its window
        begins, and the number of the delay between samples.
    path_delays_s : (blocks, paths) array
        Delays of the paths, on the grid.
    ranges_m : (blocks,) array
        Ranges of the blocks, on the grid.
    proxy_weights, echo_weights : (blocks, paths) arrays
        What a block's score has of each path's product with a signal, and of its coefficient.
    values, slopes : (points,) arrays
        The pulse and its derivative (1/s), from its start to its end.
    duration_s : float
        Length of the pulse.
    sample_rate_hz, start_delay_s : float
        When samples are taken.
    sample_count : int
        How many they are.
    delay_step_s : float
        Of the grid.
    band : int
        Blocks to either side of a chosen one in which no other is chosen.
    sound_speed_m_s, floor_detour_m2 : float
        Of the channel: the square of a leg over the floor is longer than that of the straight one
        by the latter.
    """

    polyphase: Signal
    windows: IndexArray
    phases: IndexArray
    path_delays_s: FloatArray
    ranges_m: FloatArray
    proxy_weights: FloatArray
    echo_weights: FloatArray
    values: Signal
    slopes: Signal
    duration_s: float
    sample_rate_hz: float
    start_delay_s: float
    sample_count: int
    delay_step_s: float
    band: int
    sound_speed_m_s: float
    floor_detour_m2: float


class Places(NamedTuple):
    """Where the blocks are, on the grid until they are moved.

    Attributes
    ----------
    ranges_m : (blocks,) array
        Ranges.
    delays_s : (blocks, paths) array
        Delays of all paths.
    moved : (blocks,) bool array
        Which are off the grid.
    """

    ranges_m: FloatArray
    delays_s: FloatArray
    moved: BoolArray


class Columns(NamedTuple):
    """Some columns of Φ in the order of their delays, of each the samples that it touches.

    Attributes
    ----------
    blocks, paths : (columns,) integer arrays
        Which path of which block of the support each is of.
    first : (columns,) integer array
        First sample of each in a signal with a margin.
    values : (columns, taps) array
        What each has there.
    ages_s : (columns,) array
        How long after the start of its pulse the first sample is taken.
    """

    blocks: IndexArray
    paths: IndexArray
    first: IndexArray
    values: Signal
    ages_s: FloatArray


@inlined
def margin(matrix: SampledMatrix) -> int:
    """Samples of silence on either side of a signal, so that no echo reaches beyond them."""
    return int(matrix.polyphase.shape[1])


@inlined
def with_margin(matrix: SampledMatrix, signal: Signal) -> Signal:
    """Signal between its margins."""
    beside = margin(matrix)
    padded = np.zeros(matrix.sample_count + 2 * beside, np.complex128)
    for sample in range(matrix.sample_count):
        padded[beside + sample] = signal[sample]
    return padded


@inlined
def on_grid(matrix: SampledMatrix) -> Places:
    """All blocks where the grid has them."""
    moved = np.zeros(len(matrix.ranges_m), np.bool_)
    return Places(matrix.ranges_m.copy(), matrix.path_delays_s.copy(), moved)


@compiled_within
def move(matrix: SampledMatrix, places: Places, support: IndexArray, steps_s: FloatArray) -> None:
    """Make the direct paths of `support` later by `steps_s`, and the others with them."""
    speed = matrix.sound_speed_m_s
    for number, block in enumerate(support):
        direct_m = places.ranges_m[block] + 0.5 * speed * steps_s[number]
        places.ranges_m[block] = direct_m
        places.delays_s[block, 0] = 2.0 * direct_m / speed
        if places.delays_s.shape[1] > 1:
            via_floor_m = np.sqrt(direct_m**2 + matrix.floor_detour_m2)
            places.delays_s[block, 1] = (direct_m + via_floor_m) / speed
            places.delays_s[block, 2] = 2.0 * via_floor_m / speed
        places.moved[block] = True


@compiled_within
def looked_up(table: Signal, matrix: SampledMatrix, age_s: float) -> Any:
    """Value of `matrix.values` or `matrix.slopes` at a time after the pulse's start."""
    if age_s < 0.0 or age_s > matrix.duration_s:
        return 0.0 * table[0]
    place = age_s * (len(table) - 1) / matrix.duration_s
    before = min(int(place), len(table) - 2)
    share = place - before
    return (1.0 - share) * table[before] + share * table[before + 1]


@compiled_within
def columns_of(matrix: SampledMatrix, places: Places, support: IndexArray) -> Columns:
    """Columns of all paths of the blocks of a support."""
    beside = margin(matrix)
    count, taps = support.size * places.delays_s.shape[1], beside - 1
    delays_s = np.empty(count)
    blocks, paths = np.empty(count, np.int64), np.empty(count, np.int64)
    # Few, and most often in order already: sorted by insertion.
    for column in range(count):
        block, path = column // places.delays_s.shape[1], column % places.delays_s.shape[1]
        delay_s = places.delays_s[support[block], path]
        at = column
        while at > 0 and delays_s[at - 1] > delay_s:
            delays_s[at], blocks[at], paths[at] = delays_s[at - 1], blocks[at - 1], paths[at - 1]
            at -= 1
        delays_s[at], blocks[at], paths[at] = delay_s, block, path
    first, ages_s = np.empty(count, np.int64), np.empty(count)
    values = np.zeros((count, taps), matrix.values.dtype)
    for column in range(count):
        number = int(np.ceil((delays_s[column] - matrix.start_delay_s) * matrix.sample_rate_hz))
        number = max(-taps, min(number, matrix.sample_count))
        ages_s[column] = number / matrix.sample_rate_hz + matrix.start_delay_s - delays_s[column]
        first[column] = number + beside
        for tap in range(max(0, -number), min(taps, matrix.sample_count - number)):
            age_s = (number + tap) / matrix.sample_rate_hz + matrix.start_delay_s - delays_s[column]
            values[column, tap] = looked_up(matrix.values, matrix, age_s)
    return Columns(blocks, paths, first, values, ages_s)


@compiled_within
def matched_filter(
    matrix: SampledMatrix, signal: Signal, filtered: Signal, begin: int, end: int
) -> None:
    """Φᴴ r on the grid, as far as samples from `begin` to before `end` of a signal matter."""
    taps = margin(matrix)
    windows = filtered.shape[1]
    begin, end = max(0, begin - taps), min(windows, end)
    for phase in range(filtered.shape[0]):
        row = filtered[phase, begin:end]
        row[:] = 0.0
        for tap in range(taps):
            factor = np.conj(matrix.polyphase[phase, tap])
            heard = signal[begin + 1 + tap : end + 1 + tap]
            for window in range(len(row)):
                row[window] += factor * heard[window]


@compiled_within
def refilter(matrix: SampledMatrix, before: Signal, after: Signal, filtered: Signal) -> None:
    """Bring a matched filter's output up to date where a signal has changed."""
    end, place, taps = len(after), 0, margin(matrix)
    while place < end:
        if before[place] == after[place]:
            place += 1
            continue
        begin = last = place
        # Changes within a pulse of each other are worth one pass.
        while place < end and place - last <= taps:
            if before[place] != after[place]:
                last = place
            place += 1
        matched_filter(matrix, after, filtered, begin, last + 1)
