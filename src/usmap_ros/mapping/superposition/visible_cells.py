"""Visible cells: those of the map that may hold something, as one ping sees them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.grid import TILE_SIDE
from usmap_ros.mapping.superposition.cells import CELL_BINS, QUARTERS, Tiles, slot_at
from usmap_ros.mapping.superposition.ping_bins import GAIN_STEPS, Look
from usmap_ros.numerics.compiled import compiled, inlined
from usmap_ros.numerics.elementary import atan2_32, exp32

#: Gain, in power, below which a cell at the rim of the beam is left out.
LEAST_POWER_GAIN = 4e-4
#: Range bins to either side over which a quarter is blurred at the most.
MOST_BLUR_BINS = 6.0


class Rays(NamedTuple):
    """Rays of a look, sampled cell by cell.

    Parameters
    ----------
    in_sight : (steps, rays) float32 array
        Share of the sound that reaches each step unblocked.
    proven_m : (rays,) float32 array
        How far along each ray sound is known to have gone, because it came back.
    loudness : (steps,) float32 array
        Power that an object would return from each step, with a gain of 1, over what would have
        been reported; 0 where that is not known.
    step_m : float
        Length of a step.
    """

    in_sight: NDArray[np.float32]
    proven_m: NDArray[np.float32]
    loudness: NDArray[np.float32]
    step_m: float


class VisibleCells(NamedTuple):
    """Cells of a look that may hold something, and their quarters.

    Parameters
    ----------
    slot : (cells,) integer array
        Of each cell.
    row, column : (cells,) integer arrays
        Where it lies on the grid.
    ray : (cells,) integer array
        The ray of the look that it lies on.
    x_m, y_m : (cells,) float32 arrays
        Where it lies as seen from the transducer.
    range_m : (cells,) float32 array
        How far that is.
    bearing : (cells,) float32 array
        Off the look's heading.
    low, high : (cells, QUARTERS) float32 arrays
        Range bins, with fractions, between which each quarter's power lies; see `place_cells`.
    density : (cells,) float32 array
        Share of a quarter's power in each bin that lies between.
    first_bin : (cells,) uint64 array
        Range bin in which the first of the quarters begins; 0 if that is before all.
    reach : (cells,) uint64 array
        How many bins, from that one on, a quarter reaches into; at most `CELL_BINS`.
    heard : (cells, QUARTERS) uint8 array
        1 if there is an echo between, else 0: only bins count then that are not silent.
    weight : (cells,) float32 array
        Power that each quarter would return if it scattered with power 1.
    place : (slots,) int32 array
        Row of each slot in the arrays above; -1 for all others.
    """

    slot: NDArray[np.int64]
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    ray: NDArray[np.int64]
    x_m: NDArray[np.float32]
    y_m: NDArray[np.float32]
    range_m: NDArray[np.float32]
    bearing: NDArray[np.float32]
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    density: NDArray[np.float32]
    first_bin: NDArray[np.uint64]
    reach: NDArray[np.uint64]
    heard: NDArray[np.uint8]
    weight: NDArray[np.float32]
    place: NDArray[np.int32]


@inlined
def power_gain(look: Look, cosine: float) -> float:
    """Two-way power gain at an angle off the beam axis, given by its cosine."""
    place = (1.0 - cosine) / (1.0 - look.cos_half_angle) * GAIN_STEPS
    entry = min(max(int(place), 0), GAIN_STEPS - 1)
    before, after = look.power_gain[entry], look.power_gain[entry + 1]
    return float(before + (after - before) * (place - entry))


@inlined
def bearing_of(look: Look, x: float, y: float) -> float:
    """Direction off a look's heading, within half a turn, of a place seen from its transducer."""
    cosine, sine = math.cos(look.heading_rad), math.sin(look.heading_rad)
    return float(atan2_32(cosine * y - sine * x, cosine * x + sine * y))


