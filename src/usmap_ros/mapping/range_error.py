"""What is wrong with all ranges: they are found in focus, as of a synthetic aperture.

Who takes sound for faster than it is hears everything farther away than it is: by 2 % where it is
12 degrees colder than was thought.  Whose trace begins later than the ping, or who waits until an
echo is loud, hears everything by the same way farther.  Each echo may have come from anywhere on an
arc.  Arcs of pings from several places meet where something stands if ranges are right, and else
miss each other.  So that error is taken without which arcs meet best, as radar images are focused
by their contrast (Berizzi & Corsini, IEEE Transactions on Aerospace and Electronic Systems, 1996),
if the pings of each robot, and of all of them at different times, say so.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.compiled import compiled
from usmap_ros.pings.cone import BY_ECHO, EchoCone
from usmap_ros.pings.telling_echoes import first_and_loudest, levels_db
from usmap_ros.processes.threads import for_each


class RangeError(NamedTuple):
    """What is wrong with all ranges."""

    #: What they are to be multiplied by.
    scale: float = 1.0
    #: By how much less they are then, m.
    late_m: float = 0.0

    @property
    def is_any(self) -> bool:
        """Whether anything is wrong."""
        return self != NO_ERROR

    @property
    def reason(self) -> str:
        """What is to be said of it."""
        if self.late_m:
            return f"all ranges are {100.0 * self.late_m:.0f} cm too long: they are told late"
        off = 1.0 / self.scale - 1.0
        how = "long: sound is slower" if off > 0.0 else "short: sound is faster"
        return f"all ranges are {abs(off):.1%} too {how} than was stated"


NO_ERROR = RangeError()
#: What is tried: scales and ways, of which the greatest and the least are no answers.  No ranges
#: are told early, as those of round columns seem to be, which answer from before their middles.
SCALES = [RangeError(scale=round(0.93 + 0.01 * step, 2)) for step in range(15)]
DELAYS = [RangeError(late_m=round(0.02 * step, 2)) for step in range(11)]
#: What is tried first: where nothing else is better, nothing is wrong.
AT_FIRST = [NO_ERROR, SCALES[5], SCALES[9], DELAYS[2]]
#: Side of the cells in which arcs meet, m.
CELL_M = 0.035
#: One ping of each sensor from places and headings that are so far apart, and so many of all of
#: them at the most.
APART_M, APART_RAD, MOST_PINGS = 0.15, 0.35, 400
#: Where robots are so far apart, m, the square of such a side counts in which most pings are.
SQUARE_M = 20.0
#: Share of a beam's half angle from which something can be heard well.
BEAM_SHARE = 0.9
#: Errors, of scale and m, below which maps are as good; pings that are needed to tell of one, and
#: of each robot.
LEAST_SCALE, LEAST_LATE_M, LEAST_PINGS, LEAST_OF_ONE = 0.0125, 0.03, 100, 20
#: What an echo gains on the mean, in the logarithm of how many arcs meet; and over how many times
#: its standard error, by so many parts of all pings.  In 200 recordings without such an error, of
#: eighteen kinds of scenes, none gained as much.  By its own echoes no robot may lose as much.
LEAST_GAIN, LEAST_SURENESS, PARTS = 0.03, 4.0, 12


class _Arcs(NamedTuple):
    """Arcs on which echoes may have come from."""

    #: (pings,) arrays: where pings were sent from, and where their beams look and end.
    x_m: FloatArray
    y_m: FloatArray
    yaw_rad: FloatArray
    half_rad: FloatArray
    #: (pings + 1,) integer array: of each ping's echoes, and the end.
    first: NDArray[np.int64]
    #: (echoes,) array.
    range_m: FloatArray


def range_error(pings: Iterable[tuple[EchoCone, str]]) -> RangeError:
    """What is wrong with all ranges, if that is sure.

    Parameters
    ----------
    pings : iterable of (cone, source)
        What was heard, by sensors that report more than the first thing.
    """
    chosen = _from_several_places(pings)
    if len(chosen) < LEAST_PINGS:
        return NO_ERROR
    arcs = _arcs_of([cone for cone, _ in chosen])
    met = _meetings(arcs, AT_FIRST)
    if max(met, key=lambda error: met[error].sum()) == NO_ERROR:
        return NO_ERROR
    met |= _meetings(arcs, [error for error in (*SCALES, *DELAYS) if error not in met])
    tried = max(SCALES, DELAYS, key=lambda errors: max(met[error].sum() for error in errors))
    place = int(np.argmax([met[error].sum() for error in tried]))
    if place in {0, len(tried) - 1}:
        return NO_ERROR
    before, at, behind = (met[error].sum() for error in tried[place - 1 : place + 2])
    beyond = 0.5 * float(before - behind) / float(before - 2.0 * at + behind)
    step = np.subtract(tried[place + 1], tried[place])
    scale, late_m = (round(float(value), 3) for value in tried[place] + beyond * step)
    is_large = abs(scale - 1.0) >= LEAST_SCALE or late_m >= LEAST_LATE_M
    is_sure = is_large and _is_sure(met[tried[place]] - met[NO_ERROR], len(arcs.range_m))
    if is_sure and not _contradicts_one(chosen, tried[place]):
        return RangeError(scale, late_m)
    return NO_ERROR


def without_error(cone: EchoCone, error: RangeError) -> EchoCone:
    """A cone with other ranges; what is then beyond the sensor's greatest range is left out.

    Parameters
    ----------
    cone : EchoCone
        What was heard.
    error : RangeError
        What is wrong with its ranges.
    """
    told_m, least_m = cone.ranges_m.astype(np.float64), cone.transducer.min_range_m
    ranges_m = np.maximum(error.scale * told_m - error.late_m, least_m).astype(np.float32)
    is_within = ranges_m <= np.float32(cone.transducer.max_range_m)
    columns = {name: getattr(cone, name) for name in BY_ECHO} | {"ranges_m": ranges_m}
    echoes: dict[str, Any] = {
        name: column[is_within] for name, column in columns.items() if column is not None
    }
    return replace(cone, **echoes)


def _from_several_places(pings: Iterable[tuple[EchoCone, str]]) -> list[tuple[EchoCone, str]]:
    """Pings with echoes, one from each place, whatever order they came in."""
    apart: dict[tuple[str, int, int, int], tuple[EchoCone, str]] = {}
    heard = [(cone, source) for cone, source in pings if len(cone.ranges_m)]
    for cone, source in sorted(heard, key=lambda ping: (ping[0].stamp_ns, ping[1])):
        x, y = (round(float(place_m) / APART_M) for place_m in cone.pose.position_m[:2])
        heading = round(cone.pose.yaw_rad / APART_RAD)
        apart.setdefault((cone.child_frame_id, x, y, heading), (cone, source))
    chosen = _in_one_square(list(apart.values()))
    if len(chosen) <= MOST_PINGS:
        return chosen
    return [chosen[int(place)] for place in np.linspace(0, len(chosen) - 1, MOST_PINGS)]


def _in_one_square(pings: list[tuple[EchoCone, str]]) -> list[tuple[EchoCone, str]]:
    """Pings from the square in which most are, if not all are so near to each other."""
    places_m = np.array([cone.pose.position_m[:2] for cone, _ in pings], float).reshape(-1, 2)
    if not len(pings) or np.ptp(places_m, axis=0).max() <= SQUARE_M:
        return pings
    squares = np.floor(places_m / SQUARE_M)
    _, which, counts = np.unique(squares, axis=0, return_inverse=True, return_counts=True)
    is_there = which.reshape(-1) == np.argmax(counts)
    return [ping for ping, is_in in zip(pings, is_there.tolist(), strict=True) if is_in]


def _arcs_of(cones: list[EchoCone]) -> _Arcs:
    """Arcs of the echoes that tell most."""
    ranges_m = [cone.ranges_m[first_and_loudest(cone, levels_db(cone))] for cone in cones]
    numbers = np.array(
        [
            (*cone.pose.position_m[:2], cone.pose.yaw_rad, cone.transducer.beam.half_angle_rad)
            for cone in cones
        ]
    )
    x_m, y_m, yaw_rad, half_rad = np.ascontiguousarray(numbers.T, np.float64)
    return _Arcs(
        x_m, y_m, yaw_rad, half_rad,
        np.append(0, np.cumsum([len(own) for own in ranges_m])).astype(np.int64),
        np.concatenate(ranges_m).astype(np.float64),
    )  # fmt: skip


def _meetings(arcs: _Arcs, errors: Sequence[RangeError]) -> dict[RangeError, FloatArray]:
    """For each error, (pings,): logarithms of how many arcs meet on each arc, at most, in sum."""
    reach_m = SCALES[-1].scale * arcs.range_m.max() + CELL_M
    x_m, y_m = arcs.x_m.min() - reach_m, arcs.y_m.min() - reach_m
    shape = (
        int((arcs.y_m.max() + reach_m - y_m) / CELL_M) + 1,
        int((arcs.x_m.max() + reach_m - x_m) / CELL_M) + 1,
    )

    def met(error: RangeError) -> FloatArray:
        ranges_m = np.maximum(error.scale * arcs.range_m - error.late_m, CELL_M)
        meetings: FloatArray = _count_meetings(arcs._replace(range_m=ranges_m), x_m, y_m, shape)
        return meetings

    return dict(zip(errors, for_each(met, errors), strict=True))


@compiled
def _count_meetings(
    arcs: _Arcs, left_m: float, bottom_m: float, shape: tuple[int, int]
) -> FloatArray:
    """See `_meetings`; the corner of the cells, and how many there are."""
    count, last = np.zeros(shape, np.int32), np.full(shape, -1, np.int32)
    total = np.zeros(len(arcs.x_m))
    # First all arcs are drawn, each cell once for each ping, and then looked along.
    for looks in (False, True):
        for ping in range(len(arcs.x_m)):
            half = BEAM_SHARE * arcs.half_rad[ping]
            for echo in range(arcs.first[ping], arcs.first[ping + 1]):
                range_m = arcs.range_m[echo]
                steps, most = int(2.0 * half * range_m / (0.7 * CELL_M)) + 1, 1
                # Each direction is the one before, turned by a step.
                cosine, sine = math.cos(2.0 * half / steps), math.sin(2.0 * half / steps)
                x = range_m * math.cos(arcs.yaw_rad[ping] - half)
                y = range_m * math.sin(arcs.yaw_rad[ping] - half)
                for _ in range(steps + 1):
                    row = int((arcs.y_m[ping] + y - bottom_m) / CELL_M)
                    column = int((arcs.x_m[ping] + x - left_m) / CELL_M)
                    if looks:
                        most = max(most, count[row, column])
                    elif last[row, column] != ping:
                        last[row, column] = ping
                        count[row, column] += 1
                    x, y = x * cosine - y * sine, x * sine + y * cosine
                if looks:
                    total[ping] += math.log(most)
    return total


def _is_sure(gains: FloatArray, echoes: int) -> bool:
    """Whether so much is gained, and at all times."""
    parts = np.array([part.sum() for part in np.array_split(gains, PARTS)])
    sureness = parts.sum() / max(float(parts.std()) * math.sqrt(PARTS), 1e-9)
    return bool(gains.sum() >= LEAST_GAIN * echoes and sureness >= LEAST_SURENESS)


def _contradicts_one(pings: list[tuple[EchoCone, str]], error: RangeError) -> bool:
    """Whether what one of the robots hears speaks against an error that all are to have."""
    own: defaultdict[str, list[EchoCone]] = defaultdict(list)
    for cone, source in pings:
        own[source].append(cone)
    for cones in own.values():
        if len(own) > 1 and len(cones) >= LEAST_OF_ONE:
            arcs = _arcs_of(cones)
            met = _meetings(arcs, [NO_ERROR, error])
            if (met[error] - met[NO_ERROR]).sum() < -LEAST_GAIN * len(arcs.range_m):
                return True
    return False
