"""``usmap_msgs/EchoCone``: what reconstruction hands to fusion."""

from typing import Any

import numpy as np

from usmap_ros.io.cdr import FLOAT, CdrReader, CdrWriter, Payload
from usmap_ros.io.conversions.fields import FLOAT32, TWO_DOUBLES, read_ping, write_ping
from usmap_ros.pings.cone import BY_ECHO, MAY_LACK, EchoCone

_UINT8 = np.dtype(np.uint8)
_NOTHING = np.zeros(0, np.float32)


def cone_from_cdr(payload: Payload) -> EchoCone:
    """`EchoCone` from a serialized ``usmap_msgs/EchoCone``; its arrays are views of that.

    Raises
    ------
    MalformedMessageError
        If it cannot be decoded, or a field holds what no reconstruction could have found.
    """
    reader = CdrReader(payload)
    ping = read_ping(reader)
    attenuation_db_m, object_rise_m = reader.numbers(TWO_DOUBLES)
    # A column that is left out of the message is empty.
    columns: dict[str, Any] = {name: reader.sequence(FLOAT32) for name in BY_ECHO}
    columns |= {name: None for name in MAY_LACK if not len(columns[name])}
    (limit_step_m,) = reader.numbers(FLOAT)
    detection_limits = reader.sequence(_UINT8)
    (residual,) = reader.numbers(FLOAT)
    reader.end()
    cone = EchoCone(
        *ping,
        attenuation_db_m=attenuation_db_m,
        limit_step_m=limit_step_m,
        detection_limits=detection_limits,
        residual=residual,
        object_rise_m=object_rise_m,
        **columns,
    )
    cone.validate()
    return cone


def cone_to_cdr(cone: EchoCone) -> bytes:
    """Serialized ``usmap_msgs/EchoCone`` of an `EchoCone`; rclpy publishes it as it is.

    Raises
    ------
    MalformedMessageError
        If its stamp does not fit a message.
    """
    writer = CdrWriter()
    write_ping(writer, cone)
    writer.numbers(TWO_DOUBLES, cone.attenuation_db_m, cone.object_rise_m)
    for name in BY_ECHO:
        column = getattr(cone, name)
        writer.sequence(FLOAT32, _NOTHING if column is None else column)
    writer.numbers(FLOAT, cone.limit_step_m)
    writer.sequence(_UINT8, cone.detection_limits)
    writer.numbers(FLOAT, cone.residual)
    return writer.message()
