"""The ``usmap_msgs`` types for reading and writing bags without a ROS installation."""

from __future__ import annotations

import struct
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.standard_messages import STANDARD_MESSAGES

ECHO_TRACE = "usmap_msgs/msg/EchoTrace"
ECHO_CONE = "usmap_msgs/msg/EchoCone"
TRANSDUCER_ARRAY = "usmap_msgs/msg/TransducerArray"
RANGE = "sensor_msgs/msg/Range"
ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORMS = "tf2_msgs/msg/TFMessage"

_MESSAGE_NAMES = ("Transducer", "EchoTrace", "EchoCone", "ArrayElement", "TransducerArray")
#: What rosbags raises on bytes that are no message of the type; older versions let more through.
_DECODING_ERRORS = (SerdeError, struct.error, ValueError, IndexError, AssertionError)


@lru_cache(maxsize=1)
def typestore() -> Typestore:
    """``usmap_msgs``, parsed from the .msg files of this package, and what they are made of.

    `learn_standard` adds what else there is in ROS 2 Jazzy.
    """
    store = get_typestore(Stores.EMPTY)
    definitions = {}
    for name, text in STANDARD_MESSAGES.items():
        definitions.update(get_types_from_msg(text, name))
    for name in _MESSAGE_NAMES:
        text = files("usmap_ros.io").joinpath("msg", f"{name}.msg").read_text(encoding="utf-8")
        definitions.update(get_types_from_msg(text, f"usmap_msgs/msg/{name}"))
    store.register(definitions)
    return store


def learn_standard(name: str) -> None:
    """Make all standard types of ROS 2 Jazzy known, unless `name` is known already."""
    store = typestore()
    if name not in store.types:
        store.register(get_typestore(Stores.ROS2_JAZZY).fielddefs)


def decoded(payload: memoryview, message_type: str) -> Any:
    """Message of a standard type, as an object of rosbags.

    Raises
    ------
    MalformedMessageError
        If the bytes are no such message.
    """
    try:
        # The stubs of rosbags know bytes only; a view spares a copy.
        return typestore().deserialize_cdr(payload, message_type)
    except _DECODING_ERRORS as error:
        raise MalformedMessageError("message", "cannot be decoded") from error


class BagMessageTypes:
    """Message classes of rosbags, for `usmap_ros.io.conversions`."""

    def message_class(self, name: str) -> Any:
        """Class of a message type such as ``std_msgs/msg/Header``."""
        learn_standard(name)
        return typestore().types[name]

    def sequence(self, values: NDArray[Any]) -> NDArray[Any]:
        """`values` as the field of a sequence type: rosbags takes contiguous arrays as they are."""
        return np.ascontiguousarray(values)
