"""The one place where messages become data types of ours and back.

Messages of ours are read from their bytes and written as bytes, which is what recordings hold, and
what rclpy gives and takes: objects of rclpy in between would take several times as long.  Arrays
are views of the bytes.

Messages of others are objects, duck-typed, so that the same functions serve the classes of rosbags
and those of rclpy, and this package needs neither.  Building one takes a `MessageTypes`, which
knows the classes; reading one takes nothing.

``*_from_cdr`` and ``*_from_message`` check what they return: `MalformedMessageError` names the
first field that cannot be true.
"""

from usmap_ros.io.conversions.array import array_from_cdr, array_to_cdr
from usmap_ros.io.conversions.common import MessageTypes
from usmap_ros.io.conversions.cone import cone_from_cdr, cone_to_cdr
from usmap_ros.io.conversions.grid import (
    grid_from_message,
    grid_to_message,
    grid_update_to_message,
    metadata_to_message,
)
from usmap_ros.io.conversions.odometry import (
    odometry_from_message,
    odometry_to_message,
    path_to_message,
    transform_from_message,
    transform_to_message,
)
from usmap_ros.io.conversions.sensors import (
    points_from_message,
    points_to_message,
    range_from_message,
    range_to_message,
    scan_to_message,
)
from usmap_ros.io.conversions.trace import noise_from_cdr, trace_from_cdr, trace_to_cdr

__all__ = [
    "MessageTypes",
    "array_from_cdr",
    "array_to_cdr",
    "cone_from_cdr",
    "cone_to_cdr",
    "grid_from_message",
    "grid_to_message",
    "grid_update_to_message",
    "metadata_to_message",
    "noise_from_cdr",
    "odometry_from_message",
    "odometry_to_message",
    "path_to_message",
    "points_from_message",
    "points_to_message",
    "range_from_message",
    "range_to_message",
    "scan_to_message",
    "trace_from_cdr",
    "trace_to_cdr",
    "transform_from_message",
    "transform_to_message",
]
