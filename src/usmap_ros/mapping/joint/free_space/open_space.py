"""Free space: cells in which no surface can stand, however it might face.

A cell is free if sound came back through it, if a robot stood there, or if silence refutes every
way in which a surface could face there.  Silence counts as this place answers, by direction of
view: looks from one side repeat each other as far as surfaces here differ (`overdispersion`).
"""

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.free_space.blocks import (
    BLOCK,
    OPEN_CELLS,
    find_near,
    find_wanted,
    middle_of,
)
from usmap_ros.mapping.joint.free_space.kinds import (
    KINDS,
    MIRRORS,
    ORIENTATIONS,
    ROUND,
    SHARES,
    distinct_ways,
    incidence_classes,
    silence_by_share,
    struck_squarely,
)
from usmap_ros.mapping.joint.free_space.response import HeardBins
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.visibility.soundings import (
    SECTORS,
    SoundedPlaces,
    room_for,
    sound,
)
from usmap_ros.mapping.ping_table import PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled, inlined
from usmap_ros.numerics.elementary import log32

#: The most that echoes from one sector say for a surface, and for a mirror, of which no other
#: sector can say that they are of something else; and chance of an echo from nowhere.
MOST_A_SECTOR, MOST_OF_A_MIRROR, CLUTTER = 2.4, 0.2, 0.05


@compiled
def refute_surfaces(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    table: PingTable,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    listening: HeardBins,
    log_silent: FloatArray,
    shape: float,
    kinds: FloatArray,
    likelier: NDArray[np.float32],
    scatters: BoolArray,
    wanted: BoolArray,
    changed: NDArray[np.uint8],
    worst: NDArray[np.float32],
) -> None:
    """Log-likelihood ratio of what was heard, with a surface to without, by the worst kind.

    Parameters
    ----------
    table, pings, field, left, listening
        The pings, and what they heard.
    log_silent : (LOUDNESSES, INCIDENCES) array
        Logarithm of P(silent | surface).
    shape : float
        How far looks from one side repeat each other, by `overdispersion.learn_shape`.
    kinds : (KINDS, 3) array
        By `usmap_ros.mapping.joint.free_space.usual_directions.log_priors`.
    likelier : (rows, columns) float32 array
        Logarithm of how much more often those of the group of mirrors are found in each cell.
    scatters : (rows, columns) bool array
        Cells that echoes may well be of; those elsewhere are taken for what is likely to return
        them, shown or not.
    wanted : (rows, columns) bool array
        Cells that are asked for.
    changed : (pings, RAYS) uint8 array
        From which step on something else is left of the sound along each ray than the last time, by
        `usmap_ros.mapping.joint.visibility.ray_casting.changed_from`.
    worst : (rows, columns, GROUPS) float32 array
        Of the kind of each group that is refuted least, 0 where nothing is known; set where it
        changes.
    """
    size = BLOCK * BLOCK
    said, is_said = (
        np.empty((size, SECTORS, KINDS), np.float32),
        np.empty((size, SECTORS), np.bool_),
    )
    total, most = np.empty(KINDS, np.float32), _most()
    classes, silence = incidence_classes(kinds), silence_by_share(log_silent)
    struck, ways = struck_squarely(classes), distinct_ways(log_silent)
    near, asked, seen = np.empty(len(pings), np.int64), np.empty(size, np.int64), room_for(size)
    own = np.empty(size, np.bool_)
    open_m = OPEN_CELLS * field.resolution_m
    for bottom in range(0, field.rows, BLOCK):
        for start in range(0, field.columns, BLOCK):
            cells = find_wanted(wanted, bottom, start, field.resolution_m, asked, seen)
            if not cells:
                continue
            around, is_new = find_near(table, pings, field, bottom, start, changed, near)
            if not is_new:
                continue
            middle_x, middle_y = middle_of(field, bottom, start)
            is_said[:cells] = False
            for place in range(cells):
                up, right = divmod(asked[place], BLOCK)
                own[place] = scatters[bottom + up, start + right]
            for place in range(around):
                index = near[place]
                # From the middle of the block, so that little is lost in single precision.
                x_m = middle_x - table.numbers[pings[index], X]
                y_m = middle_y - table.numbers[pings[index], Y]
                count = sound(
                    table, pings[index], left[index], listening.limit[index], x_m, y_m, open_m,
                    cells, seen,
                )  # fmt: skip
                _begin_said(count, seen, is_said, said)
                _add_said(index, listening, silence, classes, struck, ways, count, seen, own, said)
            for place in range(cells):
                up, right = divmod(asked[place], BLOCK)
                least = worst[bottom + up, start + right]
                _put_least_refuted(
                    said[place], is_said[place], ways, np.float32(shape), kinds, most, total, least
                )
                least[MIRRORS] += likelier[bottom + up, start + right]


