"""Quarters of cells that may have returned the echoes of a few pings, as each ping has them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.superposition.cells import QUARTERS
from usmap_ros.mapping.superposition.forward_model import bearing_fit
from usmap_ros.mapping.superposition.ping_bins import ECHO, SILENCE, Look
from usmap_ros.mapping.superposition.visible_cells import LEAST_POWER_GAIN, VisibleCells, power_gain
from usmap_ros.numerics.compiled import compiled, compiled_within

#: Silence against a cell outweighs an echo for it when it is so many times as frequent.
SILENCE_COUNTS = 0.4


class Sources(NamedTuple):
    """Quarters of cells that may have returned an echo, and what each look has of them.

    Parameters
    ----------
    row_of : (slots,) int64 array
        Number of each suspected cell in the arrays below; -1 for all others.
    kind : (looks, quarters) uint8 array
        ECHO, SILENCE or UNJUDGED.
    bin : (looks, quarters) int32 array
        Range bin of the echo, or of the middle of the quarter.
    level : (looks, quarters) float32 array
        Power of the echo, or below which one may have gone unreported.
    weight : (looks, quarters) float32 array
        Power that each would return if it scattered with power 1.
    fit : (looks, quarters) float32 array
        How well it fits a measured bearing.
    noise : (looks,) float64 array
        Power of the receiver's noise in a bin.
    """

    row_of: NDArray[np.int64]
    kind: NDArray[np.uint8]
    bin: NDArray[np.int32]
    level: NDArray[np.float32]
    weight: NDArray[np.float32]
    fit: NDArray[np.float32]
    noise: NDArray[np.float64]


@compiled
def tally(
    look: Look, seen: VisibleCells, count: int, median_power: float, sums: NDArray[np.float32]
) -> None:
    """Count for and against every cell of a look whether an echo may have come from there.

    Parameters
    ----------
    look, seen, count
        As in `usmap_ros.mapping.superposition.forward_model.expect`.
    median_power : float
        Power that an object scatters.
    sums : (slots,) float32 array
        Changed: cells that end above 0 are worth suspecting.
    """
    for cell in range(count):
        slot = seen.slot[cell]
        low, high = seen.low[cell, 0], seen.high[cell, 0]
        for quarter in range(1, QUARTERS):
            low = min(low, seen.low[cell, quarter])
            high = max(high, seen.high[cell, quarter])
        b = min(max(math.floor(0.5 * (low + high)), 0), len(look.kind) - 1)
        if nearest_echo(look, low, high) >= 0:
            sums[slot] += 1.0
        elif look.kind[b] == SILENCE and seen.weight[cell] * median_power > look.limit[b]:
            sums[slot] -= SILENCE_COUNTS


@compiled_within
def nearest_echo(look: Look, low: float, high: float) -> int:
    """Range bin of the echo that is nearest to the middle of a stretch; -1 if there is none."""
    best, middle = -1, 0.5 * (low + high)
    for b in range(max(math.floor(low), 0), min(math.floor(high) + 1, len(look.kind))):
        nearer = best < 0 or abs(b + 0.5 - middle) < abs(best + 0.5 - middle)
        if look.kind[b] == ECHO and nearer:
            best = b
    return best


@compiled_within
def returned_from(look: Look, x: float, y: float) -> float:
    """Power returned from a place, relative to the transducer, if it scatters with power 1."""
    squared = x * x + y * y + look.rise_m * look.rise_m
    distance = math.sqrt(squared)
    ahead = look.axis_x * x + look.axis_y * y + look.axis_z * look.rise_m
    gain = max(power_gain(look, ahead / distance), LEAST_POWER_GAIN)
    return gain * math.exp(-look.absorption_per_m * distance) / (squared * squared)


@compiled
def compare(
    look: Look, index: int, seen: VisibleCells, count: int, resolution_m: float, sources: Sources
) -> None:
    """Note what look number `index` heard of the sources among the cells in its cone.

    A quarter's own gain counts: it differs within a cell by more than amplitudes fluctuate.
    """
    sources.noise[index] = look.noise
    for cell in range(count):
        row = sources.row_of[seen.slot[cell]]
        x = (seen.column[cell] + 0.5) * resolution_m - look.x_m
        y = (seen.row[cell] + 0.5) * resolution_m - look.y_m
        in_sight = seen.weight[cell] / returned_from(look, x, y)
        for quarter in range(QUARTERS):
            low, high = seen.low[cell, quarter], seen.high[cell, quarter]
            here = row * QUARTERS + quarter
            b = nearest_echo(look, low, high)
            if b >= 0:
                sources.kind[index, here] = ECHO
                sources.level[index, here] = max(look.power[b], look.noise)
                sources.fit[index, here] = bearing_fit(look, b, seen.bearing[cell])
            else:
                b = min(max(math.floor(0.5 * (low + high)), 0), len(look.kind) - 1)
                sources.kind[index, here] = look.kind[b]
                sources.level[index, here] = look.limit[b]
            sources.bin[index, here] = b
            offset_x = 0.25 * resolution_m if quarter & 1 else -0.25 * resolution_m
            offset_y = 0.25 * resolution_m if quarter & 2 else -0.25 * resolution_m
            returned = returned_from(look, x + offset_x, y + offset_y)
            sources.weight[index, here] = in_sight * returned


def no_sources(slots: NDArray[np.intp], cells: int, looks: int) -> Sources:
    """Room for what so many looks have of some of all cells."""
    row_of = np.full(cells, -1)
    row_of[slots] = np.arange(len(slots))
    shape = (looks, len(slots) * QUARTERS)
    return Sources(
        row_of,
        np.zeros(shape, np.uint8),
        np.zeros(shape, np.int32),
        np.zeros(shape, np.float32),
        np.zeros(shape, np.float32),
        np.ones(shape, np.float32),
        np.zeros(looks),
    )
