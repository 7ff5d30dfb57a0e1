"""What comes back in nearly every ping, wherever it was sent from: the floor around the robot.

Carpet or gravel returns sound from where the beam meets it on, as loud as speckle is: its power is
distributed exponentially (Goodman, "Speckle Phenomena in Optics", 2007).  Walls and objects make
some pings louder, so that the faintest tell how loud the floor is.  Where most pings do not hear it
any more, it goes on as boundaries reverberate (Urick, "Principles of Underwater Sound", 1983).
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import TypeAlias

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, IndexArray, RealArray
from usmap_ros.pings.cone import EchoCone

#: What is alike in sensors that hear the same clutter: carrier, length of the pulse, half angle of
#: the beam, least and greatest range.
Kind: TypeAlias = tuple[float, float, float, float, float]

#: Range bins, m, of which each is looked at with those beside it; echoes that are apart in three.
STEP_M, LOOKS = 0.05, 2
#: One ping of each sensor from a square of such a side, m, and so many of them that are needed.
APART_M, LEAST_PINGS = 0.25, 30
#: Share of pings that may hear nothing of it; range bins without a gap that it must be heard in.
SILENT, LEAST_BINS = 0.3, 5
#: Such a share of pings first hear something within that, m, of where pings of the same sensor
#: mostly do: a floor begins where the beam meets it, rough walls all around where they are nearest.
ALIKE, ALIKE_M = 0.6, 0.1
#: The loudest echo of one ping in ten is so many times as loud, on its way through the same range:
#: what is louder is no clutter, but a wall that the robots follow.
FAINTER, SOME = 5.0, 0.1
#: Power of what a boundary returns over range: spreading there and back, of a ring that grows.
FALLING = 3.0
#: Power over the mean that one of 8,000 of its echoes exceeds; and amplitude over that from which
#: on an object would have been heard surely, whatever it meets there.
MARGIN, SURELY = 9.0, 4.0


def clutter_of(cones: Iterable[EchoCone]) -> dict[Kind, FloatArray]:
    """Amplitude that clutter stays below in range bins of `STEP_M`, for each kind that hears any.

    Parameters
    ----------
    cones : iterable of EchoCone
        All that was heard.
    """
    apart: defaultdict[Kind, dict[tuple[str, int, int], EchoCone]] = defaultdict(dict)
    for cone in cones:
        x, y = (round(float(place_m) / APART_M) for place_m in cone.pose.position_m[:2])
        apart[kind_of(cone)].setdefault((cone.child_frame_id, x, y), cone)
    found = {kind: _loudest_clutter(list(own.values())) for kind, own in apart.items()}
    return {kind: levels for kind, levels in found.items() if levels is not None}


def without_clutter(cone: EchoCone, clutter: Mapping[Kind, FloatArray]) -> EchoCone:
    """A cone without echoes that may be clutter, which hides what is not much louder.

    Parameters
    ----------
    cone : EchoCone
        What was heard.
    clutter : mapping
        See `clutter_of`.
    """
    levels = clutter.get(kind_of(cone))
    if levels is None:
        return cone
    middles = np.arange(len(cone.detection_limits)) + 0.5
    limits_m = cone.transducer.min_range_m + cone.limit_step_m * middles
    levels_there = levels[_bins(cone.ranges_m, len(levels))]
    return cone.louder_than(levels_there, SURELY * levels[_bins(limits_m, len(levels))])


def kind_of(cone: EchoCone) -> Kind:
    """What kind of sensor heard a cone."""
    sensor = cone.transducer
    return (
        sensor.pulse.carrier_hz, sensor.pulse.duration_s, float(sensor.beam.half_angle_rad),
        sensor.min_range_m, sensor.max_range_m,
    )  # fmt: skip


def _bins(ranges_m: RealArray, count: int) -> IndexArray:
    return np.minimum((ranges_m / STEP_M).astype(np.intp), count - 1)


def _loudest_clutter(cones: list[EchoCone]) -> FloatArray | None:
    """The same of one kind, by its pings from places apart; None if it hears none."""
    if len(cones) < LEAST_PINGS or not _begin_alike(cones):
        return None
    power = _power(cones)
    faintest = np.quantile(power, SILENT, axis=0, method="lower")
    heard = np.flatnonzero(faintest > 0.0)
    bins = heard[heard == heard[:1] + np.arange(len(heard))]
    if len(bins) < LEAST_BINS:
        return None
    ranges_m = STEP_M * (np.arange(len(faintest)) + 0.5)
    mean, last = np.zeros(len(faintest)), bins[-1]
    mean[bins] = faintest[bins] / -np.log1p(-(SILENT ** (1.0 / LOOKS)))
    mean[last:] = mean[last] * (ranges_m[last] / ranges_m[last:]) ** FALLING
    loudest = np.sqrt((power * ranges_m**2).max(axis=1))
    if FAINTER * np.sqrt((mean * ranges_m**2).max()) > np.quantile(loudest, 1.0 - SOME):
        return None
    return np.sqrt(MARGIN * mean)


def _begin_alike(cones: list[EchoCone]) -> bool:
    """Whether most pings first hear something from as far away as others of the same sensor do."""
    first_m: defaultdict[str, list[float]] = defaultdict(list)
    for cone in cones:
        nearest_m = float(cone.ranges_m[0]) if len(cone.ranges_m) else float("inf")
        first_m[cone.child_frame_id].append(nearest_m)
    middles_m = ((own_m, sorted(own_m)[len(own_m) // 2]) for own_m in first_m.values())
    alike = sum(abs(m - middle_m) <= ALIKE_M for own_m, middle_m in middles_m for m in own_m)
    return alike >= ALIKE * len(cones)


def _power(cones: list[EchoCone]) -> FloatArray:
    """Power of the loudest echo in each range bin, and those beside it, of each ping."""
    count = int(cones[0].transducer.max_range_m / STEP_M) + 2
    power = np.zeros((len(cones), count))
    for row, cone in zip(power, cones, strict=True):
        for beside_m in (-STEP_M, 0.0, STEP_M):
            place = _bins(np.maximum(cone.ranges_m + beside_m, 0.0), count)
            np.maximum.at(row, place, cone.amplitudes.astype(float) ** 2)
    return power