@inlined
def _most() -> NDArray[np.float32]:
    """The most that echoes from one sector say for each kind."""
    most = np.full(KINDS, MOST_A_SECTOR, np.float32)
    most[ORIENTATIONS:ROUND] = MOST_OF_A_MIRROR
    return most


@inlined
def _begin_said(
    count: int, seen: SoundedPlaces, is_said: BoolArray, said: NDArray[np.float32]
) -> None:
    """Set to nothing what is said of places from sectors from which nobody has sounded them yet."""
    for place in range(count):
        cell, sector = seen.which[place], seen.sector[place]
        if not is_said[cell, sector]:
            is_said[cell, sector] = True
            for kind in range(KINDS):
                said[cell, sector, kind] = 0.0


@inlined
def _add_said(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    index: int,
    listening: HeardBins,
    silence: NDArray[np.float32],
    classes: NDArray[np.int32],
    struck: NDArray[np.int32],
    ways: int,
    count: int,
    seen: SoundedPlaces,
    own: BoolArray,
    said: NDArray[np.float32],
) -> None:
    """Add what a ping says of surfaces in cells, by direction of view and orientation."""
    one, clutter = np.float32(1.0), np.float32(CLUTTER)
    for place in range(count):
        # Places without a sign need not be compared with zero.
        cell, b, sector, view = (
            np.uint64(seen.which[place]), np.uint64(seen.bin[place]),
            np.uint64(seen.sector[place]), np.uint64(seen.degrees[place]),
        )  # fmt: skip
        share, loud = np.uint64(seen.sound[place] * SHARES + 0.5), np.uint64(seen.loud[place])
        faint = np.uint64(max(0, seen.loud[place] - listening.fainter[index]))
        if not listening.heard[index, b]:
            for way in range(ways):
                said[cell, sector, way] += silence[share, loud, 1, classes[view, way]]
            for way in struck[view]:
                if way >= 0:
                    square = silence[share, loud, 1, classes[view, way]]
                    said[cell, sector, ORIENTATIONS + way] += square
            said[cell, sector, ROUND] += silence[share, faint, 1, 0]
            continue
        chance = max(
            clutter, listening.chance[index, b] if own[cell] else listening.likely[index, b]
        )
        for way in range(ways):
            silent = silence[share, loud, 0, classes[view, way]] * (one - chance)
            said[cell, sector, way] += log32((one - silent) / chance)
        for way in struck[view]:
            if way >= 0:
                silent = silence[share, loud, 0, classes[view, way]] * (one - chance)
                said[cell, sector, ORIENTATIONS + way] += log32((one - silent) / chance)
        silent = silence[share, faint, 0, 0] * (one - chance)
        said[cell, sector, ROUND] += log32((one - silent) / chance)


@inlined
def _put_least_refuted(
    said: NDArray[np.float32],
    is_said: BoolArray,
    ways: int,
    shape: np.float32,
    kinds: FloatArray,
    most: NDArray[np.float32],
    total: NDArray[np.float32],
    worst: NDArray[np.float32],
) -> None:
    """Set what all sectors together say of the kind of each group that is refuted least."""
    none, one = np.float32(0.0), np.float32(1.0)
    for kind in range(KINDS):
        total[kind] = kinds[kind, 1]
    for sector in range(SECTORS):
        if not is_said[sector]:
            continue
        for way in range(ways, ORIENTATIONS):
            said[sector, way] = said[sector, 0]
        # In one row, so that the compiler works out several at once.
        for kind in range(KINDS):
            silence = max(none, -said[sector, kind])
            echoes = max(none, min(most[kind], said[sector, kind]))
            total[kind] += echoes - shape * log32(one + silence / shape)
    worst[:] = np.float32(-1e9)
    for kind in range(KINDS):
        group = int(kinds[kind, 2])
        worst[group] = max(worst[group], total[kind])
