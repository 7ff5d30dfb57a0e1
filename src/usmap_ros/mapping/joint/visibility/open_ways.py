"""Open ways: cells that sound is known to have passed, for it came back through them."""

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.visibility.soundings import room_for, sound
from usmap_ros.mapping.ping_bins import ECHO
from usmap_ros.mapping.ping_table import BIN_M, PingTable, X, Y
from usmap_ros.numerics.compiled import compiled

#: Share of an echo's expected power below which what a cell returns proves nothing of the way
#: there, the share of the sound that must get there, and how far before it the proof ends, cells.
PROVING_SHARE, PROVING_SOUND, PROVEN_CELLS = 0.05, 0.3, 1.8
#: Before what returned it, sound must be left up to so many cells before its middle.
OWN_CELLS = 3.0


@compiled
def prove_open(
    table: PingTable,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    expected: NDArray[np.float32],
    power: NDArray[np.float32],
    proven: NDArray[np.float32],
    weights: NDArray[np.float32],
) -> None:
    """Count pings whose sound came back through each cell from what is believed behind it.

    Each counts by the share of its echo that comes from there: neighbours share the echoes of a
    wall, and sound that came from any of them came by much the same way.

    Parameters
    ----------
    table, pings, field, left
        The pings.
    expected : (pings, bins) float32 array
        λ.
    power : (rows, columns) float32 array
        Of each cell that is believed to hold something; 0 elsewhere.
    proven : (rows, columns) float32 array
        Added to.
    weights : (pings,) float32 array
        How much each ping counts.
    """
    res = field.resolution_m
    last, ways = np.full((field.rows, field.columns), -1, np.int32), 0
    rows, columns = np.nonzero(power)
    seen = room_for(len(rows))
    for place in range(len(rows)):
        seen.right[place], seen.up[place] = (columns[place] + 0.5) * res, (rows[place] + 0.5) * res
    for index in range(len(pings)):
        ping = pings[index]
        x0, y0, bins = table.numbers[ping, X], table.numbers[ping, Y], table.bins[ping]
        x_m, y_m = field.first_column * res - x0, field.first_row * res - y0
        per_bin = max(1.0, 1.1 * res / table.numbers[ping, BIN_M])
        count = sound(
            table, ping, left[index], expected[index], x_m, y_m, OWN_CELLS * res, len(rows), seen
        )
        for place in range(count):
            which, b, share = seen.which[place], seen.bin[place], 0.0
            if seen.sound[place] < PROVING_SOUND:
                continue
            returned = seen.loudness[place] * expected[index, b] * seen.sound[place]
            returned *= power[rows[which], columns[which]] / per_bin
            for near in range(max(0, b - 2), min(bins, b + 3)):
                if table.kind[ping, near] == ECHO:
                    share = max(share, returned / expected[index, near])
            if share < PROVING_SHARE:
                continue
            x, y = x_m + seen.right[which], y_m + seen.up[which]
            angle_rad, way_m = math.atan2(y, x), math.sqrt(x * x + y * y) - PROVEN_CELLS * res
            ways += 1
            weight = weights[index] * min(1.0, share)
            trace_open(x0, y0, angle_rad, way_m, field, ways, last, proven, weight)


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
