"""The sensing matrix of delays: what its columns are, and how the matched filter meets them."""

from typing import Any, NamedTuple

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, IndexArray, Signal
from usmap_ros.numerics.compiled import compiled_within, inlined

#: Points at which a pulse is tabulated, and further ones a cycle of its phase.  Linear between
#: them, a Hann window is known to 1.5e-7 of its peak.
POINTS, POINTS_PER_CYCLE = 4097, 512
#: Of a pulse that is a table itself, points for each of its own.
POINTS_PER_POINT = 16


class SampledMatrix(NamedTuple):
    """The sensing matrix Φ as numbers and few arrays, for compiled code.

    It has a block for every pulse in the air and every range, those of the first pulse before
    those of the second: block b is of pulse b // ranges at range number b % ranges.
    """

    #: (pulses * oversampling, taps) array: every pulse at every delay between two samples.
    polyphase: Signal
    #: (ranges, paths) array: where each path of an object at a range is on the grid of delays.
    delays_s: FloatArray
    #: (blocks, paths) integer array: where that is in the matched filter's output, which has all
    #: windows of one delay between samples together.
    places: IndexArray
    #: (2, blocks, paths) array: what a block's score has of each path's product with a signal, and
    #: of its coefficient.
    weights: FloatArray
    #: (pulses, 2, points) array: each pulse and its derivative (1/s), from its start to its end.
    pulses: Signal
    #: (pulses,) array: their lengths.
    durations_s: FloatArray
    #: When samples are taken.
    sample_rate_hz: float
    start_delay_s: float
    #: How many they are.
    sample_count: int
    #: First delay of the grid, and from one to the next.
    grid_start_s: float
    delay_step_s: float
    #: (pulses,) integer array: blocks to either side of a chosen one in which no other of its pulse
    #: is chosen.
    bands: IndexArray
    #: Of the channel: the square of a leg over the floor is longer than that of the straight one by
    #: the latter.
    sound_speed_m_s: float
    floor_detour_m2: float
    #: How many more legs over the floor each path has than the one before it.
    floor_legs: int
    #: Of least squares, relative to columns' squared norms: what is alike gets equal shares.
    ridge: float


class Places(NamedTuple):
    """Where the blocks are that are not on the grid any more."""

    #: (n,) integer array: which they are, ascending.
    blocks: IndexArray
    #: (all blocks,) array: their ranges; 0 of blocks on the grid.
    ranges_m: FloatArray


class Columns(NamedTuple):
    """Some columns of Φ in the order of their delays, of each the samples that it touches."""

    #: (columns,) integer arrays: which path of which block of the support each is of.
    blocks: IndexArray
    paths: IndexArray
    #: (columns,) integer array: first sample of each in a signal with a margin.
    first: IndexArray
    #: (columns, taps) array: what each has there.
    values: Signal
    #: (columns,) array: how long after the start of its pulse the first sample is taken.
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
    return Places(np.empty(0, np.int64), np.zeros(len(matrix.places)))


@inlined
def range_m(matrix: SampledMatrix, places: Places, block: int) -> float:
    """Range of a block."""
    if places.ranges_m[block] > 0.0:
        return float(places.ranges_m[block])
    direct_s = matrix.delays_s[block % len(matrix.delays_s), 0]
    return float(0.5 * matrix.sound_speed_m_s * direct_s)


@inlined
def delay_s(matrix: SampledMatrix, places: Places, block: int, path: int) -> float:
    """Delay of a path of a block: on the grid rounded to it, off the grid exact."""
    direct_m = places.ranges_m[block]
    if direct_m == 0.0:
        return float(matrix.delays_s[block % len(matrix.delays_s), path])
    legs = path * matrix.floor_legs
    if legs == 0:
        return float(2.0 * direct_m / matrix.sound_speed_m_s)
    via_floor_m = np.sqrt(direct_m**2 + matrix.floor_detour_m2)
    return float(((2 - legs) * direct_m + legs * via_floor_m) / matrix.sound_speed_m_s)


@compiled_within
def moved(
    matrix: SampledMatrix, places: Places, support: IndexArray, steps_s: FloatArray
) -> Places:
    """Make the direct paths of `support`, ascending, later by `steps_s`, the others with them."""
    for number, block in enumerate(support):
        step_m = 0.5 * matrix.sound_speed_m_s * steps_s[number]
        places.ranges_m[block] = range_m(matrix, places, block) + step_m
    both = np.empty(len(places.blocks) + len(support), np.int64)
    one = other = last = 0
    while one < len(places.blocks) or other < len(support):
        is_new = one == len(places.blocks) or (
            other < len(support) and support[other] < places.blocks[one]
        )
        block = support[other] if is_new else places.blocks[one]
        one += one < len(places.blocks) and places.blocks[one] == block
        other += other < len(support) and support[other] == block
        both[last] = block
        last += 1
    return Places(both[:last], places.ranges_m)


@compiled_within
def looked_up(table: Signal, duration_s: float, age_s: float) -> Any:
    """Value of the pulse, or of its derivative, at a time after its start."""
    if age_s < 0.0 or age_s > duration_s:
        return 0.0 * table[0]
    place = age_s * (len(table) - 1) / duration_s
    before = min(int(place), len(table) - 2)
    share = place - before
    return (1.0 - share) * table[before] + share * table[before + 1]


@compiled_within
def columns_of(matrix: SampledMatrix, places: Places, support: IndexArray) -> Columns:
    """Columns of all paths of the blocks of a support."""
    beside, paths = margin(matrix), matrix.delays_s.shape[1]
    count, taps = support.size * paths, beside - 1
    delays_s = np.empty(count)
    of_block, of_path = np.empty(count, np.int64), np.empty(count, np.int64)
    # Few, and most often in order already: sorted by insertion.
    for column in range(count):
        block, path = column // paths, column % paths
        later_s = delay_s(matrix, places, support[block], path)
        at = column
        while at > 0 and delays_s[at - 1] > later_s:
            delays_s[at], of_block[at], of_path[at] = (
                delays_s[at - 1],
                of_block[at - 1],
                of_path[at - 1],
            )
            at -= 1
        delays_s[at], of_block[at], of_path[at] = later_s, block, path
    first, ages_s = np.empty(count, np.int64), np.empty(count)
    values = np.zeros((count, taps), matrix.pulses.dtype)
    for column in range(count):
        pulse = support[of_block[column]] // len(matrix.delays_s)
        number = int(np.ceil((delays_s[column] - matrix.start_delay_s) * matrix.sample_rate_hz))
        number = max(-taps, min(number, matrix.sample_count))
        ages_s[column] = number / matrix.sample_rate_hz + matrix.start_delay_s - delays_s[column]
        first[column] = number + beside
        for tap in range(max(0, -number), min(taps, matrix.sample_count - number)):
            age_s = (number + tap) / matrix.sample_rate_hz + matrix.start_delay_s - delays_s[column]
            values[column, tap] = looked_up(
                matrix.pulses[pulse, 0], matrix.durations_s[pulse], age_s
            )
    return Columns(of_block, of_path, first, values, ages_s)
