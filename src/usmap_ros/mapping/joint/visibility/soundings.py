"""How pings sound places: how loudly, from where, and how much of the sound gets there."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.visibility.ray_casting import RAYS, STEPS, WHOLE
from usmap_ros.mapping.ping_bins import GAIN_STEPS
from usmap_ros.mapping.ping_table import (
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
    RISE,
    PingTable,
)
from usmap_ros.numerics.compiled import inlined
from usmap_ros.numerics.elementary import atan2_32, exp32, log32

#: Steps of loudness, 3 dB each from -20 dB of what would have been reported.
LOUDNESSES, FIRST_DB, STEP_DB = 24, -20.0, 3.0
#: Upper ends of the classes of incidence, degrees off the normal; the last goes on to 90.
INCIDENCES_DEG = np.array([2.0, 5.0, 10.0, 20.0, 35.0, 50.0, 70.0])
INCIDENCES = len(INCIDENCES_DEG) + 1
#: Sectors of directions of view, each of which is one side.
SECTORS = 12
#: Looks through which so little of the sound gets, or as faint as this, say nothing.
LEAST_SOUND, LEAST_LOUDNESS = 0.03, 0.005


class SoundedPlaces(NamedTuple):
    """Places that are asked for, and those of them that one ping sounds."""

    #: (places,) float32 arrays: where each is, from a place in common, m.
    right: NDArray[np.float32]
    up: NDArray[np.float32]
    #: (places,) int64 array: those that the ping sounds, of the former.
    which: NDArray[np.int64]
    #: (places,) float32 arrays: where the place is from it, how far, and the cosine of its angle
    #: off the axis; power that an object of power 1 would return, over a limit; share of the sound
    #: that gets there.
    x: NDArray[np.float32]
    y: NDArray[np.float32]
    distance: NDArray[np.float32]
    ahead: NDArray[np.float32]
    loudness: NDArray[np.float32]
    sound: NDArray[np.float32]
    #: (places,) int32 arrays: range bin; places in the tables of gains and of rays; class of
    #: loudness; sector and direction of view.
    bin: NDArray[np.int32]
    entry: NDArray[np.int32]
    ray: NDArray[np.int32]
    step: NDArray[np.int32]
    loud: NDArray[np.int32]
    sector: NDArray[np.int32]
    degrees: NDArray[np.int32]


@inlined
def room_for(places: int) -> SoundedPlaces:
    """Room for so many places."""
    return SoundedPlaces(
        np.empty(places, np.float32), np.empty(places, np.float32), np.empty(places, np.int64),
        np.empty(places, np.float32), np.empty(places, np.float32), np.empty(places, np.float32),
        np.empty(places, np.float32), np.empty(places, np.float32), np.empty(places, np.float32),
        np.empty(places, np.int32), np.empty(places, np.int32), np.empty(places, np.int32),
        np.empty(places, np.int32), np.empty(places, np.int32), np.empty(places, np.int32),
        np.empty(places, np.int32),
    )  # fmt: skip


@inlined
def sector_of(turns: np.float32) -> np.int32:
    """Sector of a direction of view, in turns, which must not be negative."""
    return np.int32(turns * np.float32(SECTORS)) % np.int32(SECTORS)


@inlined
def incidence_of(direction_rad: float, normal_rad: float) -> int:
    """Class of the angle between a direction of view and a normal, either way."""
    off = (direction_rad - normal_rad) * 180.0 / math.pi
    off = abs(off - 180.0 * math.floor(off / 180.0 + 0.5))
    for index in range(len(INCIDENCES_DEG)):
        if off < INCIDENCES_DEG[index]:
            return index
    return len(INCIDENCES_DEG)


@inlined
def sound(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    table: PingTable,
    ping: int,
    left: NDArray[np.uint8],
    limit: NDArray[np.float32],
    x_m: float,
    y_m: float,
    open_m: float,
    places: int,
    seen: SoundedPlaces,
) -> int:
    """Set how a ping sounds places; returns how many it does.

    Parameters
    ----------
    table, ping
        The ping.
    left : (RAYS, STEPS) uint8 array
        How much of its sound is left, by
        `usmap_ros.mapping.joint.visibility.ray_casting.cast_rays`.
    limit : (bins,) float32 array
        What loudness is told in units of.
    x_m, y_m : float
        Where the place that those asked for are told from is, from the transducer.
    open_m : float
        Sound must get so near to each.
    places : int
        How many are asked for.
    seen : SoundedPlaces
        Set.
    """
    count = find_in_cone(table, ping, x_m, y_m, places, seen)
    set_views(table, ping, open_m, count, seen)
    return _leave_out_unheard(table, ping, left, limit, count, seen)


@inlined
def find_in_cone(
    table: PingTable, ping: int, x_m: float, y_m: float, places: int, seen: SoundedPlaces
) -> int:
    """Set which places a ping's cone holds, and where; returns how many it does."""
    numbers, count = table.numbers[ping], 0
    x0, y0, axis_x, axis_y = (
        np.float32(x_m), np.float32(y_m), np.float32(numbers[AXIS_X]), np.float32(numbers[AXIS_Y]),
    )  # fmt: skip
    up, risen = np.float32(numbers[AXIS_Z] * numbers[RISE]), np.float32(numbers[RISE] ** 2)
    least, greatest = numbers[LEAST_RANGE], numbers[GREATEST_RANGE]
    cos_half = numbers[COS_HALF_ANGLE]
    wide, nearest = np.float32(cos_half * abs(cos_half)), np.float32(least * least)
    farthest = np.float32(greatest * greatest)
    for place in range(places):
        x, y = x0 + seen.right[place], y0 + seen.up[place]
        squared = x * x + y * y + risen
        ahead = axis_x * x + axis_y * y + up
        seen.which[count], seen.x[count], seen.y[count] = place, x, y
        seen.distance[count], seen.ahead[count] = squared, ahead
        is_inside = (squared > nearest) & (squared < farthest)
        count += is_inside & (ahead * abs(ahead) > squared * wide)
    return count


