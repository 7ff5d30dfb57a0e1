"""``usmap_msgs/Transducer``, which traces and cones both carry."""

from __future__ import annotations

from typing import Any

import numpy as np

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.io.conversions.common import (
    MessageTypes,
    array_from_field,
    enumeration_from_field,
)


def transducer_from_message(message: Any) -> Transducer:
    """`Transducer` from a ``usmap_msgs/Transducer``, not yet validated."""
    pulse = Pulse(
        shape=enumeration_from_field("transducer.pulse_shape", message.pulse_shape, PulseShape),
        carrier_hz=float(message.carrier_frequency),
        duration_s=float(message.pulse_duration),
    )
    beam = BeamPattern(
        angles_rad=array_from_field("transducer.beam_angles", message.beam_angles, np.float64),
        gains=array_from_field("transducer.beam_gains", message.beam_gains, np.float64),
    )
    return Transducer(pulse, beam, float(message.min_range), float(message.max_range))


def transducer_to_message(transducer: Transducer, types: MessageTypes) -> Any:
    """``usmap_msgs/Transducer`` of a `Transducer`."""
    pulse, beam = transducer.pulse, transducer.beam
    return types.message_class("usmap_msgs/msg/Transducer")(
        pulse_shape=int(pulse.shape),
        carrier_frequency=float(pulse.carrier_hz),
        pulse_duration=float(pulse.duration_s),
        beam_angles=types.sequence(np.asarray(beam.angles_rad, dtype=np.float64)),
        beam_gains=types.sequence(np.asarray(beam.gains, dtype=np.float64)),
        min_range=float(transducer.min_range_m),
        max_range=float(transducer.max_range_m),
    )
