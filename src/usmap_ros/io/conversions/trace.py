"""``usmap_msgs/EchoTrace``: one ping as it was received."""

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.io.cdr import CdrReader, CdrWriter, Layout, Payload
from usmap_ros.io.conversions.fields import FLOAT32, read_enumeration, read_ping, write_ping
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
    ping = read_ping(reader)
    *channel, encoding, sample_rate_hz, start_delay_s, noise_std = reader.numbers(_NUMBERS)
    samples = reader.sequence(FLOAT32)
    reader.end()
    trace = EchoTrace(
        *ping,
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
    read_ping(reader)
    return float(reader.numbers(_NUMBERS)[-1])


def trace_to_cdr(trace: EchoTrace) -> bytes:
    """Serialized ``usmap_msgs/EchoTrace`` of an `EchoTrace`; rclpy publishes it as it is.

    Raises
    ------
    MalformedMessageError
        If its stamp does not fit a message.
    """
    channel, writer = trace.channel, CdrWriter()
    write_ping(writer, trace)
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
