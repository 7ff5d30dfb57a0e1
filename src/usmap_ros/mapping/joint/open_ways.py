"""Open ways: cells that sound is known to have passed, for it came back through them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.field import BIN_M, QUARTERS, Field, X, Y
from usmap_ros.mapping.joint.soundings import room_for, sound
from usmap_ros.mapping.looks import Looks
from usmap_ros.mapping.ping_bins import ECHO
from usmap_ros.numerics.arrays import BoolArray
from usmap_ros.numerics.compiled import compiled

#: Share of an echo's expected power that must come from a cell to prove the way to it, the share
#: of the sound that must get there, and how far before it the proof ends, in cells.
PROVING_SHARE, PROVING_SOUND, PROVEN_CELLS = 0.6, 0.3, 1.8
#: Before what returned it, sound must be left up to so many cells before its middle.
OWN_CELLS = 3.0


@compiled
def prove_open(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    looks: Looks,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    expected: NDArray[np.float32],
    power: NDArray[np.float32],
    believed: BoolArray,
    proven: NDArray[np.float32],
    weights: NDArray[np.float32],
) -> None:
    """Count pings whose sound came back through each cell from what is believed behind it.

    Parameters
    ----------
    looks, pings, field, left
        The pings.
    expected : (pings, bins) float32 array
        λ.
    power : (quarters,) float32 array
        Of each.
    believed : (rows, columns) bool array
        Cells that hold something.
    proven : (rows, columns) float32 array
        Added to.
    weights : (pings,) float32 array
        How much each ping counts.
    """
    res = field.resolution_m
    last = np.full((field.rows, field.columns), -1, np.int32)
    loudest, angle = np.zeros(expected.shape[1]), np.zeros(expected.shape[1])
    way = np.zeros(expected.shape[1])
    rows, columns = np.nonzero(believed)
    seen, total = room_for(len(rows)), np.zeros(len(rows))
    for place in range(len(rows)):
        seen.right[place], seen.up[place] = (columns[place] + 0.5) * res, (rows[place] + 0.5) * res
        cell = (rows[place] * field.columns + columns[place]) * QUARTERS
        for part in range(QUARTERS):
            total[place] += power[cell + part]
    for index in range(len(pings)):
        ping = pings[index]
        x0, y0, bins = looks.numbers[ping, X], looks.numbers[ping, Y], looks.bins[ping]
        x_m, y_m = field.first_column * res - x0, field.first_row * res - y0
        loudest[:] = 0.0
        per_bin = max(1.0, 1.1 * res / looks.numbers[ping, BIN_M])
        count = sound(
            looks, ping, left[index], expected[index], x_m, y_m, OWN_CELLS * res, len(rows), seen
        )
        for place in range(count):
            which, b = seen.which[place], seen.bin[place]
            if seen.sound[place] < PROVING_SOUND:
                continue
            x, y = x_m + seen.right[which], y_m + seen.up[which]
            returned = seen.loudness[place] * expected[index, b] * seen.sound[place] * total[which]
            for near in range(max(0, b - 2), min(bins, b + 3)):
                if (
                    looks.kind[ping, near] == ECHO
                    and returned / per_bin > PROVING_SHARE * expected[index, near]
                    and returned > loudest[near]
                ):
                    loudest[near], angle[near] = returned, math.atan2(y, x)
                    way[near] = math.sqrt(x * x + y * y) - PROVEN_CELLS * res
        for b in range(bins):
            if loudest[b] > 0.0:
                trace_open(x0, y0, angle[b], way[b], field, index, last, proven, weights[index])


@compiled
def trace_open(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    x_m: float,
    y_m: float,
    angle_rad: float,
    way_m: float,
    field: Field,
    ping: int,
    last: NDArray[np.int32],
    proven: NDArray[np.float32],
    weight: float,
) -> None:
    """Count a ping once for every cell on a way that its sound is known to have gone.

    Parameters
    ----------
    x_m, y_m, angle_rad, way_m : float
        Where the way begins, where it goes, and how long it is.
    field : Field
        The cells.
    ping : int
        Number of the ping.
    last : (rows, columns) int32 array
        Ping that each cell was counted for last.
    proven : (rows, columns) float32 array
        Added to.
    weight : float
        How much the ping counts.
    """
    step_m = 0.5 * field.resolution_m
    for k in range(int(way_m / step_m)):
        column = math.floor((x_m + k * step_m * math.cos(angle_rad)) / field.resolution_m)
        row = math.floor((y_m + k * step_m * math.sin(angle_rad)) / field.resolution_m)
        row, column = row - field.first_row, column - field.first_column
        if row < 0 or column < 0 or row >= field.rows or column >= field.columns:
            continue
        if last[row, column] != ping:
            last[row, column] = ping
            proven[row, column] += weight
