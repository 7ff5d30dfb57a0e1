"""What several standard messages share: arrays, header and pose."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.geometry import Pose, told_covariance

NANOSECONDS = 1_000_000_000
MAX_SECONDS = 2**31 - 1


class MessageTypes(Protocol):
    """The message classes of one ROS client library."""

    def message_class(self, name: str) -> Any:
        """Class of a message type such as ``std_msgs/msg/Header``; takes fields as keywords."""

    def sequence(self, values: NDArray[Any]) -> Any:
        """`values` as what a field of an unbounded sequence type accepts, in bulk."""


def array_from_field(field: str, values: Any, dtype: type[np.generic]) -> NDArray[Any]:
    """Make a message's array a NumPy one, without a copy where its type has a buffer.

    Both rosbags' arrays and rclpy's ``array.array`` have; a list is converted.
    """
    try:
        array = np.asarray(values, dtype=dtype)
    except (TypeError, ValueError) as error:
        raise MalformedMessageError(field, f"is no array of {dtype.__name__}") from error
    if array.ndim != 1:
        raise MalformedMessageError(field, f"has {array.ndim} dimensions instead of 1")
    return array


def stamp_from_parts(seconds: int, nanoseconds: int) -> int:
    """Nanoseconds since the epoch from those of a ``builtin_interfaces/Time``."""
    if not (0 <= seconds <= MAX_SECONDS and 0 <= nanoseconds < NANOSECONDS):
        raise MalformedMessageError("header.stamp", f"is {seconds} s and {nanoseconds} ns")
    return seconds * NANOSECONDS + nanoseconds


def stamp_to_parts(stamp_ns: int) -> tuple[int, int]:
    """Seconds and nanoseconds of a ``builtin_interfaces/Time``."""
    seconds, nanoseconds = divmod(stamp_ns, NANOSECONDS)
    if not 0 <= seconds <= MAX_SECONDS:
        raise MalformedMessageError("header.stamp", f"of {stamp_ns} ns does not fit a message")
    return seconds, nanoseconds


def stamp_from_header(header: Any) -> int:
    """Stamp of a ``std_msgs/Header`` in nanoseconds since the epoch."""
    return stamp_from_parts(int(header.stamp.sec), int(header.stamp.nanosec))


def header_to_message(stamp_ns: int, frame_id: str, types: MessageTypes) -> Any:
    """``std_msgs/Header`` with a stamp in nanoseconds since the epoch."""
    seconds, nanoseconds = stamp_to_parts(stamp_ns)
    stamp = types.message_class("builtin_interfaces/msg/Time")(sec=seconds, nanosec=nanoseconds)
    return types.message_class("std_msgs/msg/Header")(stamp=stamp, frame_id=frame_id)


def pose_from_message(message: Any) -> Pose:
    """`Pose` from a ``geometry_msgs/PoseWithCovariance``, not yet validated."""
    covariance = array_from_field("pose.covariance", message.covariance, np.float64)
    if covariance.size != 36:
        raise MalformedMessageError("pose.covariance", f"has {covariance.size} entries, not 36")
    position, orientation = message.pose.position, message.pose.orientation
    return Pose(
        position_m=np.array([position.x, position.y, position.z], dtype=np.float64),
        orientation=np.array(
            [orientation.x, orientation.y, orientation.z, orientation.w], dtype=np.float64
        ),
        covariance=told_covariance(covariance),
    )


def pose_to_message(pose: Pose, types: MessageTypes) -> Any:
    """``geometry_msgs/PoseWithCovariance`` of a `Pose`."""
    x, y, z = (float(value) for value in pose.position_m)
    position = types.message_class("geometry_msgs/msg/Point")(x=x, y=y, z=z)
    x, y, z, w = (float(value) for value in pose.orientation)
    orientation = types.message_class("geometry_msgs/msg/Quaternion")(x=x, y=y, z=z, w=w)
    bare = types.message_class("geometry_msgs/msg/Pose")(position=position, orientation=orientation)
    return types.message_class("geometry_msgs/msg/PoseWithCovariance")(
        pose=bare,
        # An array of fixed size is a NumPy array for rosbags and rclpy alike.
        covariance=np.ascontiguousarray(pose.covariance, dtype=np.float64).reshape(36),
    )
