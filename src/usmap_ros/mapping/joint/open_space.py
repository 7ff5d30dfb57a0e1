"""Free space: cells in which no surface can stand, however it might face.

A cell is free if sound came back through it, if a robot stood there, or if silence refutes every
way in which a surface could face there.  Silence counts as this place answers, by direction of
view: looks from one side repeat each other as far as surfaces here differ (`overdispersion`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.beams import is_beside
from usmap_ros.mapping.joint.field import (
    ABSORPTION,
    AXIS_X,
    AXIS_Y,
    AXIS_Z,
    BIN_M,
    COS_HALF_ANGLE,
    GREATEST_RANGE,
    HALF_ANGLE,
    HEADING,
    LEAST_RANGE,
    QUARTERS,
    RISE,
    Field,
    X,
    Y,
)
from usmap_ros.mapping.joint.overdispersion import SECTORS, sector_of
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

#: Orientations that a surface may have.
ORIENTATIONS = 16
#: Kinds of surfaces that are asked for: of each orientation, and round ones, which answer every
#: view as flat ones answer a square one, but fainter by so many steps of loudness.
KINDS, FAINTER = ORIENTATIONS + 1, 4
#: Groups of kinds: walls along and across the usual direction, and all others.
GROUPS, ALONG, ACROSS, OTHERS = 3, 0, 1, 2
#: The most that echoes from one sector say for a surface, and chance of an echo from nowhere.
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


class _Seen(NamedTuple):
    """Cells of a block that are asked for, and those of them that one ping sounds.

    Parameters
    ----------
    cell : (cells,) int64 array
        Place in the block of each that is asked for.
    right, up : (cells,) float32 arrays
        Where each is, from the middle of the block, m.
    which : (cells,) int64 array
        Those that the ping sounds, of the former.
    x, y, distance, ahead, loudness, sound : (cells,) float32 arrays
        Where the cell is from it, how far, and the cosine of its angle off the axis; power that an
        object of power 1 would return, over what would have been reported; share of the sound that
        gets there.
    bin, entry, ray, step, loud, share, sector, degrees : (cells,) int32 arrays
        Range bin; places in the tables of gains and of rays; classes of loudness and of the share
        of the sound; sector and direction of view.
    """

    cell: NDArray[np.int64]
    right: NDArray[np.float32]
    up: NDArray[np.float32]
    which: NDArray[np.int64]
    x: NDArray[np.float32]
    y: NDArray[np.float32]
    distance: NDArray[np.float32]
    ahead: NDArray[np.float32]
    loudness: NDArray[np.float32]
    sound: NDArray[np.float32]
    bin: NDArray[np.int32]
    entry: NDArray[np.int32]
    ray: NDArray[np.int32]
    step: NDArray[np.int32]
    loud: NDArray[np.int32]
    share: NDArray[np.int32]
    sector: NDArray[np.int32]
    degrees: NDArray[np.int32]


@compiled
def refute_surfaces(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    looks: Looks,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    listening: Listening,
    log_silent: FloatArray,
    shape: float,
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
    shape : float
        How far looks from one side repeat each other, by `overdispersion.learn_shape`.
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
    size = BLOCK * BLOCK
    said = np.empty((size, SECTORS, KINDS), np.float32)
    classes, silence, ways = _classes(kinds), _silence(log_silent), _ways(log_silent)
    near = np.empty(len(pings), np.int64)
    seen = _Seen(
        np.empty(size, np.int64), np.empty(size, np.float32), np.empty(size, np.float32),
        np.empty(size, np.int64),
        np.empty(size, np.float32), np.empty(size, np.float32), np.empty(size, np.float32),
        np.empty(size, np.float32), np.empty(size, np.float32), np.empty(size, np.float32),
        np.empty(size, np.int32), np.empty(size, np.int32), np.empty(size, np.int32),
        np.empty(size, np.int32), np.empty(size, np.int32), np.empty(size, np.int32),
        np.empty(size, np.int32), np.empty(size, np.int32),
    )  # fmt: skip
    for bottom in range(0, field.rows, BLOCK):
        for start in range(0, field.columns, BLOCK):
            cells = _find_wanted(wanted, bottom, start, field.resolution_m, seen)
            if not cells:
                continue
            around, is_new = _find_near(looks, pings, field, bottom, start, changed, near)
            if not is_new:
                continue
            middle_x = (field.first_column + start + 0.5 * BLOCK) * field.resolution_m
            middle_y = (field.first_row + bottom + 0.5 * BLOCK) * field.resolution_m
            said[:cells] = 0.0
            for place in range(around):
                index = near[place]
                # From the middle of the block, so that little is lost in single precision.
                x_m = middle_x - looks.numbers[pings[index], X]
                y_m = middle_y - looks.numbers[pings[index], Y]
                count = _sound(looks, pings[index], field.resolution_m, x_m, y_m, cells, seen)
                count = _hear(looks, pings[index], left[index], listening.limit[index], count, seen)
                _add_said(index, listening, silence, classes, ways, count, seen, said)
            for place in range(cells):
                up, right = divmod(seen.cell[place], BLOCK)
                least = worst[bottom + up, start + right]
                _put_least_refuted(said[place], ways, np.float32(shape), kinds, least)


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
def _ways(log_silent: FloatArray) -> int:
    """How many orientations differ: what answers alike at any incidence has only one."""
    for loud in range(log_silent.shape[0]):
        for incidence in range(1, INCIDENCES):
            if log_silent[loud, incidence] != log_silent[loud, 0]:
                return ORIENTATIONS
    return 1


@inlined
def _find_wanted(
    wanted: BoolArray, bottom: int, start: int, resolution_m: float, seen: _Seen
) -> int:
    """Set the cells of a block that are asked for; returns how many there are."""
    cells = 0
    for row in range(bottom, min(bottom + BLOCK, wanted.shape[0])):
        for column in range(start, min(start + BLOCK, wanted.shape[1])):
            if wanted[row, column]:
                seen.cell[cells] = (row - bottom) * BLOCK + column - start
                seen.right[cells] = (column - start + 0.5 - 0.5 * BLOCK) * resolution_m
                seen.up[cells] = (row - bottom + 0.5 - 0.5 * BLOCK) * resolution_m
                cells += 1
    return cells


@inlined
def _find_near(
    looks: Looks,
    pings: NDArray[np.int64],
    field: Field,
    bottom: int,
    start: int,
    changed: BoolArray,
    near: NDArray[np.int64],
) -> tuple[int, bool]:
    """Set the pings that may sound a block; returns how many there are, and if any has changed."""
    count, radius, is_new = 0, 0.75 * BLOCK * field.resolution_m, False
    middle_x = (field.first_column + start + 0.5 * BLOCK) * field.resolution_m
    middle_y = (field.first_row + bottom + 0.5 * BLOCK) * field.resolution_m
    for index in range(len(pings)):
        numbers = looks.numbers[pings[index]]
        x, y = middle_x - numbers[X], middle_y - numbers[Y]
        far = numbers[GREATEST_RANGE] + radius
        if x * x + y * y >= far * far or is_beside(numbers, x, y, radius):
            continue
        near[count] = index
        is_new = is_new or changed[index]
        count += 1
    return count, is_new


@inlined
def _sound(
    looks: Looks, ping: int, resolution_m: float, x_m: float, y_m: float, cells: int, seen: _Seen
) -> int:
    """Set how a ping sounds cells; returns how many it does.  The same as `response.sounded`."""
    numbers, count = looks.numbers[ping], 0
    x0, y0, axis_x, axis_y = (
        np.float32(x_m), np.float32(y_m), np.float32(numbers[AXIS_X]), np.float32(numbers[AXIS_Y]),
    )  # fmt: skip
    up, risen = np.float32(numbers[AXIS_Z] * numbers[RISE]), np.float32(numbers[RISE] ** 2)
    least, greatest = numbers[LEAST_RANGE], numbers[GREATEST_RANGE]
    cos_half, heading, half = numbers[COS_HALF_ANGLE], numbers[HEADING], numbers[HALF_ANGLE]
    wide, nearest = np.float32(cos_half * abs(cos_half)), np.float32(least * least)
    farthest = np.float32(greatest * greatest)
    for place in range(cells):
        x, y = x0 + seen.right[place], y0 + seen.up[place]
        squared = x * x + y * y + risen
        ahead = axis_x * x + axis_y * y + up
        seen.which[count], seen.x[count], seen.y[count] = place, x, y
        seen.distance[count], seen.ahead[count] = squared, ahead
        is_inside = (squared > nearest) & (squared < farthest)
        count += is_inside & (ahead * abs(ahead) > squared * wide)
    cosine, sine = np.float32(math.cos(heading)), np.float32(math.sin(heading))
    absorption = np.float32(-numbers[ABSORPTION])
    open_m, per_bin = OPEN_CELLS * resolution_m, 1.0 / numbers[BIN_M]
    to_entry, to_ray = GAIN_STEPS / (1.0 - cos_half), RAYS / (2.0 * half)
    to_step = STEPS / greatest
    for place in range(count):
        x, y, distance = seen.x[place], seen.y[place], np.sqrt(seen.distance[place])
        seen.loudness[place] = exp32(absorption * distance) / distance**4
        off = atan2_32(cosine * y - sine * x, cosine * x + sine * y)
        seen.bin[place] = int((distance - least) * per_bin)
        entry = int((1.0 - seen.ahead[place] / distance) * to_entry)
        seen.entry[place] = min(max(entry, 0), GAIN_STEPS)
        seen.ray[place] = min(max(int((off + half) * to_ray), 0), RAYS - 1)
        seen.step[place] = min(max(int((distance - open_m) * to_step), 0), STEPS - 1)
        seen.sector[place] = sector_of(off + heading)
        seen.degrees[place] = math.floor((off + heading) * 180.0 / math.pi) % 180
    return count


@inlined
def _hear(
    looks: Looks,
    ping: int,
    left: NDArray[np.uint8],
    limit: NDArray[np.float32],
    count: int,
    seen: _Seen,
) -> int:
    """Leave out the cells of which a ping would hear nothing; returns how many are left."""
    bins, kept = looks.bins[ping], 0
    for place in range(count):
        b = seen.bin[place]
        if b >= bins:
            continue
        loudness = looks.power_gain[ping, seen.entry[place]] * seen.loudness[place] / limit[b]
        sound = left[seen.ray[place], seen.step[place]] * np.float32(1.0 / WHOLE)
        seen.which[kept], seen.bin[kept] = seen.which[place], b
        seen.sector[kept], seen.degrees[kept] = seen.sector[place], seen.degrees[place]
        seen.loudness[kept], seen.sound[kept] = loudness, sound
        kept += (loudness > np.float32(LEAST_LOUDNESS)) & (sound >= np.float32(LEAST_SOUND))
    for place in range(kept):
        decibels = np.float32(10.0 / math.log(10.0)) * log32(seen.loudness[place])
        loud = int((decibels - FIRST_DB) / STEP_DB)
        seen.loud[place] = min(LOUDNESSES - 1, max(0, loud))
        seen.share[place] = int(seen.sound[place] * SHARES + 0.5)
    return kept


@inlined
def _add_said(
    index: int,
    listening: Listening,
    silence: NDArray[np.float32],
    classes: NDArray[np.int32],
    ways: int,
    count: int,
    seen: _Seen,
    said: NDArray[np.float32],
) -> None:
    """Add what a ping says of surfaces in cells, by direction of view and orientation."""
    one, clutter = np.float32(1.0), np.float32(CLUTTER)
    for place in range(count):
        cell, b, sector, view = (
            seen.which[place], seen.bin[place], seen.sector[place], seen.degrees[place],
        )  # fmt: skip
        share, loud = seen.share[place], seen.loud[place]
        faint = max(0, loud - FAINTER)
        if not listening.heard[index, b]:
            for way in range(ways):
                said[cell, sector, way] += silence[share, loud, 1, classes[view, way]]
            said[cell, sector, ORIENTATIONS] += silence[share, faint, 1, 0]
            continue
        chance = max(clutter, listening.chance[index, b])
        for way in range(ways):
            silent = silence[share, loud, 0, classes[view, way]] * (one - chance)
            said[cell, sector, way] += log32((one - silent) / chance)
        silent = silence[share, faint, 0, 0] * (one - chance)
        said[cell, sector, ORIENTATIONS] += log32((one - silent) / chance)


@inlined
def _put_least_refuted(
    said: NDArray[np.float32],
    ways: int,
    shape: np.float32,
    kinds: FloatArray,
    worst: NDArray[np.float32],
) -> None:
    """Set what all sectors together say of the kind of each group that is refuted least."""
    none, one, most = np.float32(0.0), np.float32(1.0), np.float32(MOST_A_SECTOR)
    worst[:] = np.float32(-1e9)
    for kind in range(KINDS):
        total, group = np.float32(kinds[kind, 1]), int(kinds[kind, 2])
        way = kind if kind == ORIENTATIONS else min(kind, ways - 1)
        for sector in range(SECTORS):
            silence = max(none, -said[sector, way])
            total += max(none, min(most, said[sector, way])) - shape * log32(one + silence / shape)
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
