"""What comes back wherever a ping was sent from: the floor around the robot.

Carpet or gravel returns sound from where the beam meets it on, as loud as speckle is: its power is
distributed exponentially (Goodman, "Speckle Phenomena in Optics", 2007).  Walls and objects make
some pings louder, so that the faintest tell how loud the floor is.  Of a floor that is hardly
louder than the noise every other ping hears nothing in a range bin, and how many do tells it.
Where it is not heard any more, it goes on as boundaries reverberate (Urick, "Principles of
Underwater Sound", 1983).
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import NamedTuple, TypeAlias

import numpy as np

from usmap_ros.numerics.arrays import BoolArray, FloatArray, IndexArray, RealArray
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
#: Share of pings that hear clutter there which most do not hear, in each stretch of so many pings,
#: but for such a share of stretches; the median of its echoes exceeds the limit by no more than so
#: many times what that tells: of what is distributed exponentially the rest is as the whole.
OFTEN, STRETCH, OTHERWISE, MEMORYLESS = 0.15, 12, 0.25, 2.5
#: Such a share of pings first hear something within that, m, of where pings of the same sensor
#: mostly do: a floor begins where the beam meets it, rough walls all around where they are nearest.
ALIKE, ALIKE_M = 0.6, 0.1
#: The loudest echo of one ping in ten is so many times as loud, on its way through the same range:
#: what is louder is no clutter, but a wall that the robots follow.
FAINTER, SOME = 5.0, 0.1
#: Power of what a boundary returns over range: spreading there and back, of a ring that grows.
FALLING = 3.0
#: Power over the mean that one of 150 of its echoes exceeds; amplitude over that from which on an
#: object would have been heard surely, whatever it meets there; and how far beside an echo, m.
MARGIN, SURELY, BESIDE_M = 5.0, 3.0, 0.03


class Clutter(NamedTuple):
    """What one kind of sensor hears of it."""

    #: (bins,) array: amplitude that it stays below in range bins of `STEP_M`.
    level: FloatArray
    #: Whether pings often hear nothing where it is.
    is_faint: bool


def clutter_of(cones: Iterable[EchoCone]) -> dict[Kind, Clutter]:
    """Clutter for each kind of sensor that hears any.

    Parameters
    ----------
    cones : iterable of EchoCone
        All that was heard.
    """
    apart: defaultdict[Kind, dict[tuple[str, int, int], EchoCone]] = defaultdict(dict)
    for cone in cones:
        x, y = (round(float(place_m) / APART_M) for place_m in cone.pose.position_m[:2])
        apart[kind_of(cone)].setdefault((cone.child_frame_id, x, y), cone)
    found = {kind: _clutter_of_one_kind(list(own.values())) for kind, own in apart.items()}
    return {kind: clutter for kind, clutter in found.items() if clutter is not None}


def without_clutter(cone: EchoCone, clutter: Mapping[Kind, Clutter]) -> EchoCone:
    """A cone without echoes that may be clutter, which hides what is not much louder.

    Faint clutter does so beside its echoes only: where nothing was heard, it hides nothing that is
    louder than it gets.

    Parameters
    ----------
    cone : EchoCone
        What was heard.
    clutter : mapping
        See `clutter_of`.
    """
    own = clutter.get(kind_of(cone))
    if own is None:
        return cone
    middles = np.arange(len(cone.detection_limits)) + 0.5
    limits_m = cone.transducer.min_range_m + cone.limit_step_m * middles
    loudest_there = own.level[_bins(cone.ranges_m, len(own.level))]
    loudest = own.level[_bins(limits_m, len(own.level))]
    hidden = SURELY * loudest
    if own.is_faint:
        dropped_m = cone.ranges_m[cone.amplitudes <= loudest_there]
        apart_m = np.abs(limits_m[:, np.newaxis] - dropped_m)
        is_beside = (apart_m <= 0.5 * cone.limit_step_m + BESIDE_M).any(axis=1)
        hidden = np.where(is_beside, hidden, loudest)
    return cone.louder_than(loudest_there, hidden)


def kind_of(cone: EchoCone) -> Kind:
    """What kind of sensor heard a cone."""
    sensor = cone.transducer
    return (
        sensor.pulse.carrier_hz, sensor.pulse.duration_s, float(sensor.beam.half_angle_rad),
        sensor.min_range_m, sensor.max_range_m,
    )  # fmt: skip


def _bins(ranges_m: RealArray, count: int) -> IndexArray:
    return np.minimum((ranges_m / STEP_M).astype(np.intp), count - 1)


def _clutter_of_one_kind(cones: list[EchoCone]) -> Clutter | None:
    """The same of one kind, by its pings from places apart; None if it hears none."""
    if len(cones) < LEAST_PINGS:
        return None
    power = _power(cones)
    mean, is_faint = _heard_by_most(cones, power), False
    if mean is None:
        mean, is_faint = _heard_by_some(cones, power), True
    if mean is None:
        return None
    ranges_m, last = STEP_M * (np.arange(len(mean)) + 0.5), np.flatnonzero(mean)[-1]
    mean[last:] = mean[last] * (ranges_m[last] / ranges_m[last:]) ** FALLING
    loudest = np.sqrt((power * ranges_m**2).max(axis=1))
    if FAINTER * np.sqrt((mean * ranges_m**2).max()) > np.quantile(loudest, 1.0 - SOME):
        return None
    return Clutter(np.sqrt(MARGIN * mean), is_faint)


def _heard_by_most(cones: list[EchoCone], power: FloatArray) -> FloatArray | None:
    """Mean power of what most pings hear, in all range bins; None if that is no clutter."""
    if not _begin_alike(cones):
        return None
    faintest = np.quantile(power, SILENT, axis=0, method="lower")
    bins = _first_run(faintest > 0.0)
    if len(bins) < LEAST_BINS:
        return None
    mean = np.zeros(len(faintest))
    mean[bins] = faintest[bins] / _over_mean(SILENT)
    return mean


def _heard_by_some(cones: list[EchoCone], power: FloatArray) -> FloatArray | None:
    """Mean power of what is heard now and then, but everywhere; None if that is no clutter.

    What exceeds the limit in a share e^(-limit / mean) of all looks exceeds it by the mean, in the
    mean.  A wall is heard by most pings here and by none there, and is louder.
    """
    share = np.minimum(_share_anywhere(cones, power > 0.0), 1.0 - SILENT)
    bins = _first_run(share >= OFTEN)
    if len(bins) < LEAST_BINS:
        return None
    limit = np.median([_limit_power(cone, bins) for cone in cones], axis=0)
    of_bins = limit / _over_mean(1.0 - share[bins])
    echoes = np.array([np.median(heard[heard > 0.0]) for heard in power[:, bins].T])
    is_speckle = echoes - limit < MEMORYLESS * np.log(2.0) * of_bins
    count = len(bins) if is_speckle.all() else int(np.argmin(is_speckle))
    if count < LEAST_BINS:
        return None
    mean = np.zeros(len(share))
    mean[bins[:count]] = of_bins[:count]
    return mean


def _over_mean(share: float | FloatArray) -> float | FloatArray:
    """Power over the mean that the loudest of all looks stays below in such a share of pings."""
    return -np.log1p(-(share ** (1.0 / LOOKS)))


def _share_anywhere(cones: list[EchoCone], is_heard: BoolArray) -> FloatArray:
    """Share of pings that hear something in each range bin, or more, in most stretches of a way."""
    frames, shares = np.array([cone.child_frame_id for cone in cones]), []
    for frame in np.unique(frames):
        own = np.flatnonzero(frames == frame)
        stretches = np.array_split(own, max(1, len(own) // STRETCH))
        shares += [is_heard[stretch].mean(axis=0) for stretch in stretches]
    lower: FloatArray = np.quantile(shares, OTHERWISE, axis=0)
    return lower


def _limit_power(cone: EchoCone, bins: IndexArray) -> FloatArray:
    """Power from which on an echo is heard in some range bins."""
    far_m = STEP_M * (bins + 0.5) - cone.transducer.min_range_m
    place = np.clip(far_m / cone.limit_step_m, 0, len(cone.detection_limits) - 1).astype(np.intp)
    power: FloatArray = cone.limit_amplitudes()[place] ** 2
    return power


def _first_run(is_so: BoolArray) -> IndexArray:
    """The first of some range bins and those that follow without a gap."""
    bins = np.flatnonzero(is_so)
    first: IndexArray = bins[bins == bins[:1] + np.arange(len(bins))]
    return first


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