@inlined
def columns_in_cone(look: Look, y: float, res: float) -> tuple[int, int]:
    """First column, and the one after the last, that a cone may reach at `y` from its apex."""
    half = math.sqrt(max(look.greatest_range_m**2 - y * y, 0.0))
    low, high = -half, half
    if look.axis_z == 0.0 and look.cos_half_angle > 0.0:
        for edge in (-1.0, 1.0):
            # Inside are those that lie between the beam's two edges.
            angle = look.heading_rad + edge * look.half_angle_rad
            sine, cosine = edge * math.sin(angle), edge * math.cos(angle)
            if sine > 1e-6:
                low = max(low, cosine * y / sine)
            elif sine < -1e-6:
                high = min(high, cosine * y / sine)
    return math.floor((look.x_m + low) / res - 0.5), math.ceil((look.x_m + high) / res + 0.5)


@compiled
def find_cells(look: Look, tiles: Tiles, among: NDArray[np.float32], seen: VisibleCells) -> int:
    """List the cells in a look's cone that may hold something; returns how many.

    The list ends when `seen` is full.

    Parameters
    ----------
    look : Look
        The ping in bins of range.
    tiles : Tiles
        Where the grid's cells are in memory.
    among : (slots,) float32 array
        Above 0 for cells that may hold something, 0 for others.
    seen : VisibleCells
        `slot`, `row` and `column` are set.
    """
    res, reach = tiles.resolution_m, look.greatest_range_m
    top = math.floor((look.y_m - reach) / res)
    bottom = math.floor((look.y_m + reach) / res)
    slots, rows, columns, capacity, count = seen.slot, seen.row, seen.column, len(seen.slot), 0
    for row in range(top, bottom + 1):
        first, last = columns_in_cone(look, (row + 0.5) * res - look.y_m, res)
        while first < last:
            end = min(last, (first // TILE_SIDE + 1) * TILE_SIDE)
            start, left, width = slot_at(row, first, tiles), first, end - first
            first = end
            if start < 0:
                continue
            total = 0.0
            for slot in range(start, start + width):
                total += among[slot]
            if total == 0.0:
                continue
            for offset in range(width):
                if among[start + offset] > 0.0:
                    if count == capacity:
                        return count
                    slots[count], rows[count], columns[count] = start + offset, row, left + offset
                    count += 1
    return count


@compiled
def place_cells(
    look: Look,
    res: float,
    next_wanted: NDArray[np.int32],
    rays: Rays,
    seen: VisibleCells,
    listed: int,
) -> int:
    """Work out how a look sees the cells that were found; returns how many it sees.

    What stands in a quarter of a cell echoes at once, although its range is not known exactly: if
    there is an echo where it may come from, that is it, and silence elsewhere in that range says
    nothing.  If there is none, all of it was silent, and the rims of the range say nothing.

    Parameters
    ----------
    look : Look
        The ping in bins of range.
    res : float
        Side of a cell, m.
    next_wanted : (bins + 1,) int32 array
        First range bin from each on of which cells are wanted.
    rays : Rays
        What of the look's sound reaches where.
    seen : VisibleCells
        Is set, but for cells that the look does not see, which are taken out of its list.
    listed : int
        Number of the cells found.
    """
    measured, count = _measure(look, res, seen, listed), 0
    for cell in range(measured):
        extent = _extent(look, res, seen, cell)
        middle, _, _, half_width, blurred = extent
        first, last = (
            int(max(middle - half_width - blurred, 0.0)),
            int(middle + half_width + blurred),
        )
        if next_wanted[min(first, len(look.kind))] > last:
            continue
        ray, share = _reaching(look, rays, seen, cell)
        if share == 0.0:
            continue
        slot, row, column = seen.slot[cell], seen.row[cell], seen.column[cell]
        seen.slot[count], seen.row[count], seen.column[count] = slot, row, column
        seen.x_m[count], seen.y_m[count] = seen.x_m[cell], seen.y_m[cell]
        seen.range_m[count], seen.bearing[count] = seen.range_m[cell], seen.bearing[cell]
        seen.weight[count], seen.ray[count] = seen.weight[cell] * share, ray
        seen.place[slot] = count
        _spread(look, extent, seen, count)
        count += 1
    return count


@inlined
def _extent(
    look: Look, res: float, seen: VisibleCells, cell: int
) -> tuple[float, float, float, float, float]:
    """Where a cell lies in range bins, with fractions.

    Returns
    -------
    middle : float
        Of the cell.
    along_x, along_y : float
        Of its quarters off that, to either side.
    half_width, blurred : float
        Half of a quarter along the ray, and what it is blurred to by what is uncertain of ranges.
    """
    distance, bin_m = seen.range_m[cell], look.bin_m
    scale = 0.25 * res / (distance * bin_m)
    along_x, along_y = scale * seen.x_m[cell], scale * seen.y_m[cell]
    half_width = abs(along_x) + abs(along_y)
    blur = 3.0 * (look.range_std_m / bin_m) * (look.range_std_m / bin_m)
    blurred = max(min(math.sqrt(half_width * half_width + blur), MOST_BLUR_BINS), half_width)
    return (distance - look.least_range_m) / bin_m, along_x, along_y, half_width, blurred


@inlined
def _spread(
    look: Look, extent: tuple[float, float, float, float, float], seen: VisibleCells, cell: int
) -> None:
    """Spread the power of a cell's quarters over range bins."""
    middle, along_x, along_y, half_width, blurred = extent
    least = most = middle
    for quarter in range(QUARTERS):
        center = middle + (along_x if quarter & 1 else -along_x)
        center += along_y if quarter & 2 else -along_y
        first, last = int(max(center - blurred, 0.0)), math.floor(center + blurred)
        heard = look.next_echo[min(first, len(look.kind))] <= last
        half = blurred if heard else half_width
        seen.heard[cell, quarter] = 1 if heard else 0
        seen.low[cell, quarter], seen.high[cell, quarter] = center - half, center + half
        least, most = min(least, center - half), max(most, center + half)
    start = max(math.floor(least), 0)
    seen.first_bin[cell], seen.reach[cell] = start, min(math.ceil(most) - start, CELL_BINS)
    seen.density[cell] = 0.5 / half_width


@inlined
def _measure(look: Look, res: float, seen: VisibleCells, listed: int) -> int:
    """Keep the listed cells that lie in the cone, with where they lie; returns how many do.

    `weight` is what comes back from there to a transducer that is as loud all around.
    """
    wide, count = look.cos_half_angle * abs(look.cos_half_angle), 0
    rise = look.rise_m * look.rise_m
    least, greatest = look.least_range_m**2, look.greatest_range_m**2
    for cell in range(listed):
        row, column = seen.row[cell], seen.column[cell]
        x, y = (column + 0.5) * res - look.x_m, (row + 0.5) * res - look.y_m
        squared = x * x + y * y + rise
        ahead = look.axis_x * x + look.axis_y * y + look.axis_z * look.rise_m
        if least < squared < greatest and ahead * abs(ahead) > squared * wide:
            seen.slot[count], seen.row[count], seen.column[count] = seen.slot[cell], row, column
            seen.x_m[count], seen.y_m[count] = x, y
            count += 1
    rise32, absorption = np.float32(rise), np.float32(look.absorption_per_m)
    cosine = np.float32(math.cos(look.heading_rad))
    sine = np.float32(math.sin(look.heading_rad))
    # Nothing branches here, and few arrays are written: the compiler works out several at once.
    for cell in range(np.uint64(count)):
        squared = seen.x_m[cell] * seen.x_m[cell] + seen.y_m[cell] * seen.y_m[cell] + rise32
        seen.range_m[cell] = math.sqrt(squared)
        seen.weight[cell] = exp32(-absorption * seen.range_m[cell]) / (squared * squared)
    for cell in range(np.uint64(count)):
        x, y = seen.x_m[cell], seen.y_m[cell]
        seen.bearing[cell] = atan2_32(cosine * y - sine * x, cosine * x + sine * y)
    return count


@inlined
def _reaching(look: Look, rays: Rays, seen: VisibleCells, cell: int) -> tuple[int, float]:
    """Ray that a cell lies on, and the share of the power on the axis that reaches it there."""
    steps, ray_count = rays.in_sight.shape
    x, y, distance = seen.x_m[cell], seen.y_m[cell], seen.range_m[cell]
    ahead = look.axis_x * x + look.axis_y * y + look.axis_z * look.rise_m
    gain = power_gain(look, ahead / distance)
    off = (seen.bearing[cell] + look.half_angle_rad) * ray_count / (2.0 * look.half_angle_rad)
    ray = min(max(int(off), 0), ray_count - 1)
    in_sight = rays.in_sight[min(int(distance / rays.step_m), steps - 1), ray]
    return ray, gain * in_sight if gain >= LEAST_POWER_GAIN else 0.0