@inlined
def set_views(table: PingTable, ping: int, open_m: float, count: int, seen: SoundedPlaces) -> None:
    """Set how loudly, and from where, a ping looks at places in its cone."""
    numbers = table.numbers[ping]
    cos_half, heading, half = numbers[COS_HALF_ANGLE], numbers[HEADING], numbers[HALF_ANGLE]
    cosine, sine = np.float32(math.cos(heading)), np.float32(math.sin(heading))
    absorption, one = np.float32(-numbers[ABSORPTION]), np.float32(1.0)
    least, per_bin = np.float32(numbers[LEAST_RANGE]), np.float32(1.0 / numbers[BIN_M])
    to_entry, to_ray = np.float32(GAIN_STEPS / (1.0 - cos_half)), np.float32(0.5 * RAYS / half)
    edge, before = np.float32(half), np.float32(open_m)
    to_step = np.float32(STEPS / numbers[GREATEST_RANGE])
    # A whole one more, so that no direction in the beam is negative.
    turns = np.float32(heading / (2.0 * math.pi) - math.floor(heading / (2.0 * math.pi)) + 1.0)
    to_turns = np.float32(0.5 / math.pi)
    # Of numbers of 32 bits the processor takes as many at once as it can.
    for place in range(count):
        x, y, squared = seen.x[place], seen.y[place], seen.distance[place]
        distance = np.sqrt(squared)
        seen.loudness[place] = exp32(absorption * distance) / (squared * squared)
        off = atan2_32(cosine * y - sine * x, cosine * x + sine * y)
        seen.bin[place] = np.int32((distance - least) * per_bin)
        entry = np.int32((one - seen.ahead[place] / distance) * to_entry)
        seen.entry[place] = min(max(entry, np.int32(0)), np.int32(GAIN_STEPS))
        ray = np.int32((off + edge) * to_ray)
        seen.ray[place] = min(max(ray, np.int32(0)), np.int32(RAYS - 1))
        step = np.int32((distance - before) * to_step)
        seen.step[place] = min(max(step, np.int32(0)), np.int32(STEPS - 1))
        direction = off * to_turns + turns
        seen.sector[place] = sector_of(direction)
        seen.degrees[place] = np.int32(direction * np.float32(360.0)) % np.int32(180)


@inlined
def _leave_out_unheard(
    table: PingTable,
    ping: int,
    left: NDArray[np.uint8],
    limit: NDArray[np.float32],
    count: int,
    seen: SoundedPlaces,
) -> int:
    """Leave out the places of which a ping would hear nothing; returns how many are left."""
    bins, gains, kept = table.bins[ping], table.power_gain[ping], 0
    last = np.int32(bins - 1)
    for place in range(count):
        # Places without a sign need not be compared with zero.
        loudness = gains[np.uint32(seen.entry[place])] * seen.loudness[place]
        seen.loudness[place] = loudness / limit[np.uint32(min(seen.bin[place], last))]
        sound = np.float32(left[np.uint32(seen.ray[place]), np.uint32(seen.step[place])])
        seen.sound[place] = sound * np.float32(1.0 / WHOLE)
    for place in range(count):
        b, loudness, sound = seen.bin[place], seen.loudness[place], seen.sound[place]
        seen.which[kept], seen.bin[kept] = seen.which[place], b
        seen.sector[kept], seen.degrees[kept] = seen.sector[place], seen.degrees[place]
        seen.loudness[kept], seen.sound[kept] = loudness, sound
        is_heard = (loudness > np.float32(LEAST_LOUDNESS)) & (sound >= np.float32(LEAST_SOUND))
        kept += is_heard & (b < bins)
    for place in range(kept):
        seen.loud[place] = class_of(seen.loudness[place])
    return kept


@inlined
def class_of(loudness: np.float32) -> np.int32:
    """Class of a loudness."""
    per_step = np.float32(10.0 / math.log(10.0) / STEP_DB)
    loud = np.int32(per_step * log32(loudness) - np.float32(FIRST_DB / STEP_DB))
    return min(max(loud, np.int32(0)), np.int32(LOUDNESSES - 1))
