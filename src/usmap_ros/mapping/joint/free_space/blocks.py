"""Blocks of cells: the pings that may sound one are looked for once for all of its cells."""

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.visibility.beams import is_beside, off_axis
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.visibility.ray_casting import RAYS, STEPS
from usmap_ros.mapping.joint.visibility.soundings import SoundedPlaces
from usmap_ros.mapping.ping_table import GREATEST_RANGE, HALF_ANGLE, RISE, PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import inlined

#: Cells along the side of a block.
BLOCK = 16
#: Radius of a disc that holds a block.
RADIUS_CELLS = 0.75 * BLOCK
#: Rows of cells that one thread asks for at a time: some blocks.
BAND = 4 * BLOCK
#: Before a cell, sound must be open up to so many cells before its middle.
OPEN_CELLS = 1.5


@inlined
def find_wanted(
    wanted: BoolArray,
    bottom: int,
    start: int,
    resolution_m: float,
    asked: NDArray[np.int64],
    seen: SoundedPlaces,
) -> int:
    """Set which cells of a block are asked for, and where; returns how many there are."""
    cells = 0
    for row in range(bottom, min(bottom + BLOCK, wanted.shape[0])):
        for column in range(start, min(start + BLOCK, wanted.shape[1])):
            if wanted[row, column]:
                asked[cells] = (row - bottom) * BLOCK + column - start
                seen.right[cells] = (column - start + 0.5 - 0.5 * BLOCK) * resolution_m
                seen.up[cells] = (row - bottom + 0.5 - 0.5 * BLOCK) * resolution_m
                cells += 1
    return cells


@inlined
def find_near(
    table: PingTable,
    pings: NDArray[np.int64],
    field: Field,
    bottom: int,
    start: int,
    changed: NDArray[np.uint8],
    near: NDArray[np.int64],
) -> tuple[int, bool]:
    """Set the pings that may sound a block; returns how many there are, and if any has changed."""
    count, is_new = 0, False
    middle_x, middle_y = middle_of(field, bottom, start)
    for index in range(len(pings)):
        numbers = table.numbers[pings[index]]
        x, y = middle_x - numbers[X], middle_y - numbers[Y]
        if may_sound(numbers, x, y, field.resolution_m):
            near[count] = index
            is_new = is_new or is_other(table, pings[index], changed[index], x, y, field)
            count += 1
    return count, is_new


@inlined
def middle_of(field: Field, bottom: int, start: int) -> tuple[float, float]:
    """Middle of the block that begins with a row and a column of a field, m."""
    middle_x = (field.first_column + start + 0.5 * BLOCK) * field.resolution_m
    middle_y = (field.first_row + bottom + 0.5 * BLOCK) * field.resolution_m
    return middle_x, middle_y


@inlined
def may_sound(numbers: FloatArray, x_m: float, y_m: float, resolution_m: float) -> bool:
    """Whether a ping may sound a block with such a middle, from the transducer."""
    radius = RADIUS_CELLS * resolution_m
    far = numbers[GREATEST_RANGE] + radius
    is_near: bool = x_m * x_m + y_m * y_m < far * far
    return is_near and not is_beside(numbers, x_m, y_m, radius)


@inlined
def is_other(
    table: PingTable,
    ping: int,
    changed: NDArray[np.uint8],
    x_m: float,
    y_m: float,
    field: Field,
) -> bool:
    """Whether another share of a ping's sound is left in a block, or on the way there.

    Parameters
    ----------
    table, ping
        The ping.
    changed : (RAYS,) uint8 array
        By `usmap_ros.mapping.joint.visibility.ray_casting.changed_from`, of the ping.
    x_m, y_m : float
        Middle of the block, from the transducer.
    field : Field
        Its cells.
    """
    numbers, squared = table.numbers[ping], x_m * x_m + y_m * y_m
    radius_m = RADIUS_CELLS * field.resolution_m
    half = numbers[HALF_ANGLE]
    far_m = math.sqrt(squared + numbers[RISE] ** 2) + radius_m
    last_step = min(int(far_m * STEPS / numbers[GREATEST_RANGE]), STEPS - 1)
    first, last = 0, RAYS - 1
    if squared > radius_m * radius_m and half < 0.5 * math.pi:
        off = off_axis(table, ping, math.atan2(y_m, x_m))
        aside, per_rad = math.asin(radius_m / math.sqrt(squared)), 0.5 * RAYS / half
        # One ray more on either side: what rounding may make of an edge.
        first = max(first, int((off - aside + half) * per_rad) - 1)
        last = min(last, int((off + aside + half) * per_rad) + 1)
    is_new = False
    for ray in range(first, last + 1):
        is_new |= changed[ray] <= last_step
    return is_new
