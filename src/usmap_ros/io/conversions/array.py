"""``usmap_msgs/TransducerArray``: who pings at once, and what traces do not say of their pulses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.conversions.common import (
    MessageTypes,
    bare_pose_from_message,
    bare_pose_to_message,
    header_to_message,
    stamp_from_header,
)
from usmap_ros.io.conversions.transducer import transducer_from_message, transducer_to_message
from usmap_ros.transducer_array import ArrayElement, TransducerArray


def array_from_message(message: Any) -> TransducerArray:
    """`TransducerArray` from a ``usmap_msgs/TransducerArray``.

    Raises
    ------
    MalformedMessageError
        If a field holds what no robot could carry.
    """
    array = TransducerArray(
        stamp_ns=stamp_from_header(message.header),
        frame_id=str(message.header.frame_id),
        elements=tuple(_element_from_message(element) for element in message.elements),
    )
    try:
        array.validate()
    except MalformedMessageError as error:
        raise MalformedMessageError(f"TransducerArray.{error.field}", error.cause) from error
    return array


def array_to_message(array: TransducerArray, types: MessageTypes) -> Any:
    """``usmap_msgs/TransducerArray`` of a `TransducerArray`."""
    element_class = types.message_class("usmap_msgs/msg/ArrayElement")
    return types.message_class("usmap_msgs/msg/TransducerArray")(
        header=header_to_message(array.stamp_ns, array.frame_id, types),
        elements=[
            element_class(
                child_frame_id=element.child_frame_id,
                mount=bare_pose_to_message(element.mount, types),
                emits=element.emits,
                transducer=transducer_to_message(element.transducer, types),
                sweep=float(element.transducer.pulse.sweep_hz),
            )
            for element in array.elements
        ],
    )


def _element_from_message(message: Any) -> ArrayElement:
    transducer = transducer_from_message(message.transducer)
    pulse = replace(transducer.pulse, sweep_hz=float(message.sweep))
    return ArrayElement(
        child_frame_id=str(message.child_frame_id),
        mount=bare_pose_from_message(message.mount),
        emits=bool(message.emits),
        transducer=replace(transducer, pulse=pulse),
    )
