"""Standard sensor messages that other programs understand: ranges, scans and point clouds."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.conversions.common import (
    MessageTypes,
    array_from_field,
    header_to_message,
    stamp_from_header,
)
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.range_cones import RangeReading

_ULTRASOUND = 0
_FLOAT32 = 7
_FLOAT_BYTES = 4


def range_to_message(cone: EchoCone, types: MessageTypes) -> Any:
    """``sensor_msgs/Range`` of the first echo in a cone; exactly the greatest range if none."""
    transducer = cone.transducer
    heard = len(cone.ranges_m) > 0
    first_m = float(cone.ranges_m[0]) if heard else transducer.max_range_m
    return types.message_class("sensor_msgs/msg/Range")(
        header=header_to_message(cone.stamp_ns, cone.child_frame_id, types),
        radiation_type=_ULTRASOUND,
        field_of_view=2.0 * float(transducer.beam.half_angle_rad),
        min_range=float(transducer.min_range_m),
        max_range=float(transducer.max_range_m),
        range=min(first_m, float(transducer.max_range_m)),
        variance=float(cone.range_stds_m[0]) ** 2 if heard else 0.0,
    )


def scan_to_message(
    cone: EchoCone, angles_rad: FloatArray, ranges_m: FloatArray, types: MessageTypes
) -> Any:
    """``sensor_msgs/LaserScan`` of rays in the transducer's frame.

    Parameters
    ----------
    cone : EchoCone
        The ping that they are of.
    angles_rad, ranges_m : (rays,) arrays
        Ascending by equal steps; ranges of 0 are below the least one, and so count as none.  Those
        up to the greatest range stay a hair below it: at it, laser_geometry drops them.
    types : MessageTypes
        Classes to build it of.
    """
    transducer = cone.transducer
    below_max_m = np.nextafter(np.float32(transducer.max_range_m), np.float32(0.0))
    return types.message_class("sensor_msgs/msg/LaserScan")(
        header=header_to_message(cone.stamp_ns, cone.child_frame_id, types),
        angle_min=float(angles_rad[0]),
        angle_max=float(angles_rad[-1]),
        angle_increment=float(angles_rad[1] - angles_rad[0]),
        time_increment=0.0,
        scan_time=0.0,
        range_min=float(transducer.min_range_m),
        range_max=float(transducer.max_range_m),
        ranges=types.sequence(np.minimum(np.asarray(ranges_m, np.float32), below_max_m)),
        intensities=types.sequence(np.zeros(0, np.float32)),
    )


def range_from_message(message: Any) -> RangeReading:
    """Reading of a ``sensor_msgs/Range``, not yet validated."""
    return RangeReading(
        stamp_ns=stamp_from_header(message.header),
        frame_id=str(message.header.frame_id),
        field_of_view_rad=float(message.field_of_view),
        min_range_m=float(message.min_range),
        max_range_m=float(message.max_range),
        range_m=float(message.range),
        variance_m2=float(getattr(message, "variance", 0.0)),
    )


def points_to_message(
    columns: Mapping[str, NDArray[np.floating[Any]]],
    frame_id: str,
    stamp_ns: int,
    types: MessageTypes,
) -> Any:
    """``sensor_msgs/PointCloud2`` with a single-precision field for every column.

    Parameters
    ----------
    columns : mapping of str to (points,) array
        ``x``, ``y``, ``z`` and whatever else each point has.
    frame_id, stamp_ns : str, int
        Of the cloud.
    types : MessageTypes
        Classes to build it of.
    """
    table = np.stack([np.asarray(column, np.float32) for column in columns.values()], axis=-1)
    field = types.message_class("sensor_msgs/msg/PointField")
    step = _FLOAT_BYTES * len(columns)
    return types.message_class("sensor_msgs/msg/PointCloud2")(
        header=header_to_message(stamp_ns, frame_id, types),
        height=1,
        width=len(table),
        fields=[
            field(name=name, offset=_FLOAT_BYTES * number, datatype=_FLOAT32, count=1)
            for number, name in enumerate(columns)
        ],
        is_bigendian=False,
        point_step=step,
        row_step=step * len(table),
        data=types.sequence(np.ascontiguousarray(table).reshape(-1).view(np.uint8)),
        is_dense=True,
    )


def points_from_message(message: Any) -> tuple[dict[str, NDArray[np.float32]], str, int]:
    """Columns, frame and stamp of a cloud that `points_to_message` could have made.

    Raises
    ------
    MalformedMessageError
        If its layout is another, or its length does not fit.
    """
    names = [str(field.name) for field in message.fields]
    offsets = [int(field.offset) for field in message.fields]
    expected = [_FLOAT_BYTES * number for number in range(len(names))]
    is_plain = all(int(field.datatype) == _FLOAT32 for field in message.fields)
    if not is_plain or offsets != expected or int(message.point_step) != _FLOAT_BYTES * len(names):
        raise MalformedMessageError("fields", "are not single-precision numbers one by one")
    data = array_from_field("data", message.data, np.uint8)
    points = int(message.width) * int(message.height)
    if data.size != points * int(message.point_step):
        raise MalformedMessageError("data", f"has {data.size} bytes for {points} points")
    table = data.view(np.float32).reshape(points, len(names))
    columns = {name: table[:, number] for number, name in enumerate(names)}
    return columns, str(message.header.frame_id), stamp_from_header(message.header)
