"""What is said no more once less of the sound gets there: the most of it, which costs little.

What is free holds no sound back, and what is not may; so less of it gets to some cells than was
taken for granted when they were refuted.  Most would be refuted without all pings for which that
is so, and these alone need to be looked at to tell which.
"""

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.free_space.blocks import (
    BLOCK,
    OPEN_CELLS,
    find_wanted,
    is_other,
    may_sound,
    middle_of,
)
from usmap_ros.mapping.joint.free_space.kinds import SHARES, silence_by_share
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.visibility.ray_casting import WHOLE
from usmap_ros.mapping.joint.visibility.soundings import (
    LEAST_LOUDNESS,
    LEAST_SOUND,
    LOUDNESSES,
    SoundedPlaces,
    class_of,
    find_in_cone,
    room_for,
    set_views,
)
from usmap_ros.mapping.ping_table import PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled, inlined

#: By how much what is said may rise where echoes may say more: compiled loops know no infinity.
UNKNOWN = 1e9


@compiled
def add_unsaid(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    table: PingTable,
    pings: NDArray[np.int64],
    field: Field,
    before: NDArray[np.uint8],
    left: NDArray[np.uint8],
    limit: NDArray[np.float32],
    log_silent: FloatArray,
    wanted: BoolArray,
    changed: NDArray[np.uint8],
    unsaid: NDArray[np.float32],
) -> None:
    """By how much log-likelihood ratios of surfaces rise at the most, as less sound gets to them.

    Silence of looks from one side says the less the more of them there are, and none more than it
    does alone; what was heard says less, too, if less of the sound gets there.

    Parameters
    ----------
    table, pings, field, log_silent, wanted, changed
        As of `usmap_ros.mapping.joint.free_space.open_space.refute_surfaces`.
    before, left : (pings, RAYS, STEPS) uint8 arrays
        How much of the sound was left when cells were asked for last, and is left now.
    limit : (pings, bins) float32 array
        What loudness is told in units of.
    unsaid : (rows, columns) float32 array
        Added to; `UNKNOWN` and more where more of the sound gets.
    """
    size = BLOCK * BLOCK
    asked, seen, says = np.empty(size, np.int64), room_for(size), _says(log_silent)
    open_m = OPEN_CELLS * field.resolution_m
    for bottom in range(0, field.rows, BLOCK):
        for start in range(0, field.columns, BLOCK):
            cells = find_wanted(wanted, bottom, start, field.resolution_m, asked, seen)
            if not cells:
                continue
            middle_x, middle_y = middle_of(field, bottom, start)
            for index in range(len(pings)):
                ping, numbers = pings[index], table.numbers[pings[index]]
                x_m, y_m = middle_x - numbers[X], middle_y - numbers[Y]
                if not may_sound(numbers, x_m, y_m, field.resolution_m):
                    continue
                if not is_other(table, ping, changed[index], x_m, y_m, field):
                    continue
                count = find_in_cone(table, ping, x_m, y_m, cells, seen)
                set_views(table, ping, open_m, count, seen)
                for place in range(count):
                    up, right = divmod(asked[seen.which[place]], BLOCK)
                    unsaid[bottom + up, start + right] += _unsaid(
                        table, ping, before[index], left[index], limit[index], place, seen, says
                    )


@inlined
def _says(log_silent: FloatArray) -> NDArray[np.float32]:
    """The most that silence says of any kind of surface, by share of sound, and by loudness."""
    says, silence = np.zeros((SHARES + 1, LOUDNESSES), np.float32), silence_by_share(log_silent)
    for share in range(SHARES + 1):
        for loud in range(LOUDNESSES):
            # Fainter kinds answer as others do at less loudness.
            before = says[share, max(loud - 1, 0)]
            says[share, loud] = max(before, -silence[share, loud, 1].min())
    return says


@inlined
def _unsaid(
    table: PingTable,
    ping: int,
    before: NDArray[np.uint8],
    left: NDArray[np.uint8],
    limit: NDArray[np.float32],
    place: int,
    seen: SoundedPlaces,
    says: NDArray[np.float32],
) -> np.float32:
    """The most that a ping says no more of a place in its cone."""
    ray, step, b = seen.ray[place], seen.step[place], seen.bin[place]
    was, now = before[ray, step], left[ray, step]
    if was == now or b >= table.bins[ping]:
        return np.float32(0.0)
    if now > was:
        return np.float32(UNKNOWN)
    loudness = table.power_gain[ping, seen.entry[place]] * seen.loudness[place] / limit[b]
    if loudness <= np.float32(LEAST_LOUDNESS):
        return np.float32(0.0)
    loud = class_of(loudness)
    difference: np.float32 = says[_share(was), loud] - says[_share(now), loud]
    return difference


@inlined
def _share(sound: np.uint8) -> int:
    """Step of the share of sound that gets to a place; so little that it says nothing is none."""
    share = np.float32(sound) * np.float32(1.0 / WHOLE)
    return int(share * SHARES + np.float32(0.5)) if share >= np.float32(LEAST_SOUND) else 0
