"""Ranges that are all too long or too short.

Who takes sound for faster than it is hears everything farther away than it is: by 2 % where it is
12 degrees colder than was thought.  Whose trace begins later than the ping, or who waits until an
echo is loud, hears everything by the same way farther.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from usmap_ros.mapping.focus import (
    CELL_M,
    LEAST_PINGS,
    Arcs,
    Ping,
    arcs_of,
    contradicts_one,
    is_sure,
    meetings,
)
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.pings.cone import EchoCone


class RangeError(NamedTuple):
    """What is wrong with all ranges."""

    #: What they are to be multiplied by.
    scale: float = 1.0
    #: By how much less they are then, m.
    late_m: float = 0.0


NOTHING = RangeError()
#: What is tried: scales and ways, of which the greatest and the least are no answers.
SCALES = [RangeError(scale=round(0.93 + 0.01 * step, 2)) for step in range(15)]
DELAYS = [RangeError(late_m=round(0.02 * step, 2)) for step in range(11)]
#: No ranges are told early, but those of round columns seem to be, which answer from before their
#: middles; where that explains such a share of what a scale does, the scale is none.  Of points
#: they were 0.63 at most, of columns, of a radius of 5 cm too, 0.89 at least.
ROUND_SHARE = 0.75
ROUND = [RangeError(late_m=-round(0.02 * step, 2)) for step in range(1, 11)]
#: What is tried first: where nothing else is better, nothing is wrong.
AT_FIRST = [NOTHING, SCALES[5], SCALES[9], DELAYS[2]]
#: Errors, of scale and m, below which maps are as good.
LEAST_SCALE, LEAST_LATE_M = 0.0125, 0.03


def range_error(chosen: list[Ping]) -> RangeError:
    """What is wrong with all ranges, if that is sure.

    Parameters
    ----------
    chosen : list of (cone, source)
        By `usmap_ros.mapping.focus.from_several_places`, of sensors that report more than the first
        thing.
    """
    if len(chosen) < LEAST_PINGS:
        return NOTHING
    told = arcs_of([cone for cone, _ in chosen])
    met = meetings({error: _without(told, error) for error in AT_FIRST})
    if max(met, key=lambda error: met[error].sum()) == NOTHING:
        return NOTHING
    others = [error for error in (*SCALES, *DELAYS) if error not in met]
    met |= meetings({error: _without(told, error) for error in others})
    tried = max(SCALES, DELAYS, key=lambda errors: max(met[error].sum() for error in errors))
    place = int(np.argmax([met[error].sum() for error in tried]))
    if place in {0, len(tried) - 1}:
        return NOTHING
    best, gains = _between(tried, place, met), met[tried[place]] - met[NOTHING]
    is_little = abs(best.scale - 1.0) < LEAST_SCALE and best.late_m < LEAST_LATE_M
    if is_little or not is_sure(gains, told):
        return NOTHING
    if best.scale > 1.0 and _are_round(told, met[NOTHING].sum(), gains.sum()):
        return NOTHING
    is_of_all = not contradicts_one(chosen, lambda _, arcs: _without(arcs, best))
    return best if is_of_all else NOTHING


def _are_round(told: Arcs, met: float, gain: float) -> bool:
    """Whether ranges to the middles of round things gain nearly as much on what met as a scale."""
    to_middles = meetings({error: _without(told, error) for error in ROUND}).values()
    return max(float(meet.sum()) for meet in to_middles) - met > ROUND_SHARE * gain


def _between(tried: list[RangeError], place: int, met: dict[RangeError, FloatArray]) -> RangeError:
    """Error at which the parabola through the best of some, and those beside it, is highest."""
    before, at, behind = (met[error].sum() for error in tried[place - 1 : place + 2])
    # Where it is level, the middle is as good as any.
    beyond = 0.5 * float(before - behind) / min(float(before - 2.0 * at + behind), -1e-9)
    step = np.subtract(tried[place + 1], tried[place])
    return RangeError(*(round(float(value), 3) for value in tried[place] + beyond * step))


def with_ranges(cone: EchoCone, error: RangeError) -> EchoCone:
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
    return replace(cone, ranges_m=ranges_m).among(is_within)


def _without(arcs: Arcs, error: RangeError) -> Arcs:
    """Arcs without an error of ranges."""
    return arcs._replace(range_m=np.maximum(error.scale * arcs.range_m - error.late_m, CELL_M))
