"""``usmap_msgs/Transducer``, which traces and cones both carry."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from usmap_ros import bounds
from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.io.conversions.common import (
    MessageTypes,
    array_from_field,
    enumeration_from_field,
)


def transducer_from_message(message: Any) -> Transducer:
    """`Transducer` from a ``usmap_msgs/Transducer``, not yet validated.

    Messages that say the same share one, with all that was ever worked out about it.
    """
    shape = enumeration_from_field("transducer.pulse_shape", message.pulse_shape, PulseShape)
    angles_rad = array_from_field("transducer.beam_angles", message.beam_angles, np.float64)
    gains = array_from_field("transducer.beam_gains", message.beam_gains, np.float64)
    is_small = max(len(angles_rad), len(gains)) <= bounds.MAX_BEAM_ANGLES
    return (_shared if is_small else _shared.__wrapped__)(
        Pulse(shape, float(message.carrier_frequency), float(message.pulse_duration)),
        angles_rad.tobytes(),
        gains.tobytes(),
        float(message.min_range),
        float(message.max_range),
    )


@lru_cache(maxsize=64)
def _shared(
    pulse: Pulse, angles_rad: bytes, gains: bytes, min_range_m: float, max_range_m: float
) -> Transducer:
    """One transducer for all messages that say this of it; its arrays cannot be written to."""
    beam = BeamPattern(np.frombuffer(angles_rad), np.frombuffer(gains))
    return Transducer(pulse, beam, min_range_m, max_range_m)


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
