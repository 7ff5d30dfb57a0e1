"""The cells of the map that may hold something, as one ping sees them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.compiled import compiled, inlined
from usmap_ros.mapping.grid import TILE_CELLS, TILE_SIDE
from usmap_ros.mapping.superposition.look import GAIN_STEPS, Look

#: Quarters of a cell: what stands in a cell is placed to half its side.
QUARTERS = 4
#: Directions from which a cell can be looked at.
SIDES = 6
#: Gain, in power, below which a cell at the rim of the beam is left out.
LEAST_POWER_GAIN = 4e-4
#: Range bins to either side over which a quarter is blurred at the most.
MOST_BLUR_BINS = 6.0


class Tiles(NamedTuple):
    """Where the cells of a tiled grid are in memory; see `usmap_ros.mapping.grid.TiledGrid`.

    Parameters
    ----------
    directory : (tile rows, tile columns) integer array
        Number of each tile; -1 where there is none.
    first_row, first_column : int
        Of the directory, in tiles.
    resolution_m : float
        Side of a cell.
    """

    directory: NDArray[np.intp]
    first_row: int
    first_column: int
    resolution_m: float


class Rays(NamedTuple):
    """Rays of a look, sampled cell by cell.

    Parameters
    ----------
    in_sight : (rays, steps) float32 array
        Share of the sound that reaches each step unblocked.
    proven_m : (rays,) float32 array
        How far along each ray sound is known to have gone, because it came back.
    step_m : float
        Length of a step.
    """

    in_sight: NDArray[np.float32]
    proven_m: NDArray[np.float32]
    step_m: float


class Seen(NamedTuple):
    """Cells of a look that may hold something, and their quarters.

    Parameters
    ----------
    slot : (cells,) integer array
        Of each cell.
    row, column : (cells,) integer arrays
        Where it lies on the grid.
    ray : (cells,) integer array
        The ray of the look that it lies on.
    side : (cells,) integer array
        From which of `SIDES` directions it is seen.
    bearing : (cells,) float32 array
        Off the look's heading.
    low, high : (cells, QUARTERS) float32 arrays
        Range bins, with fractions, between which each quarter lies.
    sharpness : (cells,) float32 array
        Depth of a quarter over that range: 1 unless ranges are blurred by the pose's error.
    weight : (cells,) float32 array
        Power that each quarter would return if it scattered with power 1.
    place : (slots,) int32 array
        Row of each slot in the arrays above; -1 for all others.
    """

    slot: NDArray[np.int64]
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    ray: NDArray[np.int64]
    side: NDArray[np.int64]
    bearing: NDArray[np.float32]
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    sharpness: NDArray[np.float32]
    weight: NDArray[np.float32]
    place: NDArray[np.int32]


@inlined
def slot_at(row: int, column: int, tiles: Tiles) -> int:
    """Slot of a cell; -1 where there is no tile."""
    tile_row = row // TILE_SIDE - tiles.first_row
    tile_column = column // TILE_SIDE - tiles.first_column
    if tile_row < 0 or tile_column < 0:
        return -1
    if tile_row >= tiles.directory.shape[0] or tile_column >= tiles.directory.shape[1]:
        return -1
    tile = tiles.directory[tile_row, tile_column]
    if tile < 0:
        return -1
    return int(tile * TILE_CELLS + (row % TILE_SIDE) * TILE_SIDE + column % TILE_SIDE)


@inlined
def slot_beside(slot: int, row: int, column: int, rows: int, columns: int, tiles: Tiles) -> int:
    """Slot of a cell so many rows and columns, one at the most, from another; -1 if there is none.

    Parameters
    ----------
    slot, row, column : int
        Of the other.
    rows, columns : int
        How far it is.
    tiles : Tiles
        The grid.
    """
    inside_row, inside_column = slot % TILE_CELLS // TILE_SIDE + rows, slot % TILE_SIDE + columns
    if 0 <= inside_row < TILE_SIDE and 0 <= inside_column < TILE_SIDE:
        return slot + rows * TILE_SIDE + columns
    return slot_at(row + rows, column + columns, tiles)


@inlined
def power_gain(look: Look, cosine: float) -> float:
    """Two-way power gain at an angle off the beam axis, given by its cosine."""
    place = (1.0 - cosine) / (1.0 - look.cos_half_angle) * GAIN_STEPS
    entry = min(max(int(place), 0), GAIN_STEPS - 1)
    before, after = look.power_gain[entry], look.power_gain[entry + 1]
    return float(before + (after - before) * (place - entry))


@compiled
def find_cells(look: Look, tiles: Tiles, alive: NDArray[np.float32], rays: Rays, seen: Seen) -> int:
    """List the cells in a look's cone that may hold something; returns how many.

    The list ends when `seen` is full.

    Parameters
    ----------
    look : Look
        The ping.
    tiles : Tiles
        The grid.
    alive : (slots,) float32 array
        Not 0 for cells that may hold something.
    rays : Rays
        What of the look's sound reaches where.
    seen : Seen
        Is filled.
    """
    res, reach = tiles.resolution_m, look.greatest_range_m
    ray_count, steps = rays.in_sight.shape
    capacity = len(seen.slot)
    rays_per_rad = ray_count / (2.0 * look.half_angle_rad)
    top = math.floor((look.y_m - reach) / res)
    bottom = math.floor((look.y_m + reach) / res)
    left = math.floor((look.x_m - reach) / res)
    right = math.floor((look.x_m + reach) / res)
    wide = look.cos_half_angle * abs(look.cos_half_angle)
    nearest, farthest = look.least_range_m**2, reach**2
    # What stands in a quarter may be anywhere in it, and its range is not known exactly.
    blur = 3.0 * look.range_std_m * look.range_std_m
    count = 0
    for tile_row in range(top // TILE_SIDE, bottom // TILE_SIDE + 1):
        for tile_column in range(left // TILE_SIDE, right // TILE_SIDE + 1):
            first = slot_at(tile_row * TILE_SIDE, tile_column * TILE_SIDE, tiles)
            # A tile is out of sight if it is farther behind than half of its diagonal.
            x = (tile_column + 0.5) * TILE_SIDE * res - look.x_m
            y = (tile_row + 0.5) * TILE_SIDE * res - look.y_m
            ahead = look.axis_x * x + look.axis_y * y
            behind = look.cos_half_angle > 0.0 and ahead < -0.71 * TILE_SIDE * res
            if first < 0 or (behind and look.axis_z == 0.0):
                continue
            for slot in range(first, first + TILE_CELLS):
                if alive[slot] == 0.0:
                    continue
                row = tile_row * TILE_SIDE + (slot - first) // TILE_SIDE
                column = tile_column * TILE_SIDE + (slot - first) % TILE_SIDE
                x, y = (column + 0.5) * res - look.x_m, (row + 0.5) * res - look.y_m
                squared = x * x + y * y + look.rise_m * look.rise_m
                if squared <= nearest or squared >= farthest:
                    continue
                ahead = look.axis_x * x + look.axis_y * y + look.axis_z * look.rise_m
                # Most cells are out of the cone: that takes no root to tell.
                if ahead * abs(ahead) <= squared * wide:
                    continue
                distance = math.sqrt(squared)
                gain = power_gain(look, ahead / distance)
                if gain < LEAST_POWER_GAIN:
                    continue
                direction = math.atan2(y, x)
                bearing = direction - look.heading_rad
                bearing -= 2.0 * math.pi * math.floor(bearing / (2.0 * math.pi) + 0.5)
                ray = int((bearing + look.half_angle_rad) * rays_per_rad)
                ray = min(max(ray, 0), ray_count - 1)
                step = min(int(distance / rays.step_m), steps - 1)
                if rays.in_sight[ray, step] == 0.0:
                    continue
                if count == capacity:
                    return count
                side = int((direction + math.pi) / (2.0 * math.pi) * SIDES)
                seen.side[count] = min(max(side, 0), SIDES - 1)
                seen.bearing[count] = bearing
                heard = math.exp(-look.absorption_per_m * distance) / (squared * squared)
                seen.weight[count] = gain * heard * rays.in_sight[ray, step]
                seen.slot[count], seen.row[count], seen.column[count] = slot, row, column
                seen.ray[count] = ray
                seen.place[slot] = count
                # Half the depth of a quarter along the ray, and where the four centres are.
                along_x, along_y = 0.25 * res * x / distance, 0.25 * res * y / distance
                half_depth = abs(along_x) + abs(along_y)
                half_width = math.sqrt(half_depth * half_depth + blur)
                half_width = max(min(half_width, MOST_BLUR_BINS * look.bin_m), half_depth)
                seen.sharpness[count] = half_depth / half_width
                for quarter in range(QUARTERS):
                    offset = along_x if quarter & 1 else -along_x
                    offset += along_y if quarter & 2 else -along_y
                    middle = distance + offset - look.least_range_m
                    seen.low[count, quarter] = (middle - half_width) / look.bin_m
                    seen.high[count, quarter] = (middle + half_width) / look.bin_m
                count += 1
    return count


@compiled
def forget(seen: Seen, count: int) -> None:
    """Clear `Seen.place` for the next look."""
    for cell in range(count):
        seen.place[seen.slot[cell]] = -1
