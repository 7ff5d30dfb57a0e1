"""Sensors that send with one element and listen with another beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.pings.transducer_array import ArrayElement, TransducerArray

#: What the sending element's frame is called, behind that of the sensor.
_SENDER = "/sender"
_NO_TURN = np.array([0.0, 0.0, 0.0, 1.0])


def with_receiver_at(trace: EchoTrace, offset_m: Sequence[float]) -> EchoTrace:
    """Tell `trace` that it was received beside where it was sent from.

    Parameters
    ----------
    trace : EchoTrace
        Its pose is that of the element that sends.
    offset_m : (3,) sequence
        Where the other one is, ahead, to the left and upwards.

    Raises
    ------
    MalformedMessageError
        If the transducer is one of an array, which has a geometry of its own.
    """
    if not any(offset_m):
        return trace
    if len(trace.sent) > 1 or not trace.is_own(trace.sent[0]):
        raise MalformedMessageError(
            "child_frame_id",
            "is of transducers that ping at once, which reconstruction.receiver_offset_m does not"
            " apply to",
        )
    offset = np.asarray(offset_m, dtype=float)
    name = trace.child_frame_id
    elements = (
        ArrayElement(name, Pose(np.zeros(3), _NO_TURN), False, trace.transducer),
        ArrayElement(name + _SENDER, Pose(-offset, _NO_TURN), True, trace.transducer),
    )
    position_m = trace.pose.compose(Pose(offset, _NO_TURN)).position_m
    return replace(
        trace,
        pose=replace(trace.pose, position_m=position_m),
        array=TransducerArray(trace.stamp_ns, name, elements),
    )
