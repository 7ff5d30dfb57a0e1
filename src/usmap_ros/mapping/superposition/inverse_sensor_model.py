"""Inverse sensor model: what a ping says of each cell, by its likelihood with and without it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.superposition.cells import Tiles, slot_beside
from usmap_ros.mapping.superposition.forward_model import BLOCK_BINS, COLUMNS, Bins, Contributions
from usmap_ros.mapping.superposition.ping_bins import ECHO, SILENCE, Look
from usmap_ros.mapping.superposition.visible_cells import VisibleCells
from usmap_ros.numerics.compiled import compiled, compiled_within, inlined
from usmap_ros.numerics.elementary import exp32, log32

#: Share of an echo's expected power that must come from a cell to prove the way to it.
PROVING_SHARE = 0.6
#: A look with a log-likelihood ratio beyond this contradicts what speaks for the opposite.
CONTRADICTION = 0.5
#: Bound of what speaks against a cell, relative to that of what speaks for it.
MOST_AGAINST = 0.25
#: In the place of the limit of a bin of which nothing can be said, relative to what is expected:
#: so high that it says nothing.
NO_LIMIT = 1e6
#: A contribution below this share of what is expected in a bin neither explains nor contradicts.
LEAST_SHARE = np.float32(0.05)
#: Range bins of a block before those of its cell, and after them.
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
BLOCK_MARGIN = (np.uint64(BLOCK_BINS) - COLUMNS) // np.uint64(2)


class Evidence(NamedTuple):
    """Sums over looks of what they say; (slots,) arrays.

    Parameters
    ----------
    own : float32 array
        Log-likelihood ratio of each cell by itself.
    block : float32 array
        The same of the cell with its eight neighbours.
    clear : float32 array
        Rays that are known to have passed.
    silent : float32 array
        Times that something would have been heard, and was not.
    relevant : float32 array
        1 for cells of which any look said anything.
    """

    own: NDArray[np.float32]
    block: NDArray[np.float32]
    clear: NDArray[np.float32]
    silent: NDArray[np.float32]
    relevant: NDArray[np.float32]


class Bounds(NamedTuple):
    """How much can be said of a cell.

    Parameters
    ----------
    of_a_bin, of_all : float
        Bounds of a single bin's log-likelihood ratio, and of a cell's sum.
    forgetting : float
        Share of the sums that is forgotten with every look that contradicts them.
    """

    of_a_bin: float
    of_all: float
    forgetting: float


@compiled
def prepare_bins(look: Look, bins: Bins) -> None:
    """Set `inverse`, `level` and `log_likelihood` of the range bins that cells contribute to."""
    for b in range(len(look.kind)):
        if bins.squares[b] == 0.0:
            continue
        expected = bins.expected[b]
        bins.inverse[b], bins.least_rest[b] = 1.0 / expected, look.noise / expected
        bins.is_echo[b], bins.level[b], bins.log_likelihood[b] = 0.0, NO_LIMIT, 0.0
        if look.kind[b] == ECHO:
            bins.is_echo[b], bins.level[b] = 1.0, look.power[b] / expected
        elif look.kind[b] == SILENCE:
            bins.level[b] = look.limit[b] / expected
            bins.log_likelihood[b] = log32(1.0 - exp32(-bins.level[b]))


@inlined
def log_ratio_without(
    bins: Bins, power: NDArray[np.float32], start: np.uint64, end: np.uint64, most: float
) -> float:
    """Log-likelihood ratio of what was heard, with some contributions to one without them.

    What each range bin says is bounded: no single echo may prove more, since it may come from
    something that is not in the model.  Nothing branches here, so that the compiler can work out
    several bins at once.

    Parameters
    ----------
    bins : Bins
        What is expected in each range bin, as `prepare_bins` left it.
    power : (end,) float32 array
        The contributions to expected powers, from bin `start` on.
    start, end : integer
        The first bin, and how many there are.
    most : float
        Magnitude that the sum must not exceed.
    """
    total, bound = _ZERO, np.float32(most)
    for group in range(0, end, COLUMNS):
        for column in range(COLUMNS):
            index = group + column
            b = start + np.uint64(index)
            share = power[index] * bins.inverse[b]
            rest = max(_ONE - share, bins.least_rest[b])
            level, is_echo = bins.level[b] / rest, bins.is_echo[b] > _ZERO
            logarithm = log32(rest if is_echo else _ONE - exp32(-level))
            of_echo = level * (_ONE - rest) + logarithm
            ratio = of_echo if is_echo else bins.log_likelihood[b] - logarithm
            ratio = min(max(ratio, -bound), bound)
            total += ratio if share > LEAST_SHARE else _ZERO
    return float(total)


@compiled
def add_evidence(
    look: Look,
    seen: VisibleCells,
    count: int,
    bins: Bins,
    parts: Contributions,
    tiles: Tiles,
    bounds: Bounds,
    evidence: Evidence,
) -> None:
    """Add what a look says of every cell by itself, and with its eight neighbours.

    The sums are bounded either way: however often a thing was seen, what is heard now, or not
    heard, decides after a few looks whether it is still there.

    Parameters
    ----------
    look, seen, count, bins
        As in `usmap_ros.mapping.superposition.forward_model.expect`.
    parts : Contributions
        Of its cells.
    tiles : Tiles
        Where the grid's cells are in memory.
    bounds : Bounds
        Of what can be said.
    evidence : Evidence
        `own` and `block` are added to, `relevant` is set to 1 for cells of which anything is said.
    """
    most, of_cell = bounds.of_a_bin, parts.parts
    for cell in range(count):
        slot, start = seen.slot[cell], seen.first_bin[cell]
        greatest = _ZERO
        for column in range(seen.reach[cell]):
            b = start + np.uint64(column)
            greatest = max(greatest, of_cell[cell, column] * bins.inverse[b])
        if greatest <= LEAST_SHARE:
            continue
        evidence.relevant[slot] = 1.0
        gain = log_ratio_without(bins, of_cell[cell], start, seen.reach[cell], most)
        add_gain(evidence.own, slot, gain, bounds)
        start -= min(start, BLOCK_MARGIN)
        end = _sum_block(seen, parts, tiles, cell, start)
        gain = log_ratio_without(bins, parts.block, start, end, most)
        add_gain(evidence.block, slot, gain, bounds)


@inlined
def _sum_block(
    seen: VisibleCells, parts: Contributions, tiles: Tiles, cell: int, start: np.uint64
) -> np.uint64:
    """Contributions of a cell and its neighbours, from bin `start` on; returns how many bins."""
    block, last = parts.block, np.uint64(0)
    own, row, column = seen.slot[cell], seen.row[cell], seen.column[cell]
    for index in range(BLOCK_BINS):
        block[index] = 0.0
    for up in range(-1, 2):
        for right in range(-1, 2):
            slot = slot_beside(own, row, column, up, right, tiles)
            neighbour = seen.place[slot] if slot >= 0 else -1
            if neighbour >= 0:
                offset = seen.first_bin[neighbour] - start
                # Without a sign: before the start would be far beyond the end.
                if offset <= 2 * BLOCK_MARGIN:
                    reach = seen.reach[neighbour]
                    last = max(last, offset + reach)
                    for index in range(reach):
                        block[offset + np.uint64(index)] += parts.parts[neighbour, index]
    return last


@compiled_within
def add_gain(evidence: NDArray[np.float32], slot: int, gain: float, bounds: Bounds) -> None:
    """Add what a look says to the evidence of a cell, and forget of what it contradicts."""
    total = evidence[slot]
    if abs(gain) > CONTRADICTION and total * gain < 0.0:
        total *= 1.0 - bounds.forgetting
    least, most = -MOST_AGAINST * bounds.of_all, bounds.of_all
    evidence[slot] = min(max(total + gain, least), most)


@compiled_within
def prove_rays(
    look: Look,
    seen: VisibleCells,
    count: int,
    bins: Bins,
    parts: Contributions,
    belief: NDArray[np.float32],
    tiles: Tiles,
    proven_m: NDArray[np.float32],
) -> None:
    """How far along each ray sound is known to have gone: to what it came back from.

    Parameters
    ----------
    look, seen, count, bins, parts
        As above.
    belief : (slots,) float32 array
        Log-odds of each cell.
    tiles : Tiles
        Where the grid's cells are in memory.
    proven_m : (rays,) float32 array
        Set to the range up to which each ray is known to be free.
    """
    for ray in range(len(proven_m)):
        proven_m[ray] = 0.0
    for cell in range(count):
        if belief[seen.slot[cell]] < 0.0:
            continue
        start = seen.first_bin[cell]
        for column in range(seen.reach[cell]):
            b = start + np.uint64(column)
            is_most = parts.parts[cell, column] > PROVING_SHARE * bins.expected[b]
            if is_most and look.kind[b] == ECHO:
                reach_m = look.least_range_m + (b + 0.5) * look.bin_m
                _widen(look, reach_m, seen.ray[cell], tiles.resolution_m, proven_m)


@compiled_within
def _widen(look: Look, reach_m: float, ray: int, res: float, proven_m: NDArray[np.float32]) -> None:
    """Prove the rays that a cell at some range covers."""
    width = 2.0 * look.half_angle_rad / len(proven_m)
    half = int(0.5 * res / (reach_m * width))
    for other in range(max(0, ray - half), min(len(proven_m), ray + half + 1)):
        proven_m[other] = max(proven_m[other], reach_m)
