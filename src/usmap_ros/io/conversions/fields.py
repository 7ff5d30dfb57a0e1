"""What messages of ours share, as bytes: header, pose, transducer, choices."""

import enum
from functools import lru_cache
from typing import TypeVar

import numpy as np

from usmap_ros import bounds
from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.cdr import BYTE, CdrReader, CdrWriter, Layout
from usmap_ros.io.conversions.common import stamp_from_parts, stamp_to_parts
from usmap_ros.numerics.geometry import Pose, told_covariance
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace

FLOAT32, FLOAT64 = np.dtype(np.float32), np.dtype(np.float64)
TWO_DOUBLES = Layout.of(8, "dd")

_STAMP = Layout.of(4, "iI")
#: Numbers of a position, an orientation, and a pose with its covariance.
_POSITION, _POSE, _POSE_WITH_COVARIANCE = 3, 7, 7 + 36

_Enumeration = TypeVar("_Enumeration", bound=enum.IntEnum)


def read_enumeration(field: str, value: int, enumeration: type[_Enumeration]) -> _Enumeration:
    """Turn an integer constant into the member of `enumeration` it stands for."""
    try:
        return enumeration(value)
    except ValueError as error:
        known = ", ".join(f"{member.value} ({member.name})" for member in enumeration)
        raise MalformedMessageError(field, f"is {value}, not one of {known}") from error


def read_header(reader: CdrReader) -> tuple[int, str]:
    """Stamp in nanoseconds since the epoch and frame of a ``std_msgs/Header``."""
    seconds, nanoseconds = reader.numbers(_STAMP)
    return stamp_from_parts(seconds, nanoseconds), reader.text()


def write_header(writer: CdrWriter, stamp_ns: int, frame_id: str) -> None:
    """Append a ``std_msgs/Header`` with a stamp in nanoseconds since the epoch."""
    writer.numbers(_STAMP, *stamp_to_parts(stamp_ns))
    writer.text(frame_id)


def read_ping(reader: CdrReader) -> tuple[int, str, str, Pose, Transducer]:
    """The fields that traces and cones begin with: stamp, frames, pose and transducer."""
    stamp_ns, frame_id = read_header(reader)
    return stamp_ns, frame_id, reader.text(), _read_pose(reader), read_transducer(reader)


def write_ping(writer: CdrWriter, ping: EchoTrace | EchoCone) -> None:
    """Append what traces and cones begin with."""
    write_header(writer, ping.stamp_ns, ping.frame_id)
    writer.text(ping.child_frame_id)
    write_bare_pose(writer, ping.pose)
    writer.array(FLOAT64, ping.pose.covariance)
    write_transducer(writer, ping.transducer)


def _read_pose(reader: CdrReader) -> Pose:
    """`Pose` from a ``geometry_msgs/PoseWithCovariance``, not yet validated."""
    # A copy: doubles need not lie in memory as compiled functions want them.
    numbers = reader.array(FLOAT64, _POSE_WITH_COVARIANCE).copy()
    covariance = told_covariance(numbers[_POSE:])
    return Pose(numbers[:_POSITION], numbers[_POSITION:_POSE], covariance)


def read_bare_pose(reader: CdrReader) -> Pose:
    """`Pose` from a ``geometry_msgs/Pose``, exact and not yet validated."""
    numbers = reader.array(FLOAT64, _POSE).copy()
    return Pose(numbers[:_POSITION], numbers[_POSITION:])


def write_bare_pose(writer: CdrWriter, pose: Pose) -> None:
    """Append a ``geometry_msgs/Pose``, without its covariance."""
    writer.array(FLOAT64, pose.position_m)
    writer.array(FLOAT64, pose.orientation)


def read_transducer(reader: CdrReader) -> Transducer:
    """`Transducer` from a ``usmap_msgs/Transducer``, not yet validated.

    Messages that say the same share one, with all that was ever worked out about it.
    """
    (shape,) = reader.numbers(BYTE)
    pulse = reader.numbers(TWO_DOUBLES)
    angles_rad, gains = reader.sequence(FLOAT64), reader.sequence(FLOAT64)
    ranges_m = reader.numbers(TWO_DOUBLES)
    is_small = max(len(angles_rad), len(gains)) <= bounds.MAX_BEAM_ANGLES
    make = _shared if is_small else _shared.__wrapped__
    return make(shape, pulse, angles_rad.tobytes(), gains.tobytes(), ranges_m)


@lru_cache(maxsize=64)
def _shared(
    shape: int,
    pulse: tuple[float, float],
    angles_rad: bytes,
    gains: bytes,
    ranges_m: tuple[float, float],
) -> Transducer:
    """One transducer for all messages that say this of it; its arrays cannot be written to."""
    beam = BeamPattern(np.frombuffer(angles_rad), np.frombuffer(gains))
    known = read_enumeration("transducer.pulse_shape", shape, PulseShape)
    return Transducer(Pulse(known, *pulse), beam, *ranges_m)


def write_transducer(writer: CdrWriter, transducer: Transducer) -> None:
    """Append a ``usmap_msgs/Transducer``."""
    pulse, beam = transducer.pulse, transducer.beam
    writer.numbers(BYTE, pulse.shape)
    writer.numbers(TWO_DOUBLES, pulse.carrier_hz, pulse.duration_s)
    writer.sequence(FLOAT64, beam.angles_rad)
    writer.sequence(FLOAT64, beam.gains)
    writer.numbers(TWO_DOUBLES, transducer.min_range_m, transducer.max_range_m)
