"""Traces as they should have been, as far as parameters say what they lack.

Units, time and channel are set right as a calibration found them; of sensors that send with one
element and listen with another beside it, it is told where both are.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from usmap_ros.acoustics.propagation import Channel, FloorModel
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import CorrectionParameters, ReconstructionParameters
from usmap_ros.pings.preparation.dc_offset import without_dc_offset
from usmap_ros.pings.preparation.received_pulse import with_profile
from usmap_ros.pings.preparation.ring_down import without_own_sound
from usmap_ros.pings.preparation.valid_part import valid_part
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.pings.transducer_array import ArrayElement, TransducerArray

#: What the sending element's frame is called, behind that of the sensor.
_SENDER = "/sender"
_NO_TURN = np.array([0.0, 0.0, 0.0, 1.0])
_NEUTRAL = CorrectionParameters()


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
    # Its own sound tells when it has rung out.
    trace = valid_part(trace, parameters.valid_from_s, parameters.valid_until_s)
    trace = without_own_sound(trace, parameters.ringing)
    if parameters.upright_objects:
        return trace
    rise_m = parameters.object_height_m - float(trace.pose.position_m[2])
    return replace(trace, channel=replace(trace.channel, object_rise_m=rise_m))


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


def corrected(trace: EchoTrace, correction: CorrectionParameters) -> EchoTrace:
    """Give `trace` the units, the time and the channel that it should have had.

    Parameters
    ----------
    trace : EchoTrace
        As recorded; it stays as it is.
    correction : CorrectionParameters
        What is off in it.

    Returns
    -------
    EchoTrace
        Samples that would then lie before the start of emission are left out.
    """
    if correction == _NEUTRAL:
        return trace
    channel = corrected_channel(trace.channel, correction)
    start_s = trace.start_delay_s - 2.0 * correction.range_offset_m / channel.sound_speed_m_s
    early = max(0, int(np.ceil(-start_s * trace.sample_rate_hz)))
    shifted = replace(trace, start_delay_s=start_s).cut(early)
    return replace(
        shifted,
        channel=channel,
        noise_std=trace.noise_std * correction.noise_factor / correction.gain,
        samples=(shifted.samples / np.float32(correction.gain)).astype(np.float32),
    )


def corrected_channel(stated: Channel, correction: CorrectionParameters) -> Channel:
    """What the sound travels through, where messages state `stated`."""
    height_m, reflectivity = correction.floor_height_m, correction.floor_reflectivity
    return replace(
        stated,
        sound_speed_m_s=correction.sound_speed_m_s or stated.sound_speed_m_s,
        floor_height_m=stated.floor_height_m if height_m < 0.0 else height_m,
        floor_reflectivity=stated.floor_reflectivity if reflectivity < 0.0 else reflectivity,
        floor_model=FloorModel(correction.floor_model),
    )
