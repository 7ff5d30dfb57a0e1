"""Readings of sensors that measure a range only, as cones with one echo.

Such a sensor says where the first thing in its beam is that it hears, and nothing of what is
behind.  How loud that was it does not say: as loud as an ordinary object would be, within a factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.geometry import Pose
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
    """One reading (``sensor_msgs/Range``).

    Parameters
    ----------
    stamp_ns : int
        Nanoseconds since the epoch.
    frame_id : str
        Frame of the sensor, +x along its axis.
    field_of_view_rad : float
        Full angle of the beam.
    min_range_m, max_range_m : float
        Between which it measures.
    range_m : float
        What it measured; `max_range_m` or more: nothing was there.
    variance_m2 : float
        Of the range; 0: not stated.
    """

    stamp_ns: int
    frame_id: str
    field_of_view_rad: float
    min_range_m: float
    max_range_m: float
    range_m: float
    variance_m2: float = 0.0

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
        edges_m = np.arange(self.min_range_m, self.max_range_m, _STEP_M)
        far_m = np.maximum(edges_m + _STEP_M, _STEP_M)
        limits = _FAINTEST / far_m**2
        if len(heard_m):
            limits[far_m > heard_m[0]] = _DEAF
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
