"""Free space: cells in which no surface can stand, however it might face.

A cell is free if sound came back through it, if a robot stood there, or if silence refutes every
way in which a surface could face there.  Silence counts as this place answers, by direction of
view: many looks from one side say no more than `MOST_A_SECTOR`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.field import GREATEST_RANGE, QUARTERS, Field, X, Y
from usmap_ros.mapping.joint.ray_casting import RAYS, STEPS, WHOLE
from usmap_ros.mapping.joint.response import (
    FIRST_DB,
    INCIDENCES,
    LOUDNESSES,
    OWN_CELLS,
    STEP_DB,
    Listening,
    incidence_class,
    sounded,
    step_before,
)
from usmap_ros.mapping.looks import Looks
from usmap_ros.mapping.ping_bins import ECHO, GAIN_STEPS
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled, inlined
from usmap_ros.numerics.elementary import atan2_32, exp32, log32

#: Orientations that a surface may have, and sectors of directions of view.
ORIENTATIONS, SECTORS = 16, 12
#: Kinds of surfaces that are asked for: of each orientation, and round ones, which answer every
#: view as flat ones answer a square one, but fainter by so many steps of loudness.
KINDS, FAINTER = ORIENTATIONS + 1, 4
#: Groups of kinds: walls along and across the usual direction, and all others.
GROUPS, ALONG, ACROSS, OTHERS = 3, 0, 1, 2
#: Bound of what all looks from one sector say, and chance of an echo from nowhere.
MOST_A_SECTOR, CLUTTER = 2.4, 0.05
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


class _Nearby(NamedTuple):
    """Pings that may sound a block of cells, and those of them that sound one cell: float32 arrays.

    Parameters
    ----------
    number, ping : (pings,) int64 arrays
        Which pings, and their rows of the looks.
    numbers : (12, pings) array
        x and y of the middle of the block from each, and of its axis; axis times rise; squares of
        the rise, of the cosine of the half angle, with its sign, and of the least and greatest
        range; cosine and sine of the heading; absorption.
    which : (pings,) int64 array
        Those that sound the cell, of the former.
    x, y, distance, ahead, loudness, off : (pings,) float32 arrays
        Where the cell is from them, how far, and the cosine of its angle off the axis; power that
        an object of power 1 would return but for the beam; angle off the heading.
    """

    number: NDArray[np.int64]
    ping: NDArray[np.int64]
    numbers: NDArray[np.float32]
    which: NDArray[np.int64]
    x: NDArray[np.float32]
    y: NDArray[np.float32]
    distance: NDArray[np.float32]
    ahead: NDArray[np.float32]
    loudness: NDArray[np.float32]
    off: NDArray[np.float32]


@compiled
def refute_surfaces(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    looks: Looks,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    listening: Listening,
    log_silent: FloatArray,
    kinds: FloatArray,
    wanted: BoolArray,
    changed: BoolArray,
    worst: NDArray[np.float32],
) -> None:
    """Log-likelihood ratio of what was heard, with a surface to without, by the worst kind.

    Parameters
    ----------
    looks, pings, field, left, listening
        The pings, and what they heard.
    log_silent : (LOUDNESSES, INCIDENCES) array
        Logarithm of P(silent | surface).
    kinds : (KINDS, 3) array
        By `usmap_ros.mapping.joint.usual_directions.log_priors`.
    wanted : (rows, columns) bool array
        Cells that are asked for.
    changed : (pings,) bool array
        Whether a ping says something else than the last time.
    worst : (rows, columns, GROUPS) float32 array
        Of the kind of each group that is refuted least, 0 where nothing is known; set where it
        changes.
    """
    said = np.empty((SECTORS, KINDS), np.float32)
    classes, silence = _classes(kinds), _silence(log_silent)
    most = len(pings)
    near = _Nearby(
        np.empty(most, np.int64), np.empty(most, np.int64), np.empty((12, most), np.float32),
        np.empty(most, np.int64),
        np.empty(most, np.float32), np.empty(most, np.float32), np.empty(most, np.float32),
        np.empty(most, np.float32), np.empty(most, np.float32), np.empty(most, np.float32),
    )  # fmt: skip
    for bottom in range(0, field.rows, BLOCK):
        for start in range(0, field.columns, BLOCK):
            end, right = min(bottom + BLOCK, field.rows), min(start + BLOCK, field.columns)
            if not wanted[bottom:end, start:right].any():
                continue
            around, is_new = _find_near(looks, pings, field, bottom, start, changed, near)
            if not is_new:
                continue
            for row in range(bottom, end):
                for column in range(start, right):
                    if not wanted[row, column]:
                        continue
                    count = _sound(field, row, column, around, near)
                    said[:] = 0.0
                    _add_said(looks, field, left, listening, silence, classes, count, near, said)
                    _put_least_refuted(said, kinds, worst[row, column])


@inlined
def _classes(kinds: FloatArray) -> NDArray[np.int32]:
    """Class of incidence of a direction of view in degrees, for each orientation."""
    classes = np.empty((180, ORIENTATIONS), np.int32)
    for degrees in range(180):
        for orientation in range(ORIENTATIONS):
            off = degrees + 0.5 - kinds[orientation, 0] * 180.0 / math.pi
            off = abs(off - 180.0 * math.floor(off / 180.0 + 0.5))
            classes[degrees, orientation] = incidence_class(off)
    return classes


@inlined
def _silence(log_silent: FloatArray) -> NDArray[np.float32]:
    """P(silent | surface), and its logarithm, by the share of the sound that gets there."""
    loudnesses = log_silent.shape[0]
    silence = np.empty((SHARES + 1, loudnesses, 2, INCIDENCES), np.float32)
    for share in range(SHARES + 1):
        for loud in range(loudnesses):
            for incidence in range(INCIDENCES):
                answers = 1.0 - math.exp(log_silent[loud, incidence])
                silence[share, loud, 0, incidence] = 1.0 - answers * share / SHARES
                silence[share, loud, 1, incidence] = math.log(1.0 - answers * share / SHARES)
    return silence


@inlined
def _find_near(
    looks: Looks,
    pings: NDArray[np.int64],
    field: Field,
    bottom: int,
    start: int,
    changed: BoolArray,
    near: _Nearby,
) -> tuple[int, bool]:
    """Set the pings that may sound a block; returns how many there are, and if any has changed."""
    count, radius, is_new = 0, 0.75 * BLOCK * field.resolution_m, False
    middle_x = (field.first_column + start + 0.5 * BLOCK) * field.resolution_m
    middle_y = (field.first_row + bottom + 0.5 * BLOCK) * field.resolution_m
    for index in range(len(pings)):
        numbers = looks.numbers[pings[index]]
        x, y = middle_x - numbers[0], middle_y - numbers[1]
        far = numbers[GREATEST_RANGE] + radius
        behind = numbers[8] > 0.0 and numbers[2] * x + numbers[3] * y < -radius
        if x * x + y * y >= far * far or behind:
            continue
        near.number[count], near.ping[count] = index, pings[index]
        is_new = is_new or changed[index]
        # From the middle of the block, so that little is lost in single precision.
        near.numbers[0, count], near.numbers[1, count] = x, y
        near.numbers[2, count], near.numbers[3, count] = numbers[2], numbers[3]
        near.numbers[4, count] = numbers[4] * numbers[5]
        near.numbers[5, count] = numbers[5] * numbers[5]
        near.numbers[6, count] = numbers[8] * abs(numbers[8])
        near.numbers[7, count] = numbers[9] * numbers[9]
        near.numbers[8, count] = numbers[GREATEST_RANGE] * numbers[GREATEST_RANGE]
        near.numbers[9, count] = math.cos(numbers[6])
        near.numbers[10, count] = math.sin(numbers[6])
        near.numbers[11, count] = -numbers[11]
        count += 1
    return count, is_new


@inlined
def _sound(field: Field, row: int, column: int, around: int, near: _Nearby) -> int:
    """Set how pings sound a cell; returns how many do.  The same as `response.sounded`."""
    beside = np.float32((column % BLOCK + 0.5 - 0.5 * BLOCK) * field.resolution_m)
    above = np.float32((row % BLOCK + 0.5 - 0.5 * BLOCK) * field.resolution_m)
    numbers, count = near.numbers, 0
    for k in range(around):
        x, y = numbers[0, k] + beside, numbers[1, k] + above
        squared = x * x + y * y + numbers[5, k]
        ahead = numbers[2, k] * x + numbers[3, k] * y + numbers[4, k]
        near.which[count], near.x[count], near.y[count] = k, x, y
        near.distance[count], near.ahead[count] = np.sqrt(squared), ahead
        is_inside = (squared > numbers[7, k]) & (squared < numbers[8, k])
        count += is_inside & (ahead * abs(ahead) > squared * numbers[6, k])
    for place in range(count):
        k, x, y = near.which[place], near.x[place], near.y[place]
        distance = near.distance[place]
        decay = exp32(numbers[11, k] * distance) / distance**4
        near.loudness[place], near.ahead[place] = decay, near.ahead[place] / distance
        cosine, sine = numbers[9, k], numbers[10, k]
        near.off[place] = atan2_32(cosine * y - sine * x, cosine * x + sine * y)
    return count


@inlined
def _add_said(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    looks: Looks,
    field: Field,
    left: NDArray[np.uint8],
    listening: Listening,
    silence: NDArray[np.float32],
    classes: NDArray[np.int32],
    count: int,
    near: _Nearby,
    said: NDArray[np.float32],
) -> None:
    """Add what pings say of surfaces in a cell, by direction of view and orientation."""
    one, clutter, open_m = np.float32(1.0), np.float32(CLUTTER), OPEN_CELLS * field.resolution_m
    for place in range(count):
        index = near.number[near.which[place]]
        ping, distance, off = near.ping[near.which[place]], near.distance[place], near.off[place]
        b = int((distance - looks.numbers[ping, 9]) / looks.numbers[ping, 13])
        if b >= looks.bins[ping]:
            continue
        entry = int((1.0 - near.ahead[place]) / (1.0 - looks.numbers[ping, 8]) * GAIN_STEPS)
        gain = looks.power_gain[ping, min(max(entry, 0), GAIN_STEPS)]
        loudness = gain * near.loudness[place] / listening.limit[index, b]
        if loudness <= LEAST_LOUDNESS:
            continue
        half = looks.numbers[ping, 7]
        ray = min(max(int((off + half) * RAYS / (2.0 * half)), 0), RAYS - 1)
        step = int((distance - open_m) * STEPS / looks.numbers[ping, GREATEST_RANGE])
        sound = left[index, ray, min(max(step, 0), STEPS - 1)] * np.float32(1.0 / WHOLE)
        if sound < LEAST_SOUND:
            continue
        decibels = np.float32(10.0 / math.log(10.0)) * log32(loudness)
        loud = min(LOUDNESSES - 1, max(0, int((decibels - FIRST_DB) / STEP_DB)))
        share, faint = int(sound * SHARES + 0.5), max(0, loud - FAINTER)
        turns = (off + looks.numbers[ping, 6]) / (2.0 * math.pi)
        turns -= math.floor(turns)
        sector, view = min(int(turns * SECTORS), SECTORS - 1), int(turns * 360.0) % 180
        if not listening.heard[index, b]:
            for orientation in range(ORIENTATIONS):
                incidence = classes[view, orientation]
                said[sector, orientation] += silence[share, loud, 1, incidence]
            said[sector, ORIENTATIONS] += silence[share, faint, 1, 0]
            continue
        chance = max(clutter, listening.chance[index, b])
        for orientation in range(ORIENTATIONS):
            silent = silence[share, loud, 0, classes[view, orientation]] * (one - chance)
            said[sector, orientation] += log32((one - silent) / chance)
        silent = silence[share, faint, 0, 0] * (one - chance)
        said[sector, ORIENTATIONS] += log32((one - silent) / chance)


@inlined
def _put_least_refuted(
    said: NDArray[np.float32], kinds: FloatArray, worst: NDArray[np.float32]
) -> None:
    """Set what is said of the kind of each group that is refuted least, by bounded sectors."""
    most = np.float32(MOST_A_SECTOR)
    worst[:] = np.float32(-1e9)
    for kind in range(KINDS):
        total, group = np.float32(kinds[kind, 1]), int(kinds[kind, 2])
        for sector in range(SECTORS):
            total += max(-most, min(most, said[sector, kind]))
        worst[group] = max(worst[group], total)


@compiled
def prove_open(  # noqa: C901, PLR0913, PLR0917 - a kernel is one loop over arrays
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
