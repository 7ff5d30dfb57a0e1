"""Ray casting: how much of a ping's sound is left along each ray."""

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.ping_table import GREATEST_RANGE, HALF_ANGLE, HEADING, PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled, inlined
from usmap_ros.processes.threads import for_each

#: Rays into which a beam is divided, and samples along each.
RAYS, STEPS = 96, 192
#: Optical depth behind which nothing is left.
OPAQUE = 7.0
#: Rays go on in leaps as long as there is nothing within so many cells of their middle.
NEAR_CELLS = 2
#: What one is in the tables of `cast_rays`.
WHOLE = 255
#: From so far behind an echo that lets nothing through, m, such a share of the sound is left: what
#: returned it may be narrower than the beam.
BEHIND_ECHO_M, BEYOND = 0.1, 0.1
#: Pings whose rays one thread casts at a time; and steps that are compared at once.
BATCH, TOGETHER = 64, 8


def cast_all_rays(
    table: PingTable, pings: NDArray[np.int64], field: Field, depth: NDArray[np.float32]
) -> NDArray[np.uint8]:
    """The same as `cast_rays`, with as many threads as there are cores."""
    left = np.empty((len(pings), RAYS, STEPS), np.uint8)

    def cast(first: int) -> None:
        batch = slice(first, first + BATCH)
        _cast(table, pings[batch], field, depth, left[batch])

    for_each(cast, range(0, len(pings), BATCH))
    return left


def cast_rays(
    table: PingTable, pings: NDArray[np.int64], field: Field, depth: NDArray[np.float32]
) -> NDArray[np.uint8]:
    """Share of the sound that reaches each sample of each ray.

    Parameters
    ----------
    table : PingTable
        Pings.
    pings : (pings,) integer array
        Their rows.
    field : Field
        The cells.
    depth : (rows, columns) float32 array
        Optical depth of each.

    Returns
    -------
    left : (pings, RAYS, STEPS) uint8 array
        exp(-optical depth) up to sample k, at range k / STEPS of the greatest, times `WHOLE`.
    """
    left = np.empty((len(pings), RAYS, STEPS), np.uint8)
    _cast(table, pings, field, depth, left)
    return left


def end_rays(left: NDArray[np.uint8], ended_m: FloatArray, greatest_m: FloatArray) -> None:
    """Let rays end behind echoes of what lets nothing through.

    Parameters
    ----------
    left : (pings, RAYS, STEPS) uint8 array
        By `cast_rays`; changed.
    ended_m : (pings,) array
        Range of the echo; infinite: there is none.
    greatest_m : (pings,) array
        Up to which range rays were cast.
    """
    steps = np.ceil((ended_m + BEHIND_ECHO_M) / greatest_m * STEPS)
    for ping in np.flatnonzero(steps < STEPS).tolist():
        beyond = left[ping, :, int(steps[ping]) :]
        beyond[:] = BEYOND * beyond


def everything(pings: int) -> NDArray[np.uint8]:
    """`changed_from` of so many pings of which all is new."""
    return np.zeros((pings, RAYS), np.uint8)


def changed_from(left: NDArray[np.uint8], before: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """From which step on something else is left of the sound along each ray than before.

    Parameters
    ----------
    left, before : (pings, RAYS, STEPS) uint8 arrays
        By `cast_rays`.

    Returns
    -------
    changed : (pings, RAYS) uint8 array
        Step that is no later than the first that differs; `STEPS` where none does.
    """
    words = STEPS // TOGETHER

    def compared(first: int) -> NDArray[np.uint8]:
        batch = slice(first, first + BATCH)
        one, other = (each[batch].view(np.uint64) for each in (left, before))
        differ = one != other
        word = np.where(differ.any(axis=2), differ.argmax(axis=2), words)
        return (TOGETHER * word).astype(np.uint8)

    return np.concatenate(for_each(compared, range(0, len(left), BATCH)))


@compiled
def _cast(
    table: PingTable,
    pings: NDArray[np.int64],
    field: Field,
    depth: NDArray[np.float32],
    left: NDArray[np.uint8],
) -> None:
    """Set what `cast_rays` returns."""
    if not depth.any():
        left[:] = WHOLE
        return
    res = field.resolution_m
    near = _near(depth)
    for index in range(len(pings)):
        numbers = table.numbers[pings[index]]
        step_m = numbers[GREATEST_RANGE] / STEPS
        x0, y0 = numbers[X] / res - field.first_column, numbers[Y] / res - field.first_row
        stride = step_m / res
        # So many samples lie within reach of the one in their middle.
        leap = int(2.0 * NEAR_CELLS / stride) + 1
        for ray in range(RAYS):
            angle = ray_angle(numbers, ray)
            dx, dy = stride * math.cos(angle), stride * math.sin(angle)
            passed, share = 0.0, WHOLE
            left[index, ray] = share
            for first in range(0, STEPS, leap):
                middle = first + 0.5 * leap
                row, column = int(y0 + middle * dy), int(x0 + middle * dx)
                if not _is_near(near, row + NEAR_CELLS, column + NEAR_CELLS):
                    continue
                for step in range(first, min(first + leap, STEPS)):
                    column, row = int(x0 + (step + 0.5) * dx), int(y0 + (step + 0.5) * dy)
                    if row < 0 or column < 0 or row >= field.rows or column >= field.columns:
                        continue
                    if depth[row, column] > 0.0 and passed <= OPAQUE:
                        passed += depth[row, column] * stride
                        share = int(WHOLE * math.exp(-passed) + 0.5) if passed <= OPAQUE else 0
                        left[index, ray, step + 1 :] = share
                if passed > OPAQUE:
                    break


@inlined
def ray_angle(numbers: FloatArray, ray: int) -> float:
    """Direction of one of a ping's rays, rad, by its numbers in a table."""
    half = numbers[HALF_ANGLE]
    angle_rad: float = numbers[HEADING] - half + (ray + 0.5) * 2.0 * half / RAYS
    return angle_rad


@inlined
def _near(depth: NDArray[np.float32]) -> BoolArray:
    """Cells so near to one that holds something back, with a rim around."""
    rows, columns = depth.shape
    near = np.zeros((rows + 2 * NEAR_CELLS, columns + 2 * NEAR_CELLS), np.bool_)
    for row in range(rows):
        for column in range(columns):
            if depth[row, column] > 0.0:
                for up in range(2 * NEAR_CELLS + 1):
                    near[row + up, column : column + 2 * NEAR_CELLS + 1] = True
    return near


@inlined
def _is_near(near: BoolArray, row: int, column: int) -> bool:
    """Whether a cell is, of those with the rim."""
    return 0 <= row < near.shape[0] and 0 <= column < near.shape[1] and bool(near[row, column])
