"""``usmap_msgs/EchoTrace``: one ping as it was received."""

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.io.cdr import CdrReader, CdrWriter, Layout, Payload
from usmap_ros.io.conversions.fields import (
    FLOAT32,
    read_enumeration,
    read_header,
    read_pose,
    read_transducer,
    write_header,
    write_pose,
    write_transducer,
)
from usmap_ros.pings.trace import EchoTrace, Encoding

#: From ``sound_speed`` to ``noise_std``, with ``encoding`` in between.
_NUMBERS = Layout.of(8, "4dB7x3d")


def trace_from_cdr(payload: Payload) -> EchoTrace:
    """`EchoTrace` from a serialized ``usmap_msgs/EchoTrace``; its samples are a view of that.

    Raises
    ------
    MalformedMessageError
        If it cannot be decoded, or a field holds what no sensor could have sent.
    """
    reader = CdrReader(payload)
    stamp_ns, frame_id = read_header(reader)
    child_frame_id, pose, transducer = reader.text(), read_pose(reader), read_transducer(reader)
    *channel, encoding, sample_rate_hz, start_delay_s, noise_std = reader.numbers(_NUMBERS)
    samples = reader.sequence(FLOAT32)
    reader.end()
    trace = EchoTrace(
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        child_frame_id=child_frame_id,
        pose=pose,
        transducer=transducer,
        channel=Channel(*channel),
        encoding=read_enumeration("encoding", encoding, Encoding),
        sample_rate_hz=sample_rate_hz,
        start_delay_s=start_delay_s,
        noise_std=noise_std,
        samples=samples,
    )
    trace.validate()
    return trace


def noise_from_cdr(payload: Payload) -> float:
    """``noise_std`` of a serialized ``usmap_msgs/EchoTrace``, in a third of the time of all of it.

    Raises
    ------
    MalformedMessageError
        If it cannot be decoded that far.
    """
    reader = CdrReader(payload)
    read_header(reader)
    reader.text()
    read_pose(reader)
    read_transducer(reader)
    return float(reader.numbers(_NUMBERS)[-1])


def trace_to_cdr(trace: EchoTrace) -> bytes:
    """Serialized ``usmap_msgs/EchoTrace`` of an `EchoTrace`; rclpy publishes it as it is.

    Raises
    ------
    MalformedMessageError
        If its stamp does not fit a message.
    """
    channel, writer = trace.channel, CdrWriter()
    write_header(writer, trace.stamp_ns, trace.frame_id)
    writer.text(trace.child_frame_id)
    write_pose(writer, trace.pose)
    write_transducer(writer, trace.transducer)
    writer.numbers(
        _NUMBERS,
        channel.sound_speed_m_s,
        channel.attenuation_db_m,
        channel.floor_height_m,
        channel.floor_reflectivity,
        trace.encoding,
        trace.sample_rate_hz,
        trace.start_delay_s,
        trace.noise_std,
    )
    writer.sequence(FLOAT32, trace.samples)
    return writer.message()
