"""``usmap_msgs/EchoCone``: what reconstruction hands to fusion."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from usmap_ros.cone import EchoCone
from usmap_ros.io.conversions.common import (
    MessageTypes,
    array_from_field,
    header_to_message,
    pose_from_message,
    pose_to_message,
    stamp_from_header,
)
from usmap_ros.io.conversions.transducer import transducer_from_message, transducer_to_message


def cone_from_message(message: Any) -> EchoCone:
    """`EchoCone` from a ``usmap_msgs/EchoCone``; its arrays are views of the message's.

    Raises
    ------
    MalformedMessageError
        If a field holds what no reconstruction could have found.
    """
    cone = EchoCone(
        stamp_ns=stamp_from_header(message.header),
        frame_id=str(message.header.frame_id),
        child_frame_id=str(message.child_frame_id),
        pose=pose_from_message(message.pose),
        transducer=transducer_from_message(message.transducer),
        attenuation_db_m=float(message.attenuation),
        object_rise_m=float(message.object_rise),
        ranges_m=array_from_field("ranges", message.ranges, np.float32),
        range_stds_m=array_from_field("range_stds", message.range_stds, np.float32),
        amplitudes=array_from_field("amplitudes", message.amplitudes, np.float32),
        amplitude_stds=array_from_field("amplitude_stds", message.amplitude_stds, np.float32),
        bearings_rad=_of_echoes(message, "bearings"),
        bearing_stds_rad=_of_echoes(message, "bearing_stds"),
        limit_step_m=float(message.limit_step),
        detection_limits=array_from_field("detection_limits", message.detection_limits, np.uint8),
        residual=float(message.residual),
    )
    cone.validate()
    return cone


def cone_to_message(cone: EchoCone, types: MessageTypes) -> Any:
    """``usmap_msgs/EchoCone`` of an `EchoCone`."""
    return types.message_class("usmap_msgs/msg/EchoCone")(
        header=header_to_message(cone.stamp_ns, cone.frame_id, types),
        child_frame_id=cone.child_frame_id,
        pose=pose_to_message(cone.pose, types),
        transducer=transducer_to_message(cone.transducer, types),
        attenuation=float(cone.attenuation_db_m),
        object_rise=float(cone.object_rise_m),
        ranges=types.sequence(np.asarray(cone.ranges_m, dtype=np.float32)),
        range_stds=types.sequence(np.asarray(cone.range_stds_m, dtype=np.float32)),
        amplitudes=types.sequence(np.asarray(cone.amplitudes, dtype=np.float32)),
        amplitude_stds=types.sequence(np.asarray(cone.amplitude_stds, dtype=np.float32)),
        bearings=types.sequence(_or_empty(cone.bearings_rad)),
        bearing_stds=types.sequence(_or_empty(cone.bearing_stds_rad)),
        limit_step=float(cone.limit_step_m),
        detection_limits=types.sequence(np.asarray(cone.detection_limits, dtype=np.uint8)),
        residual=float(cone.residual),
    )


def _of_echoes(message: Any, field: str) -> NDArray[np.float32] | None:
    """Return an array that may be left out of the message."""
    values = array_from_field(field, getattr(message, field), np.float32)
    return values if len(values) else None


def _or_empty(values: NDArray[np.float32] | None) -> NDArray[np.float32]:
    return np.zeros(0, np.float32) if values is None else np.asarray(values, dtype=np.float32)
