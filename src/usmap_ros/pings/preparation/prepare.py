"""Traces as they should have been, as far as parameters say what they lack."""

from __future__ import annotations

from dataclasses import replace

from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.preparation.correction import corrected
from usmap_ros.pings.preparation.dc_offset import without_dc_offset
from usmap_ros.pings.preparation.received_pulse import with_profile
from usmap_ros.pings.preparation.two_elements import with_receiver_at
from usmap_ros.pings.preparation.valid_part import valid_part
from usmap_ros.pings.trace import EchoTrace


def prepared(trace: EchoTrace, parameters: ReconstructionParameters) -> EchoTrace:
    """Set right what is off in a trace, and add what it does not say.

    Parameters
    ----------
    trace : EchoTrace
        As recorded; it stays as it is.
    parameters : ReconstructionParameters
        What is known of it.

    Raises
    ------
    MalformedMessageError
        If they do not fit the trace.
    """
    trace = without_dc_offset(trace.with_sweep(parameters.chirp_sweep_hz))
    trace = corrected(trace, parameters.correction)
    trace = with_profile(trace, parameters.pulse)
    trace = with_receiver_at(trace, parameters.receiver_offset_m)
    trace = valid_part(trace, parameters.valid_from_s, parameters.valid_until_s)
    if parameters.upright_objects:
        return trace
    rise_m = parameters.object_height_m - float(trace.pose.position_m[2])
    return replace(trace, channel=replace(trace.channel, object_rise_m=rise_m))
