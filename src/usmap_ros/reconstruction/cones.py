"""The one maker of cones: echoes and limits, put down beside what the trace says of itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.pings.cone import EchoCone, encode_limits
from usmap_ros.pings.trace import EchoTrace


@dataclass(frozen=True)
class RecoveredEchoes:
    """Echoes that a dictionary explains a trace by, in any order."""

    #: (echoes,) arrays: ranges and their standard deviations.
    ranges_m: FloatArray
    range_stds_m: FloatArray
    #: (echoes,) arrays: of each echo's direct path, in units of the trace's samples.
    amplitudes: FloatArray
    amplitude_stds: FloatArray

    def where(self, kept: BoolArray) -> RecoveredEchoes:
        """Those echoes for which `kept` is true."""
        return RecoveredEchoes(
            self.ranges_m[kept],
            self.range_stds_m[kept],
            self.amplitudes[kept],
            self.amplitude_stds[kept],
        )


def make_cone(
    trace: EchoTrace,
    echoes: RecoveredEchoes,
    limit_amplitudes: FloatArray,
    limit_step_m: float,
    residual: float,
) -> EchoCone:
    """Return the cone of a trace.

    Parameters
    ----------
    trace : EchoTrace
        Where it was heard from, and with what.
    echoes : RecoveredEchoes
        What was found in it.
    limit_amplitudes : (bins,) array
        Amplitude below which an object could have gone unreported, by range bin.
    limit_step_m : float
        Width of a range bin.
    residual : float
        Norm of what the echoes leave unexplained, relative to the trace's norm.

    Raises
    ------
    MalformedMessageError
        If what was found is no cone that could be sent to others.
    """
    columns = np.array(
        [echoes.ranges_m, echoes.range_stds_m, echoes.amplitudes, echoes.amplitude_stds]
    )
    columns = columns[:, np.argsort(echoes.ranges_m)].astype(np.float32)
    ranges_m, range_stds_m, amplitudes, amplitude_stds = columns
    amplitude_stds = np.where(_is_clipped(trace, ranges_m), amplitudes, amplitude_stds)
    cone = EchoCone(
        stamp_ns=trace.stamp_ns,
        frame_id=trace.frame_id,
        child_frame_id=trace.child_frame_id,
        pose=trace.pose,
        transducer=trace.transducer.stated,
        attenuation_db_m=trace.channel.attenuation_db_m,
        object_rise_m=trace.channel.object_rise_m,
        ranges_m=ranges_m,
        range_stds_m=range_stds_m,
        amplitudes=amplitudes,
        amplitude_stds=amplitude_stds,
        # As the message has it, so that a recorded cone is the same as one just made.
        limit_step_m=float(np.float32(limit_step_m)),
        detection_limits=encode_limits(limit_amplitudes),
        residual=residual,
    )
    # What it has of the trace was valid there.
    cone.validate_echoes()
    return cone


def _is_clipped(trace: EchoTrace, ranges_m: NDArray[np.float32]) -> BoolArray:
    """Which echoes' samples the receiver cut off: how loud they were nobody knows."""
    saturated_s = trace.saturated_s()
    if not len(saturated_s):
        return np.zeros(len(ranges_m), bool)
    begin_s = 2.0 / trace.channel.sound_speed_m_s * ranges_m.astype(float)
    ends_s = begin_s, begin_s + trace.transducer.pulse.length_s
    before, until = (np.searchsorted(saturated_s, end_s) for end_s in ends_s)
    return until > before
