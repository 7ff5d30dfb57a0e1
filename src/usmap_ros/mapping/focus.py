"""How well echoes meet: focus, as of a synthetic aperture.

Each echo may have come from anywhere on an arc.  Arcs of pings from several places meet where
something stands if ranges and poses are right, and else miss each other: what is wrong with all of
them is found by that without which arcs meet best, as radar images are focused by their contrast
(Berizzi & Corsini, IEEE Transactions on Aerospace and Electronic Systems, 1996).
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.compiled import compiled
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.telling_echoes import first_and_loudest, levels_db
from usmap_ros.processes.threads import for_each

Candidate = TypeVar("Candidate")
#: A cone, and who heard it.
Ping = tuple[EchoCone, str]
#: Side of the cells in which arcs meet, m, and how they are turned.
CELL_M, ASKEW_RAD = 0.035, 0.37
#: One ping of each sensor from places and headings that are so far apart, and so many of all of
#: them at the most.
APART_M, APART_RAD, MOST_PINGS = 0.15, 0.35, 400
#: Where robots are so far apart, m, the square of such a side counts in which most pings are; and
#: what is heard from within such a range, m.
SQUARE_M, REACH_M = 20.0, 12.0
#: Share of a beam's half angle from which something can be heard well.
BEAM_SHARE = 0.9
#: Pings that are needed to tell of anything, and of each robot.
LEAST_PINGS, LEAST_OF_ONE = 100, 20
#: What an echo gains on the mean, in the logarithm of how many arcs meet; and over how many times
#: its standard error, by so many parts of all pings.  In 200 recordings with nothing wrong, of
#: eighteen kinds of scenes, none gained as much.  By its own echoes no robot may lose as much.
LEAST_GAIN, LEAST_SURENESS, PARTS = 0.03, 4.0, 12


class Arcs(NamedTuple):
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


def from_several_places(pings: Iterable[Ping]) -> list[Ping]:
    """Pings with echoes, one from each place, whatever order they came in."""
    apart: dict[tuple[str, int, int, int], Ping] = {}
    heard = [(cone, source) for cone, source in pings if len(cone.ranges_m)]
    for cone, source in sorted(heard, key=lambda ping: (ping[0].stamp_ns, ping[1])):
        x, y = (round(float(place_m) / APART_M) for place_m in cone.pose.position_m[:2])
        heading = round(cone.pose.yaw_rad / APART_RAD)
        apart.setdefault((cone.child_frame_id, x, y, heading), (cone, source))
    chosen = _in_one_square(list(apart.values()))
    if len(chosen) <= MOST_PINGS:
        return chosen
    return [chosen[int(place)] for place in np.linspace(0, len(chosen) - 1, MOST_PINGS)]


def _in_one_square(pings: list[Ping]) -> list[Ping]:
    """Pings from the square in which most are, if not all are so near to each other."""
    places_m = np.array([cone.pose.position_m[:2] for cone, _ in pings], float).reshape(-1, 2)
    if not len(pings) or np.ptp(places_m, axis=0).max() <= SQUARE_M:
        return pings
    squares = np.floor(places_m / SQUARE_M)
    _, which, counts = np.unique(squares, axis=0, return_inverse=True, return_counts=True)
    is_there = which.reshape(-1) == np.argmax(counts)
    return [ping for ping, is_in in zip(pings, is_there.tolist(), strict=True) if is_in]


def arcs_of(cones: list[EchoCone]) -> Arcs:
    """Arcs of the echoes that tell most."""
    told_m = [cone.ranges_m[first_and_loudest(cone, levels_db(cone))] for cone in cones]
    ranges_m = [own_m[own_m <= REACH_M] for own_m in told_m]
    numbers = np.array(
        [
            (*cone.pose.position_m[:2], cone.pose.yaw_rad, cone.transducer.beam.half_angle_rad)
            for cone in cones
        ]
    )
    x_m, y_m, yaw_rad, half_rad = np.ascontiguousarray(numbers.T, np.float64)
    return Arcs(
        x_m, y_m, yaw_rad, half_rad,
        np.append(0, np.cumsum([len(own) for own in ranges_m])).astype(np.int64),
        np.concatenate(ranges_m).astype(np.float64),
    )  # fmt: skip


def _askew(arcs: Arcs) -> Arcs:
    """Arcs as they lie across cells that no wall is parallel to: else cells would tell of it."""
    cosine, sine = math.cos(ASKEW_RAD), math.sin(ASKEW_RAD)
    return arcs._replace(
        x_m=cosine * arcs.x_m - sine * arcs.y_m,
        y_m=sine * arcs.x_m + cosine * arcs.y_m,
        yaw_rad=arcs.yaw_rad + ASKEW_RAD,
    )


def meetings(candidates: Mapping[Candidate, Arcs]) -> dict[Candidate, FloatArray]:
    """For each candidate, (pings,): logarithms of how many arcs meet on each arc, at most, in sum.

    Parameters
    ----------
    candidates : mapping to Arcs
        The same pings as they would be with other errors.
    """
    every = [_askew(arcs) for arcs in candidates.values()]
    reach_m = max(arcs.range_m.max(initial=0.0) for arcs in every) + CELL_M
    x_m, y_m = (np.concatenate(axis) for axis in zip(*((a.x_m, a.y_m) for a in every), strict=True))
    # The same cells whatever is tried: what is counted hangs a little on where their sides are.
    left_m, bottom_m = (
        CELL_M * math.floor((float(axis_m.min()) - reach_m) / CELL_M) for axis_m in (x_m, y_m)
    )
    shape = (
        int((float(y_m.max()) + reach_m - bottom_m) / CELL_M) + 1,
        int((float(x_m.max()) + reach_m - left_m) / CELL_M) + 1,
    )
    met = for_each(lambda arcs: _count_meetings(arcs, left_m, bottom_m, shape), every)
    return dict(zip(candidates, met, strict=True))


@compiled
def _count_meetings(
    arcs: Arcs, left_m: float, bottom_m: float, shape: tuple[int, int]
) -> FloatArray:
    """See `meetings`; the corner of the cells, and how many there are."""
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


def is_sure(gains: FloatArray, arcs: Arcs, times: float = 1.0) -> bool:
    """Whether so much is gained, and at all times.

    Parameters
    ----------
    gains : (pings,) array
        By how much more arcs meet on those of each ping.
    arcs : Arcs
        Of the pings.
    times : float
        So many times as much as usual must be gained, and as surely.
    """
    parts = np.array([part.sum() for part in np.array_split(gains, PARTS)])
    sureness = parts.sum() / max(float(parts.std()) * math.sqrt(PARTS), 1e-9)
    mean = gains.sum() / len(arcs.range_m)
    return bool(mean >= times * LEAST_GAIN and sureness >= times * LEAST_SURENESS)


def contradicts_one(pings: list[Ping], without: Callable[[list[Ping], Arcs], Arcs]) -> bool:
    """Whether what one of the robots hears speaks against an error that all are to have.

    Parameters
    ----------
    pings : list of (cone, source)
        Of all robots.
    without : callable
        What makes of pings, and their arcs, those without the error.
    """
    own: defaultdict[str, list[Ping]] = defaultdict(list)
    for cone, source in pings:
        own[source].append((cone, source))
    for heard in own.values():
        if len(own) > 1 and len(heard) >= LEAST_OF_ONE:
            told = arcs_of([cone for cone, _ in heard])
            met = meetings({True: told, False: without(heard, told)})
            if (met[False] - met[True]).sum() < -LEAST_GAIN * len(told.range_m):
                return True
    return False
