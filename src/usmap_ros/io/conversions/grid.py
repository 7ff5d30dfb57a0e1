"""``nav_msgs/OccupancyGrid`` and what goes with it: maps as nav2 takes them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from usmap_ros.bounds import MAX_MAP_SIDE
from usmap_ros.errors import MalformedMessageError
from usmap_ros.grids import GridGeometry
from usmap_ros.io.conversions.common import (
    MessageTypes,
    array_from_field,
    header_to_message,
    stamp_from_header,
)


def metadata_to_message(geometry: GridGeometry, stamp_ns: int, types: MessageTypes) -> Any:
    """``nav_msgs/MapMetaData`` of a grid whose newest content has this stamp.

    Raises
    ------
    MalformedMessageError
        If a side is longer than nav2 takes.
    """
    rows, columns = geometry.shape
    if not (1 <= rows <= MAX_MAP_SIDE and 1 <= columns <= MAX_MAP_SIDE):
        raise MalformedMessageError("info", f"of {columns} × {rows} cells is not taken by nav2")
    x, y = geometry.origin_m
    position = types.message_class("geometry_msgs/msg/Point")(x=float(x), y=float(y), z=0.0)
    orientation = types.message_class("geometry_msgs/msg/Quaternion")(x=0.0, y=0.0, z=0.0, w=1.0)
    return types.message_class("nav_msgs/msg/MapMetaData")(
        map_load_time=header_to_message(stamp_ns, "", types).stamp,
        resolution=float(geometry.resolution_m),
        width=columns,
        height=rows,
        origin=types.message_class("geometry_msgs/msg/Pose")(
            position=position, orientation=orientation
        ),
    )


def grid_to_message(
    geometry: GridGeometry,
    values: NDArray[np.int8],
    frame_id: str,
    stamp_ns: int,
    types: MessageTypes,
) -> Any:
    """``nav_msgs/OccupancyGrid`` of cell values.

    Parameters
    ----------
    geometry : GridGeometry
        Where the cells lie.
    values : (rows, columns) int8 array
        -1 for unknown, or 0 to 100.
    frame_id, stamp_ns : str, int
        Of the map and of its newest content.
    types : MessageTypes
        Classes to build it of.

    Raises
    ------
    MalformedMessageError
        If nav2 would refuse it.
    """
    if not frame_id:
        raise MalformedMessageError("header.frame_id", "is empty")
    return types.message_class("nav_msgs/msg/OccupancyGrid")(
        header=header_to_message(stamp_ns, frame_id, types),
        info=metadata_to_message(geometry, stamp_ns, types),
        data=types.sequence(np.ascontiguousarray(values, dtype=np.int8).reshape(-1)),
    )


def grid_from_message(message: Any) -> tuple[GridGeometry, NDArray[np.int8], str, int]:
    """Geometry, values, frame and stamp of a ``nav_msgs/OccupancyGrid``.

    Raises
    ------
    MalformedMessageError
        If its parts do not fit together.
    """
    info = message.info
    shape = (int(info.height), int(info.width))
    values = array_from_field("data", message.data, np.int8)
    if values.size != shape[0] * shape[1]:
        raise MalformedMessageError(
            "data", f"has {values.size} entries for {shape[1]} × {shape[0]} cells"
        )
    # A resolution is single precision in the message: 0.05 must not come back as 0.050000000745.
    resolution_m = float(np.format_float_positional(np.float32(info.resolution)))
    origin = info.origin.position
    geometry = GridGeometry(resolution_m, (float(origin.x), float(origin.y)), shape)
    frame_id, stamp_ns = str(message.header.frame_id), stamp_from_header(message.header)
    return geometry, values.reshape(shape), frame_id, stamp_ns


def grid_update_to_message(
    values: NDArray[np.int8],
    first: tuple[int, int],
    frame_id: str,
    stamp_ns: int,
    types: MessageTypes,
) -> Any:
    """``map_msgs/OccupancyGridUpdate``: new values of a rectangle of a grid.

    Parameters
    ----------
    values : (rows, columns) int8 array
        Of the rectangle.
    first : (int, int)
        Row and column of its first cell in the grid.
    frame_id, stamp_ns : str, int
        As of the grid.
    types : MessageTypes
        Classes to build it of.
    """  # fmt: skip
    rows, columns = values.shape
    return types.message_class("map_msgs/msg/OccupancyGridUpdate")(
        header=header_to_message(stamp_ns, frame_id, types),
        x=first[1],
        y=first[0],
        width=columns,
        height=rows,
        data=types.sequence(np.ascontiguousarray(values, dtype=np.int8).reshape(-1)),
    )
