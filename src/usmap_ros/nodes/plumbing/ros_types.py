"""Message classes of rclpy, for `usmap_ros.io.conversions`."""

from __future__ import annotations

from array import array
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray


@cache
def interface_class(name: str) -> Any:
    """Class of a message or service type such as ``nav_msgs/srv/GetMap``.

    Raises
    ------
    ImportError
        If its package is not installed, or has no such type.
    """
    package, kind, class_name = name.split("/")
    try:
        return getattr(import_module(f"{package}.{kind}"), class_name)
    except AttributeError as error:
        raise ImportError(f"package {package!r} has no {kind} {class_name!r}") from error


class RosMessageTypes:
    """The rclpy counterpart of `usmap_ros.io.message_types.BagMessageTypes`."""

    def message_class(self, name: str) -> Any:
        """Class of a message type such as ``std_msgs/msg/Header``."""
        return interface_class(name)

    def sequence(self, values: NDArray[Any]) -> array[Any]:
        """`values` as an ``array.array``, which rclpy takes in bulk."""
        content = array(values.dtype.char)
        # As bytes, without a copy; rclpy looks at every element of anything but an array.array.
        content.frombytes(np.ascontiguousarray(values).reshape(-1).view(np.uint8).data)
        return content
