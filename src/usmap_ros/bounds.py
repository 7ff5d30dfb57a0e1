"""What the fields of messages may say: bounds that physics and memory set, all in one place.

They are wide: no sensor that works in air is refused.  What they keep out is what would take
gigabytes or minutes, or make numbers that are not finite and stay in a map for ever.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.errors import MalformedMessageError


class Bound(NamedTuple):
    """Least and greatest value of a field, both allowed, and its unit."""

    least: float
    greatest: float
    unit: str = ""


# ---- counts, which set memory and time

#: Samples of a trace: a second at 2 MHz.
MAX_SAMPLES = 2_000_000
#: Samples on a pulse; of raw ones with a carrier the filter that mixes them down is as long, and
#: its table grows with the square.
MAX_PULSE_SAMPLES, MAX_RAW_PULSE_SAMPLES = 100_000, 5_000
#: Echoes of a cone; reconstruction looks for 32, and for 1000 at most.
MAX_ECHOES = 1000
#: Bins of the detection limit, angles of a beam, transducers of an array.
MAX_BINS, MAX_BEAM_ANGLES, MAX_ELEMENTS = 20_000, 1000, 256
#: Characters of a frame's name.
MAX_NAME = 256
#: Cells of the square that one ping reaches: 35 m around in cells of 5 cm.  Fusion keeps some 300
#: bytes of each.
MAX_REACHED_CELLS = 2_000_000
#: Rows and columns of a map: what nav2 takes.
MAX_MAP_SIDE = 32_767
#: Decibels that sound loses in air to the greatest range and back: what is heard at -600 dB is
#: not there, and amplitudes beyond that are no numbers any more.
MAX_LOSS_DB = 600.0

#: Values of the envelope of an echo that resonances shape, and of the grid it is worked out on.
LEAST_PROFILE_POINTS, MAX_PROFILE_POINTS, MAX_PROFILE_GRID = 4, 20_000, 500_000
#: Points that the rough walls of a simulated world scatter from, at some 100 bytes each: 25 km of
#: wall at 40 a metre.
MAX_SCATTERERS = 1_000_000

#: Processes that may be asked for, for each core and in any case.
PROCESSES_PER_CORE, LEAST_PROCESSES = 4, 8

# ---- files: what is packed in few bytes is unpacked no further than this

#: One chunk or message of a recording.
MAX_CHUNK_BYTES = 2**28
#: All of a recording: so many times its size, and so much in any case.
MAX_UNPACKED_RATIO, LEAST_UNPACKED_BYTES = 100, 2**28
#: Records of a chunk that is no larger than so many bytes each on average, and so many in any case.
LEAST_RECORD_BYTES, LEAST_RECORDS = 8, 100_000
#: Steps of SQLite's machine for a byte of a recording, and in any case; a message takes some ten.
MAX_SQLITE_STEPS_PER_BYTE, LEAST_SQLITE_STEPS = 20, 10_000_000
#: All arrays of a map, or of samples that are imported.
MAX_ARRAY_BYTES = 2**30
#: Pixels of a map's image: a square of 290 m in cells of 5 cm.
MAX_PIXELS = 2**25

# ---- values

#: No place on Earth has larger UTM coordinates.
POSITION = Bound(-1e7, 1e7, "m")
HEIGHT = Bound(-1e4, 1e4, "m")
#: Of position (m²) and turn (rad²); drivers state up to 1e9 for what they do not know.
VARIANCE = Bound(0.0, 1e12)
CARRIER = Bound(1.0, 1e7, "Hz")
PULSE_DURATION = Bound(1e-7, 0.2, "s")
#: Below a half, nothing resonates.
QUALITY = Bound(0.5, 1000.0)
#: Of a simulated robot that wanders: it is drawn step by step.
WALK_STEP = Bound(0.001, 60.0, "s")
BEAM_GAIN = Bound(0.0, 100.0)
MIN_RANGE = Bound(0.0, 200.0, "m")
MAX_RANGE = Bound(1e-3, 200.0, "m")
SOUND_SPEED = Bound(1.0, 10_000.0, "m/s")
#: Of air at 1 MHz it is some 160.
ATTENUATION = Bound(0.0, 1000.0, "dB/m")
FLOOR_HEIGHT = Bound(0.0, 1000.0, "m")
FLOOR_REFLECTIVITY = Bound(0.0, 1.0)
SAMPLE_RATE = Bound(1.0, 1e8, "Hz")
START_DELAY = Bound(0.0, 10.0, "s")
#: Of samples, noise and echoes, in whatever unit: counts of a converter are up to 2³¹.
AMPLITUDE = Bound(-1e12, 1e12)
LOUDNESS = Bound(0.0, 1e15)
RANGE = Bound(0.0, 1e3, "m")
RANGE_STD = Bound(0.0, 1e3, "m")
LIMIT_STEP = Bound(1e-4, 200.0, "m")
OBJECT_RISE = Bound(-1e3, 1e3, "m")
RESIDUAL = Bound(0.0, 1e6)


def check(field: str, value: float, bound: Bound) -> None:
    """Refuse a number that is not within its bounds; NaN is in none.

    Raises
    ------
    MalformedMessageError
        Naming the field, its value and the bound.
    """
    if not bound.least <= value <= bound.greatest:
        unit = f" {bound.unit}" if bound.unit else ""
        raise MalformedMessageError(
            field, f"is {value:g}{unit}, must be {bound.least:g} to {bound.greatest:g}"
        )


def check_all(field: str, values: NDArray[np.floating], bound: Bound) -> None:
    """Refuse an array with an entry that is not within its bounds.

    Raises
    ------
    MalformedMessageError
        Naming the field, how many entries are out of bounds, and one of them.
    """
    right = (values >= bound.least) & (values <= bound.greatest)
    if not right.all():
        wrong = ~right
        first = float(np.asarray(values)[wrong].flat[0])
        raise MalformedMessageError(
            field,
            f"has {np.count_nonzero(wrong)} of {values.size} entries that are not within"
            f" {bound.least:g} to {bound.greatest:g}, such as {first:g}",
        )


def check_count(field: str, count: int, greatest: int) -> None:
    """Refuse an array that is longer than what is believed.

    Raises
    ------
    MalformedMessageError
        Naming the field and its length.
    """
    if count > greatest:
        raise MalformedMessageError(field, f"has {count} entries, must be at most {greatest}")


def check_name(field: str, name: str, *, may_be_empty: bool = False) -> None:
    """Refuse a frame's name that is empty or endless.

    Raises
    ------
    MalformedMessageError
        Naming the field.
    """
    if not name and not may_be_empty:
        raise MalformedMessageError(field, "is empty")
    if len(name) > MAX_NAME:
        raise MalformedMessageError(field, f"has {len(name)} characters, at most {MAX_NAME} may be")
