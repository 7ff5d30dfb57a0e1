"""``usmap_msgs/EchoTrace``: one ping as it was received."""

from __future__ import annotations

from typing import Any

import numpy as np

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.io.conversions.common import (
    MessageTypes,
    array_from_field,
    enumeration_from_field,
    header_to_message,
    pose_from_message,
    pose_to_message,
    stamp_from_header,
)
from usmap_ros.io.conversions.transducer import transducer_from_message, transducer_to_message
from usmap_ros.trace import EchoTrace, Encoding


def trace_from_message(message: Any) -> EchoTrace:
    """`EchoTrace` from a ``usmap_msgs/EchoTrace``; its samples are a view of the message's.

    Raises
    ------
    MalformedMessageError
        If a field holds what no sensor could have sent.
    """
    trace = EchoTrace(
        stamp_ns=stamp_from_header(message.header),
        frame_id=str(message.header.frame_id),
        child_frame_id=str(message.child_frame_id),
        pose=pose_from_message(message.pose),
        transducer=transducer_from_message(message.transducer),
        channel=Channel(
            sound_speed_m_s=float(message.sound_speed),
            attenuation_db_m=float(message.attenuation),
            floor_height_m=float(message.floor_height),
            floor_reflectivity=float(message.floor_reflectivity),
        ),
        encoding=enumeration_from_field("encoding", message.encoding, Encoding),
        sample_rate_hz=float(message.sample_rate),
        start_delay_s=float(message.start_delay),
        noise_std=float(message.noise_std),
        samples=array_from_field("samples", message.samples, np.float32),
    )
    trace.validate()
    return trace


def trace_to_message(trace: EchoTrace, types: MessageTypes) -> Any:
    """``usmap_msgs/EchoTrace`` of an `EchoTrace`."""
    return types.message_class("usmap_msgs/msg/EchoTrace")(
        header=header_to_message(trace.stamp_ns, trace.frame_id, types),
        child_frame_id=trace.child_frame_id,
        pose=pose_to_message(trace.pose, types),
        transducer=transducer_to_message(trace.transducer, types),
        sound_speed=float(trace.channel.sound_speed_m_s),
        attenuation=float(trace.channel.attenuation_db_m),
        floor_height=float(trace.channel.floor_height_m),
        floor_reflectivity=float(trace.channel.floor_reflectivity),
        encoding=int(trace.encoding),
        sample_rate=float(trace.sample_rate_hz),
        start_delay=float(trace.start_delay_s),
        noise_std=float(trace.noise_std),
        samples=types.sequence(np.asarray(trace.samples, dtype=np.float32)),
    )
