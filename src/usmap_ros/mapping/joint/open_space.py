"""Free space: cells in which no surface can stand, however it might face.

A cell is free if sound came back through it, if a robot stood there, or if silence refutes every
way in which a surface could face there.  Silence counts as this place answers, by direction of
view: many looks from one side say no more than `MOST_A_SECTOR`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.field import GREATEST_RANGE, Field, X, Y
from usmap_ros.mapping.joint.ray_casting import WHOLE
from usmap_ros.mapping.joint.response import (
    INCIDENCES,
    OWN_CELLS,
    Listening,
    incidence_class,
    loudness_step,
    sounded,
    step_before,
)
from usmap_ros.mapping.superposition.cells import QUARTERS
from usmap_ros.mapping.superposition.ping_bins import ECHO
from usmap_ros.mapping.superposition.window import Looks
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled
from usmap_ros.processes.threads import for_each

#: Orientations that a surface may have, and sectors of directions of view.
ORIENTATIONS, SECTORS = 16, 12
#: Bound of what all looks from one sector say, and chance of an echo from nowhere.
MOST_A_SECTOR, CLUTTER = 3.0, 0.05
#: Looks through which so little of the sound gets, or as faint as this, say nothing.
LEAST_SOUND, LEAST_LOUDNESS = 0.03, 0.005
#: Steps of the share of sound that gets to a cell.
SHARES = 32
#: Cells along the side of a block that looks for its pings once.
BLOCK = 16
#: Rows of cells that one thread asks for at a time: some blocks.
BAND = 4 * BLOCK
#: Before a cell, sound must be open up to so many cells before its middle.
OPEN_CELLS = 1.5
#: Share of an echo's expected power that must come from a cell to prove the way to it, the share
#: of the sound that must get there, and how far before it the proof ends, in cells.
PROVING_SHARE, PROVING_SOUND, PROVEN_CELLS = 0.6, 0.3, 1.8


@compiled
def refute_surfaces(  # noqa: C901, PLR0912, PLR0915
    looks: Looks,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    listening: Listening,
    log_silent: FloatArray,
    wanted: BoolArray,
) -> NDArray[np.float32]:
    """Log-likelihood ratio of what was heard, with a surface to without, by the worst orientation.

    Parameters
    ----------
    looks, pings, field, left, listening
        The pings, and what they heard.
    log_silent : (LOUDNESSES, INCIDENCES) array
        Logarithm of P(silent | surface).
    wanted : (rows, columns) bool array
        Cells that are asked for.

    Returns
    -------
    worst : (rows, columns) float32 array
        Of the orientation that is refuted least; 0 where nothing is known.
    """
    worst = np.zeros((field.rows, field.columns), np.float32)
    said, near = np.zeros((ORIENTATIONS, SECTORS)), np.empty(len(pings), np.int64)
    # Class of incidence of a direction of view in degrees, for each orientation.
    classes = np.empty((180, ORIENTATIONS), np.int64)
    for degrees in range(180):
        for orientation in range(ORIENTATIONS):
            off = degrees + 0.5 - orientation * 180.0 / ORIENTATIONS
            off = abs(off - 180.0 * math.floor(off / 180.0 + 0.5))
            classes[degrees, orientation] = incidence_class(off)
    # Of silence, for each share of the sound that gets there.
    quiet = np.empty((SHARES + 1, log_silent.shape[0], INCIDENCES))
    for share in range(SHARES + 1):
        for loud in range(log_silent.shape[0]):
            for incidence in range(INCIDENCES):
                answers = 1.0 - math.exp(log_silent[loud, incidence])
                quiet[share, loud, incidence] = math.log(1.0 - answers * share / SHARES)
    ratios = np.empty(INCIDENCES)
    res = field.resolution_m
    for bottom in range(0, field.rows, BLOCK):
        for start in range(0, field.columns, BLOCK):
            middle_x = (field.first_column + start + 0.5 * BLOCK) * res
            middle_y = (field.first_row + bottom + 0.5 * BLOCK) * res
            count, radius = 0, 0.75 * BLOCK * res
            for index in range(len(pings)):
                numbers = looks.numbers[pings[index]]
                x, y = middle_x - numbers[0], middle_y - numbers[1]
                far = numbers[GREATEST_RANGE] + radius
                behind = numbers[8] > 0.0 and numbers[2] * x + numbers[3] * y < -radius
                if x * x + y * y < far * far and not behind:
                    near[count] = index
                    count += 1
            for row in range(bottom, min(bottom + BLOCK, field.rows)):
                for column in range(start, min(start + BLOCK, field.columns)):
                    if not wanted[row, column]:
                        continue
                    said[:] = 0.0
                    for k in range(count):
                        index = near[k]
                        ping = pings[index]
                        loudness, x, y, b, ray, distance = sounded(looks, ping, field, row, column)
                        loudness /= listening.limit[index, b]
                        if loudness <= LEAST_LOUDNESS:
                            continue
                        step = step_before(looks, ping, distance - OPEN_CELLS * res)
                        sound = left[index, ray, step] / WHOLE
                        if sound < LEAST_SOUND:
                            continue
                        said_here = quiet[int(sound * SHARES + 0.5), loudness_step(loudness)]
                        if listening.heard[index, b]:
                            chance = max(CLUTTER, listening.chance[index, b])
                            for incidence in range(INCIDENCES):
                                answers = 1.0 - math.exp(said_here[incidence]) * (1.0 - chance)
                                ratios[incidence] = math.log(answers / chance)
                        else:
                            ratios[:] = said_here
                        view_deg = math.atan2(y, x) * 180.0 / math.pi + 360.0
                        sector = int(view_deg * SECTORS / 360.0) % SECTORS
                        view = int(view_deg) % 180
                        for orientation in range(ORIENTATIONS):
                            said[orientation, sector] += ratios[classes[view, orientation]]
                    least_refuted = -1e9
                    for orientation in range(ORIENTATIONS):
                        total = 0.0
                        for sector in range(SECTORS):
                            total += max(
                                -MOST_A_SECTOR, min(MOST_A_SECTOR, said[orientation, sector])
                            )
                        least_refuted = max(least_refuted, total)
                    worst[row, column] = least_refuted
    return worst


def refute_all_surfaces(
    looks: Looks,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    listening: Listening,
    log_silent: FloatArray,
    wanted: BoolArray,
) -> NDArray[np.float32]:
    """The same as `refute_surfaces`, with as many threads as there are cores."""
    return np.concatenate(
        for_each(
            lambda band: refute_surfaces(
                looks, pings, band[1], left, listening, log_silent, wanted[band[0]]
            ),
            field.bands(BAND),
        )
    )


@compiled
def prove_open(  # noqa: C901, PLR0913, PLR0917
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
    for index in range(len(pings)):
        ping = pings[index]
        numbers, bins = looks.numbers[ping], looks.bins[ping]
        loudest[:] = 0.0
        per_bin = max(1.0, 1.1 * res / numbers[13])
        reach = numbers[GREATEST_RANGE] + res
        for place in range(len(rows)):
            row, column = rows[place], columns[place]
            if abs((field.first_column + column) * res - numbers[0]) > reach:
                continue
            loudness, x, y, b, ray, distance = sounded(looks, ping, field, row, column)
            if loudness <= 0.0:
                continue
            step = step_before(looks, ping, distance - OWN_CELLS * res)
            sound = left[index, ray, step] / WHOLE
            if sound < PROVING_SOUND:
                continue
            cell, total = (row * field.columns + column) * QUARTERS, 0.0
            for part in range(QUARTERS):
                total += power[cell + part]
            returned = loudness * sound * total
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
                trace_open(
                    numbers[X],
                    numbers[Y],
                    angle[b],
                    way[b],
                    field,
                    index,
                    last,
                    proven,
                    weights[index],
                )


@compiled
def trace_open(  # noqa: PLR0913, PLR0917
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
