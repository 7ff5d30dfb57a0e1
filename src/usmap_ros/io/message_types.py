"""The message types for reading and writing bags without a ROS installation.

rosbags has the definitions of all standard messages, hundreds of classes that take longer to make
than a short recording takes to map; it is asked for what is not here.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rosbags.serde import SerdeError
from rosbags.typesys import (
    Stores,
    TypesysError,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)
from rosbags.typesys.store import Typestore

from usmap_ros.errors import BagError, FileError, MalformedMessageError

if TYPE_CHECKING:
    from usmap_ros.io.storage import RecordedTopic

#: Fields by type, as in the .msg files of ROS 2 Jazzy.
STANDARD_MESSAGES = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/msg/Pose": "Point position\nQuaternion orientation",
    "geometry_msgs/msg/PoseWithCovariance": "Pose pose\nfloat64[36] covariance",
    "geometry_msgs/msg/Twist": "Vector3 linear\nVector3 angular",
    "geometry_msgs/msg/TwistWithCovariance": "Twist twist\nfloat64[36] covariance",
    "geometry_msgs/msg/Transform": "Vector3 translation\nQuaternion rotation",
    "geometry_msgs/msg/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\nTransform transform"
    ),
    "nav_msgs/msg/Odometry": (
        "std_msgs/Header header\nstring child_frame_id\n"
        "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist"
    ),
    "sensor_msgs/msg/Range": (
        "uint8 ULTRASOUND=0\nuint8 INFRARED=1\nstd_msgs/Header header\nuint8 radiation_type\n"
        "float32 field_of_view\nfloat32 min_range\nfloat32 max_range\nfloat32 range\n"
        "float32 variance"
    ),
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms",
}
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

    Raises
    ------
    FileError
        If a file of the package is missing.
    """
    store = get_typestore(Stores.EMPTY)
    definitions = {}
    for name, text in STANDARD_MESSAGES.items():
        definitions.update(get_types_from_msg(text, name))
    for name in _MESSAGE_NAMES:
        file = files("usmap_ros.io").joinpath("msg", f"{name}.msg")
        try:
            text = file.read_text(encoding="utf-8")
        # Otherwise it would be said of the recording that is being read.
        except OSError as error:
            cause = "cannot be read: usmap_ros must be installed anew"
            raise FileError(str(file), cause) from error
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


def check_definition(path: Path, recorded: RecordedTopic) -> None:
    """Refuse a topic whose messages are laid out differently from ours.

    Comments and constants may differ.  A recording that carries no definitions is trusted.

    Raises
    ------
    BagError
        Naming the topic, the message type and the first difference.
    """
    if recorded.encoding != "cdr":
        raise BagError(
            path, f"topic {recorded.name} is serialized as {recorded.encoding!r}, not CDR"
        )
    if not recorded.definition:
        return
    for message_type, theirs in _parse(path, recorded).items():
        difference = _difference(theirs, message_type)
        if difference:
            raise BagError(
                path,
                f"topic {recorded.name} has another definition of {message_type}: {difference}",
            )


def _parse(path: Path, recorded: RecordedTopic) -> dict[str, Any]:
    """Fields by message type, of all types in the topic's definition."""
    try:
        return _fields(recorded.definition_format, recorded.definition, recorded.message_type)
    # Its parser fails in other ways, too, on text that is no definition at all.
    except (TypesysError, ValueError, LookupError, TypeError, RecursionError) as error:
        raise BagError(
            path, f"topic {recorded.name} has a definition that cannot be parsed"
        ) from error


@lru_cache(maxsize=64)
def _fields(definition_format: str, definition: str, message_type: str) -> dict[str, Any]:
    """Parse a definition once, however many robots have it."""
    if definition_format == "ros2idl":
        types = get_types_from_idl(definition)
    else:
        types = get_types_from_msg(definition, message_type)
    return {name: fields for name, (_, fields) in types.items()}


def _difference(theirs: list[tuple[str, Any]], message_type: str) -> str:
    """Name the first field in which a definition differs from ours; empty if none does."""
    known = typestore().fielddefs.get(message_type)
    if known is None:
        return "it is unknown here"
    ours = list(known[1])
    for (their_name, their_type), (our_name, our_type) in zip(theirs, ours, strict=False):
        if their_name != our_name:
            return f"field {their_name!r} stands where {our_name!r} is expected"
        if their_type != our_type:
            return f"field {our_name!r} has another type"
    if len(theirs) > len(ours):
        return f"field {theirs[len(ours)][0]!r} is not known here"
    if len(theirs) < len(ours):
        return f"field {ours[len(theirs)][0]!r} is missing"
    return ""
