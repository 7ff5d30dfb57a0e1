"""What messages of ours share, as bytes: header, pose and numbers that stand for a choice."""

from __future__ import annotations

import enum
from typing import TypeVar

import numpy as np

from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.cdr import CdrReader, CdrWriter, Layout
from usmap_ros.io.conversions.common import stamp_from_parts, stamp_to_parts
from usmap_ros.numerics.geometry import Pose

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


def read_pose(reader: CdrReader) -> Pose:
    """`Pose` from a ``geometry_msgs/PoseWithCovariance``, not yet validated."""
    # A copy: doubles need not lie in memory as compiled functions want them.
    numbers = reader.array(FLOAT64, _POSE_WITH_COVARIANCE).copy()
    covariance = numbers[_POSE:].reshape(6, 6)
    return Pose(numbers[:_POSITION], numbers[_POSITION:_POSE], covariance)


def write_pose(writer: CdrWriter, pose: Pose) -> None:
    """Append a ``geometry_msgs/PoseWithCovariance``."""
    write_bare_pose(writer, pose)
    writer.array(FLOAT64, pose.covariance)


def read_bare_pose(reader: CdrReader) -> Pose:
    """`Pose` from a ``geometry_msgs/Pose``, exact and not yet validated."""
    numbers = reader.array(FLOAT64, _POSE).copy()
    return Pose(numbers[:_POSITION], numbers[_POSITION:])


def write_bare_pose(writer: CdrWriter, pose: Pose) -> None:
    """Append a ``geometry_msgs/Pose``, without its covariance."""
    writer.array(FLOAT64, pose.position_m)
    writer.array(FLOAT64, pose.orientation)
