"""What the reconstruction of one ping says of its sensing cone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usmap_ros import bounds
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose

#: `EchoCone.detection_limits` count half decibels up from here (dB re amplitude 1).
LIMIT_FLOOR_DB = -100.0
LIMIT_STEP_DB = 0.5
#: The amplitude that each of their codes stands for.
LIMIT_AMPLITUDES: FloatArray = np.power(
    10.0, (LIMIT_FLOOR_DB + LIMIT_STEP_DB * np.arange(256.0)) / 20.0
)
#: What the numbers of an echo may be, by the names that messages have for them.
_ECHO = {
    "ranges": bounds.RANGE,
    "range_stds": bounds.RANGE_STD,
    "amplitudes": bounds.LOUDNESS,
    "amplitude_stds": bounds.LOUDNESS,
}
#: Columns of numbers of each echo, in the order of the message, and those that a cone may lack.
MAY_LACK = ("bearings_rad", "bearing_stds_rad")
BY_ECHO = ("ranges_m", "range_stds_m", "amplitudes", "amplitude_stds", *MAY_LACK)
_LEAST, _GREATEST = (
    np.array([[getattr(bound, end)] for bound in _ECHO.values()]) for end in ("least", "greatest")
)


@dataclass(frozen=True)
class EchoCone:
    """Echoes of one ping and how loud an echo had to be (``usmap_msgs/EchoCone``).

    About 1 kB, and enough to be fused without the trace.

    Parameters
    ----------
    stamp_ns : int
        Start of emission, nanoseconds since the epoch.
    frame_id, child_frame_id : str
        World frame of `pose`, and the transducer's frame.
    pose : Pose
        Of the transducer.
    transducer : Transducer
        Beam and range limits.
    attenuation_db_m : float
        Absorption per metre of path in air.
    ranges_m, range_stds_m : (echoes,) arrays
        Ascending ranges and their standard deviations.
    amplitudes, amplitude_stds : (echoes,) arrays
        Of each echo's direct path, in units of the trace's samples.
    limit_step_m : float
        Width of one bin of `detection_limits`.
    detection_limits : (bins,) uint8 array
        For ranges from ``min_range_m + i * limit_step_m``: the amplitude below which an object
        there could have gone unreported, in half decibels above -100 dB.
    residual : float
        Norm of what the echoes leave unexplained, relative to the trace's norm.
    object_rise_m : float
        Height of the objects above the transducer; 0 if they are at its height, and for upright
        ones, which answer from there.
    bearings_rad, bearing_stds_rad : (echoes,) arrays, optional
        Directions as seen from above, off the beam axis and positive to the left, where receivers
        side by side could tell them, and their standard deviations; NaN: unknown; None: all of
        them.
    """

    stamp_ns: int
    frame_id: str
    child_frame_id: str
    pose: Pose
    transducer: Transducer
    attenuation_db_m: float
    ranges_m: NDArray[np.float32]
    range_stds_m: NDArray[np.float32]
    amplitudes: NDArray[np.float32]
    amplitude_stds: NDArray[np.float32]
    limit_step_m: float
    detection_limits: NDArray[np.uint8]
    residual: float
    object_rise_m: float = 0.0
    bearings_rad: NDArray[np.float32] | None = None
    bearing_stds_rad: NDArray[np.float32] | None = None

    def limit_amplitudes(self) -> FloatArray:
        """`detection_limits` as amplitudes."""
        amplitudes: FloatArray = LIMIT_AMPLITUDES[self.detection_limits]
        return amplitudes

    def louder_than(self, other: FloatArray, hidden: FloatArray) -> EchoCone:
        """The cone without echoes of something else, which hides others.

        Parameters
        ----------
        other : (echoes,) array
            Amplitude that echoes of something else may have where each echo is; negative: nowhere.
        hidden : (bins,) array
            Amplitude that it may hide in each bin of `detection_limits`.
        """
        limits = np.maximum(self.detection_limits, encode_limits(hidden))
        return replace(self.among(self.amplitudes > other), detection_limits=limits)

    def among(self, kept: NDArray[np.bool_]) -> EchoCone:
        """The cone with some of its echoes only.

        Parameters
        ----------
        kept : (echoes,) bool array
            Which ones.
        """
        columns = {name: getattr(self, name) for name in BY_ECHO}
        echoes: dict[str, Any] = {
            name: column[kept] for name, column in columns.items() if column is not None
        }
        return replace(self, **echoes)

    def validate(self) -> None:
        """Raise `MalformedMessageError` naming the first field that cannot be true."""
        bounds.check_name("header.frame_id", self.frame_id)
        bounds.check_name("child_frame_id", self.child_frame_id, may_be_empty=True)
        self.pose.validate()
        self.transducer.validate()
        self.transducer.validate_loss(self.attenuation_db_m)
        self.validate_echoes()

    def validate_echoes(self) -> None:
        """Raise `MalformedMessageError` as `validate` does, for all but what a trace says, too."""
        bounds.check("object_rise", self.object_rise_m, bounds.OBJECT_RISE)
        bounds.check_count("ranges", len(self.ranges_m), bounds.MAX_ECHOES)
        columns = (self.ranges_m, self.range_stds_m, self.amplitudes, self.amplitude_stds)
        for name, column in zip(_ECHO, columns, strict=True):
            if len(column) != len(self.ranges_m):
                raise MalformedMessageError(
                    name, f"has {len(column)} entries, ranges has {len(self.ranges_m)}"
                )
        # All at once takes a third of the time, and nearly every cone is right.
        together = np.array(columns)
        if not ((together >= _LEAST) & (together <= _GREATEST)).all():
            for (name, bound), column in zip(_ECHO.items(), columns, strict=True):
                bounds.check_all(name, column, bound)
        self._validate_bearings()
        if (self.ranges_m[1:] < self.ranges_m[:-1]).any():
            raise MalformedMessageError("ranges", "do not ascend")
        bounds.check("limit_step", self.limit_step_m, bounds.LIMIT_STEP)
        bounds.check("residual", self.residual, bounds.RESIDUAL)
        bounds.check_count("detection_limits", len(self.detection_limits), bounds.MAX_BINS)
        if len(self.detection_limits) == 0:
            raise MalformedMessageError("detection_limits", "is empty")

    def _validate_bearings(self) -> None:
        count, bearings_rad, stds_rad = len(self.ranges_m), self.bearings_rad, self.bearing_stds_rad
        if bearings_rad is None and stds_rad is None:
            return
        if bearings_rad is None or stds_rad is None:
            raise MalformedMessageError("bearings", "or bearing_stds is missing, need both")
        for name, column in (("bearings", bearings_rad), ("bearing_stds", stds_rad)):
            if len(column) != count:
                raise MalformedMessageError(name, f"has {len(column)} entries, ranges has {count}")
        known = ~np.isnan(bearings_rad)
        if np.any(np.abs(bearings_rad[known]) > np.float32(np.pi)):
            raise MalformedMessageError("bearings", "has an entry beyond π")
        stds = stds_rad[known]
        if not (np.all(np.isfinite(stds)) and np.all(stds > 0.0)):
            raise MalformedMessageError(
                "bearing_stds", "has an entry for a bearing that is not above 0 and finite"
            )


def encode_limits(amplitudes: FloatArray) -> NDArray[np.uint8]:
    """Amplitudes as `EchoCone.detection_limits`, rounded up so that no limit is understated."""
    decibels = 20.0 * np.log10(np.maximum(amplitudes, 10.0 ** (LIMIT_FLOOR_DB / 20.0)))
    steps = np.ceil((decibels - LIMIT_FLOOR_DB) / LIMIT_STEP_DB - 1e-9)
    codes: NDArray[np.uint8] = np.clip(steps, 0, 255).astype(np.uint8)
    return codes
