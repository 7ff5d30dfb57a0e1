"""Readings of sensors that measure a range only, as cones with one echo.

Such a sensor says where the first thing in its beam is that it hears, and nothing of what is
behind.  How loud that was it does not say: as loud as an ordinary object would be, within a factor.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.clutter import Kind, kind_of
from usmap_ros.pings.cone import EchoCone, encode_limits

#: Reflectivity that an object is taken to have, standard deviation of what it has relative to
#: it, and the least that the sensor is taken to hear.
_USUAL, _SPREAD, _FAINTEST = 0.5, 2.0, 0.2
#: Standard deviation of a range whose variance is not stated: a share of it, and a least one.
_RANGE_SHARE, _RANGE_STD_M = 0.01, 0.01
#: Nothing is heard behind an echo: a limit that nothing exceeds.
_DEAF = 1e6
_STEP_M = 0.05
#: What such sensors send most often.
_PULSE = Pulse(PulseShape.TONE_BURST, 40e3, 2e-4)


@dataclass(frozen=True)
class RangeReading:
    """One reading (``sensor_msgs/Range``)."""

    stamp_ns: int
    #: Frame of the sensor, +x along its axis.
    frame_id: str
    #: Full angle of the beam.
    field_of_view_rad: float
    #: Between which it measures.
    min_range_m: float
    max_range_m: float
    #: What it measured; `max_range_m` or more: nothing was there.
    range_m: float
    #: Of the range; 0: not stated.
    variance_m2: float = 0.0

    def on(self, robot: str) -> RangeReading:
        """The same reading, its frame called ``ROBOT/...`` as that of the robot it rides on."""
        own = self.frame_id.removeprefix(f"{robot}/").strip("/").replace("/", "_")
        return replace(self, frame_id=f"{robot}/{own}")

    def cone(self, pose: Pose, frame_id: str) -> EchoCone:
        """Cone of a reading that was taken at a pose in a world frame.

        Raises
        ------
        MalformedMessageError
            If it says nothing: it is not a number, or nearer than the sensor can measure.
        """
        if np.isnan(self.range_m) or self.range_m < self.min_range_m:
            raise MalformedMessageError(
                "range", f"is {self.range_m:g} m, below min_range of {self.min_range_m:g} m"
            )
        half_angle_rad = 0.5 * self.field_of_view_rad
        if not 0.0 < half_angle_rad <= np.pi:
            raise MalformedMessageError(
                "field_of_view", f"is {self.field_of_view_rad:g} rad, must be above 0 to 2π"
            )
        beam = BeamPattern.linear(half_angle_rad)
        transducer = Transducer(_PULSE, beam, self.min_range_m, self.max_range_m)
        transducer.validate()
        heard_m = np.array([self.range_m] if self.range_m < self.max_range_m else [], dtype=float)
        limits = _limits(self.min_range_m, self.max_range_m, heard_m)
        amplitudes = _USUAL / np.maximum(heard_m, 0.01) ** 2
        stds_m = np.sqrt(self.variance_m2) if self.variance_m2 > 0.0 else None
        cone = EchoCone(
            stamp_ns=self.stamp_ns,
            frame_id=frame_id,
            child_frame_id=self.frame_id,
            pose=pose,
            transducer=transducer,
            attenuation_db_m=0.0,
            ranges_m=heard_m.astype(np.float32),
            range_stds_m=(
                np.hypot(_RANGE_STD_M, _RANGE_SHARE * heard_m)
                if stds_m is None
                else np.full(len(heard_m), stds_m)
            ).astype(np.float32),
            amplitudes=amplitudes.astype(np.float32),
            amplitude_stds=(_SPREAD * amplitudes).astype(np.float32),
            limit_step_m=float(np.float32(_STEP_M)),
            detection_limits=encode_limits(limits),
            residual=0.0,
        )
        cone.validate()
        return cone


#: Pings of a kind of sensor that would hear several things if these came by chance, by which it is
#: judged, and the share of them that may, for noise, with which it still reports the first only.
#: Of sonars among few poles, in noise, it is 0.2 to 0.5.
ENOUGH_EXPECTED, MOST_WITH_SEVERAL = 25.0, 0.05
#: Gain of such a sensor at the edge of its beam.
EDGE_GAIN = 0.6


def report_first_only(cones: Iterable[EchoCone]) -> set[str]:
    """Sensors, by their frames, whose pings hold the first thing in the beam and nothing behind.

    Range readings are recorded as traces, too, with a pulse at the range.  Silence behind it says
    nothing, and neither does its loudness.  But where little stands, or noise hides it, sonars hear
    one thing at a time as well: they are told from these by how many of their pings would hear
    several things if each came by chance (Poisson's distribution), all sensors of a kind together.

    Parameters
    ----------
    cones : iterable of EchoCone
        Of any sensors.
    """
    kinds: dict[str, Kind] = {}
    pings: Counter[Kind] = Counter()
    heard: Counter[Kind] = Counter()
    several: Counter[Kind] = Counter()
    deaf: Counter[Kind] = Counter()
    for cone in cones:
        kind = kinds.get(cone.child_frame_id)
        if kind is None:
            kind = kinds[cone.child_frame_id] = kind_of(cone)
        pings[kind] += 1
        heard[kind] += len(cone.ranges_m) > 0
        several[kind] += len(cone.ranges_m) > 1
        deaf[kind] += is_deaf_behind(cone)

    def is_one(kind: Kind) -> bool:
        expected = _several_by_chance(pings[kind], heard[kind])
        are_few = expected >= ENOUGH_EXPECTED and several[kind] < MOST_WITH_SEVERAL * expected
        return are_few or 0 < heard[kind] == deaf[kind]

    return {frame for frame, kind in kinds.items() if is_one(kind)}


def _several_by_chance(pings: int, heard: int) -> float:
    """How many pings would hear several things, if so many hear any and these come by chance."""
    nothing = 1.0 - heard / (pings + 1)
    one = -nothing * math.log(nothing)
    return pings * (1.0 - nothing - one)


def is_deaf_behind(cone: EchoCone) -> bool:
    """Whether a cone says itself that nothing would have been heard behind its echo."""
    return len(cone.ranges_m) == 1 and int(cone.detection_limits[-1]) == np.iinfo(np.uint8).max


def first_return(cone: EchoCone) -> EchoCone:
    """The first echo of a cone, as a range reading would have it."""
    transducer, heard_m = cone.transducer, cone.ranges_m[:1].astype(float)
    amplitudes = _USUAL / np.maximum(heard_m, 0.01) ** 2
    limits = _limits(transducer.min_range_m, transducer.max_range_m, heard_m)
    return replace(
        cone,
        transducer=replace(transducer, beam=_even(transducer.beam.half_angle_rad)),
        attenuation_db_m=0.0,
        ranges_m=cone.ranges_m[:1],
        range_stds_m=cone.range_stds_m[:1],
        amplitudes=amplitudes.astype(np.float32),
        amplitude_stds=(_SPREAD * amplitudes).astype(np.float32),
        limit_step_m=float(np.float32(_STEP_M)),
        detection_limits=encode_limits(limits),
        bearings_rad=None if cone.bearings_rad is None else cone.bearings_rad[:1],
        bearing_stds_rad=None if cone.bearing_stds_rad is None else cone.bearing_stds_rad[:1],
    )


def _even(half_angle_rad: float) -> BeamPattern:
    """A beam that hears what is at its edge nearly as well as what is in its middle."""
    return BeamPattern(np.array([0.0, half_angle_rad]), np.array([1.0, EDGE_GAIN]))


def _limits(min_range_m: float, max_range_m: float, heard_m: FloatArray) -> FloatArray:
    """Amplitudes that would have been reported, in steps of range: none behind what was heard."""
    far_m = np.maximum(np.arange(min_range_m, max_range_m, _STEP_M) + _STEP_M, _STEP_M)
    limits: FloatArray = _FAINTEST / far_m**2
    if len(heard_m):
        limits[far_m > heard_m[0]] = _DEAF
    return limits
