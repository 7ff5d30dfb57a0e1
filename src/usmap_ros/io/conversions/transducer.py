"""``usmap_msgs/Transducer``, which traces and cones both carry."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from usmap_ros import bounds
from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.io.cdr import BYTE, CdrReader, CdrWriter
from usmap_ros.io.conversions.fields import FLOAT64, TWO_DOUBLES, read_enumeration


def read_transducer(reader: CdrReader) -> Transducer:
    """`Transducer` from a ``usmap_msgs/Transducer``, not yet validated.

    Messages that say the same share one, with all that was ever worked out about it.
    """
    (shape,) = reader.numbers(BYTE)
    pulse = reader.numbers(TWO_DOUBLES)
    angles_rad, gains = reader.sequence(FLOAT64), reader.sequence(FLOAT64)
    ranges_m = reader.numbers(TWO_DOUBLES)
    is_small = max(len(angles_rad), len(gains)) <= bounds.MAX_BEAM_ANGLES
    make = _shared if is_small else _shared.__wrapped__
    return make(shape, pulse, angles_rad.tobytes(), gains.tobytes(), ranges_m)


@lru_cache(maxsize=64)
def _shared(
    shape: int,
    pulse: tuple[float, float],
    angles_rad: bytes,
    gains: bytes,
    ranges_m: tuple[float, float],
) -> Transducer:
    """One transducer for all messages that say this of it; its arrays cannot be written to."""
    beam = BeamPattern(np.frombuffer(angles_rad), np.frombuffer(gains))
    known = read_enumeration("transducer.pulse_shape", shape, PulseShape)
    return Transducer(Pulse(known, *pulse), beam, *ranges_m)


def write_transducer(writer: CdrWriter, transducer: Transducer) -> None:
    """Append a ``usmap_msgs/Transducer``."""
    pulse, beam = transducer.pulse, transducer.beam
    writer.numbers(BYTE, pulse.shape)
    writer.numbers(TWO_DOUBLES, pulse.carrier_hz, pulse.duration_s)
    writer.sequence(FLOAT64, beam.angles_rad)
    writer.sequence(FLOAT64, beam.gains)
    writer.numbers(TWO_DOUBLES, transducer.min_range_m, transducer.max_range_m)
